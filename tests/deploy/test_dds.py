"""Messages over DDS on the loopback interface."""

import contextlib
import re
import signal
from collections.abc import Iterator

import pytest
from cyclonedds.pub import DataWriter
from deploy_processes import Processes, output

from hugwbc import load_robot
from hugwbc.deploy.capture import GRIPS
from hugwbc.deploy.dds import DdsEndpoint, _api, _Raw, check_network
from hugwbc.deploy.messages import Messages
from hugwbc.deploy.watchdogs import Intake, Limits
from hugwbc.errors import ConfigError

in_real_time = pytest.mark.slow  # two processes: on a busy machine they take minutes


@pytest.fixture
def processes(tmp_path) -> Iterator[Processes]:
    with Processes(tmp_path) as found:
        yield found


@in_real_time
@pytest.mark.parametrize(("name", "other"), [("h1", "g1"), ("g1", "h1")])
def test_deploy_and_replay_in_lockstep(processes, tmp_path, free_domain, name, other) -> None:
    """Modes are released, states answered, commands accepted; the recording is replayed bit for bit."""
    schedule = "0.1 Start, 0.6 Select"
    robot = processes.hugwbc(
        *("simulate-robot", "--robot", name, "--lockstep", "--domain", free_domain, "--mode", "normal"),
        *("--duration", "30"),
        *("--schedule", schedule, "--slower", "2"),
    )
    path = tmp_path / "run.bin"
    side = processes.hugwbc("deploy", "--robot", other, "--controller", "hold", "--domain", free_domain)
    assert re.search(rf"sends unitree_(go|hg).LowState_, so it is no {other}; name it with --robot", output(side, 2))
    side = processes.hugwbc(
        *("deploy", "--robot", name, "--controller", "hold", "--lockstep", "--domain", free_domain),
        *("--duration", "0.9", "--record", path),
    )
    text = output(side)
    assert "released normal" in text
    assert "zero torque -> start pose: asked to start, hanging or held" in text
    assert "start pose -> damping: asked to stop" in text
    assert "0 with a wrong check sum, 0 old, 0 of a wrong size" in text
    robot.send_signal(signal.SIGINT)
    text = output(robot, 130)
    assert "refused: none" in text and int(re.findall(r"(\d+) commands received", text)[0]) > 1000
    text = output(processes.hugwbc("deploy", "--replay", path))
    assert "all equal bit for bit" in text and int(re.findall(r"(\d+) states,", text)[0]) > 1000


# The order of messages of the maker's deploy_real.py (unitree_rl_gym), with the maker's own channels and check sum.
MAKERS_CLIENT = """
import sys, time
from unitree_sdk2py.core.channel import ChannelFactoryInitialize, ChannelPublisher, ChannelSubscriber
from unitree_sdk2py.idl import default, unitree_go, unitree_hg
from unitree_sdk2py.utils.crc import CRC

seals, domain, robot = sys.argv[1] == "seals", int(sys.argv[2]), sys.argv[3]
package = {"h1": unitree_go, "g1": unitree_hg}[robot]
LowCmd_, LowState_ = package.msg.dds_.LowCmd_, package.msg.dds_.LowState_
ChannelFactoryInitialize(domain, "lo")
publisher = ChannelPublisher("rt/lowcmd", LowCmd_)
publisher.Init()
states = []
subscriber = ChannelSubscriber("rt/lowstate", LowState_)
subscriber.Init(states.append, 10)
end = time.time() + 60
while not states or states[-1].tick == 0:
    assert time.time() < end, "no state"
    time.sleep(0.02)
if robot == "h1":
    command = default.unitree_go_msg_dds__LowCmd_()
    command.head[0], command.head[1], command.level_flag = 0xFE, 0xEF, 0xFF
    for slot in range(20):
        command.motor_cmd[slot].mode = 0x01 if slot >= 10 else 0x0A
        command.motor_cmd[slot].q, command.motor_cmd[slot].dq = 2.146e9, 16000.0
else:
    command = default.unitree_hg_msg_dds__LowCmd_()
    command.mode_machine = states[-1].mode_machine
    for slot in range(29):
        command.motor_cmd[slot].mode = 1

def send():
    if seals:
        command.crc = CRC().Crc(command)
    publisher.Write(command)
    time.sleep(0.02)

for _ in range(10):
    send()
elbow = 19 if robot == "h1" else 18
start = states[-1].motor_state[elbow].q
motor = command.motor_cmd[elbow]
motor.q, motor.dq, motor.kp, motor.kd = start + 0.5, 0.0, 60.0, 1.5
for _ in range(100):
    send()
print("moved", states[-1].motor_state[elbow].q - start, "sum right", CRC().Crc(states[-1]) == states[-1].crc)
"""


@in_real_time
@pytest.mark.parametrize(("seals", "name"), [(True, "h1"), (False, "h1"), (True, "g1")])
def test_the_makers_order_of_messages_works_and_a_client_without_check_sum_is_told(processes, free_domain, seals, name):
    words = ("--robot", name, "--domain", free_domain, "--slower", "2", "--duration", "100")
    robot = processes.hugwbc("simulate-robot", *words)
    client = processes.start(["-c", MAKERS_CLIENT, "seals" if seals else "forgets", str(free_domain), name])
    text = output(client)
    moved, right = re.findall(r"moved (\S+) sum right (\w+)", text)[0]
    assert right == "True"
    robot.send_signal(signal.SIGINT)
    told = output(robot, 130)
    if seals:
        assert float(moved) > 0.3 and "refused: none" in told
    else:
        assert "refused: check sum" in told and "the sender never sets it" in told
        assert "torque 0.00 of the limit" in told


RIVAL = """
import sys, time
from hugwbc import JointCommand, load_robot
from hugwbc.deploy.dds import DdsEndpoint
from hugwbc.deploy.messages import Messages

robot, endpoint = load_robot(), DdsEndpoint(package="unitree_go", robot=False, net="lo", domain=int(sys.argv[1]))
message = Messages(robot).pack_command(JointCommand.position(robot, robot.nominal))
for _ in range(150):
    endpoint.send(message)
    time.sleep(0.02)
"""


@in_real_time
def test_a_second_program_is_told_and_damps_and_a_second_deploy_is_refused(processes, free_domain) -> None:
    words = ("--domain", free_domain, "--slower", "10")  # for a busy machine
    processes.hugwbc("simulate-robot", *words, "--duration", "30", "--schedule", "0.2 Start")
    first = processes.hugwbc("deploy", "--controller", "hold", *words, "--duration", "6")
    told: list[str] = []
    for line in first.stdout:  # type: ignore[union-attr]
        told.append(line)
        if "start pose" in line:
            break
    else:
        pytest.fail(f"deploy ended before the start pose: {''.join(told)}")
    output(processes.start(["-c", RIVAL, str(free_domain)]))
    text = output(processes.hugwbc("deploy", "--controller", "hold", *words), 2)
    assert "another program commands this robot; end that program first" in text
    text = output(first, 1)
    assert "another program commands this robot; end one of the two" in text
    assert "start pose -> damping: another program commands this robot" in text


@pytest.mark.parametrize(("net", "domain", "words"), [("eth77", 1, "no network interface"), ("lo", 999, "DDS domain")])
def test_networks_that_do_not_exist_are_refused(net, domain, words) -> None:
    with pytest.raises(ConfigError, match=words):
        check_network(net, domain)
    with pytest.raises(ConfigError, match=words):
        DdsEndpoint(package="unitree_go", robot=False, net=net, domain=domain)


def send(endpoint: DdsEndpoint, messages: list[bytes], kind: str, topic: str | None = None) -> None:
    """Send bytes to an endpoint, as another program would."""
    writer = DataWriter(endpoint._participant, endpoint._raw_topic(kind, topic))
    for message in messages:
        writer.write(_Raw(message))


def test_a_text_that_is_not_utf8_ends_nothing_and_drops_no_other(free_domain) -> None:
    with contextlib.closing(DdsEndpoint(package="unitree_go", robot=True, net="lo", domain=free_domain)) as endpoint:
        endpoint.texts(GRIPS)
        texts = [b"\0\1\0\0\4\0\0\0" + text for text in (b"one\0", b"t\xffo\0", "\N{SNOWMAN}\0".encode())]
        send(endpoint, texts, "std_msgs.String_", GRIPS)
        assert endpoint.texts(GRIPS) == ["one", "t\N{REPLACEMENT CHARACTER}o", "\N{SNOWMAN}"]
        asked: list[str] = []
        endpoint.serve(lambda number, parameter: (asked.append(parameter) or 0, ""))
        identity, lease, policy = (
            _api("RequestIdentity_")(1, 2),
            _api("RequestLease_")(0),
            _api("RequestPolicy_")(0, False),
        )
        call = _api("Request_")(_api("RequestHeader_")(identity, lease, policy), "wish", []).serialize()
        send(endpoint, [call.replace(b"i", b"\xff"), call], "unitree_api.Request_", "rt/api/motion_switcher/request")
        endpoint.receive(0.0)
        assert asked == ["wish"]


def test_a_state_of_a_wrong_size_is_refused_and_named(free_domain) -> None:
    with contextlib.closing(DdsEndpoint(package="unitree_go", robot=False, net="lo", domain=free_domain)) as endpoint:
        intake = Intake(Messages(load_robot("h1")), Limits())
        send(endpoint, [b"\0\1\0\0" + bytes(1276)], "unitree_go.LowState_")
        (message,) = endpoint.receive(1.0)
    assert not intake.check(message, 0.0) and intake.torn == 1
    assert "it is 1280 bytes instead of unitree_go.LowState_, which h1 speaks" in intake.refusal
