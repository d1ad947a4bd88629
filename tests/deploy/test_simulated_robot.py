"""A simulated robot that is read and driven by messages alone."""

import dataclasses
import threading
import time

import mujoco
import numpy as np
import pytest
from deploy_bench import EXACT, Pair
from local_endpoint import LocalEndpoint, local_pair

from hugwbc import JointCommand, load_robot
from hugwbc.deploy import state_machine, wire
from hugwbc.deploy.messages import Messages
from hugwbc.deploy.simulated_robot import LIFTED, LOWERED, Channel, Happening, Hoist, Radio, Schedule, SimulatedRobot
from hugwbc.deploy.state_machine import Mode
from hugwbc.errors import ConfigError
from hugwbc.mbc import WholeBodyController
from hugwbc.sim import Simulation
from hugwbc.state import GRAVITY

H1 = load_robot()
HOLD = JointCommand.position(H1, H1.nominal)


def make(**options) -> tuple[SimulatedRobot, LocalEndpoint, list[str]]:
    told: list[str] = []
    robot_end, client = local_pair()
    simulation = Simulation(sensing=EXACT)
    return SimulatedRobot(simulation, robot_end, tell=told.append, **{"hoist": None, **options}), client, told


def step(robot: SimulatedRobot, client: LocalEndpoint, message: bytes | None = None) -> list[bytes]:
    """One physics step; returns the states that were sent."""
    if message is not None:
        client.send(message)
    robot.send()
    robot.take()
    robot.move()
    return client.receive(0.0)


def test_each_step_sends_a_sound_state_with_the_next_tick() -> None:
    robot, client, _ = make()
    messages = Messages(H1)
    states = [message for _ in range(20) for message in step(robot, client)]
    assert all(map(wire.is_sealed, states)) and len(states) == 20
    ticks = [messages.unpack_state(message).tick for message in states]
    assert ticks[0] > 0 and set(np.diff(ticks)) == {2}
    record = wire.record("unitree_go.LowState_", states[-1])
    assert not np.any(record["foot_force"]), "an H1 has no foot sensors"


def test_a_state_tells_what_the_sensors_say() -> None:
    robot, client, _ = make()
    command = Messages(H1).pack_command(dataclasses.replace(HOLD, q=H1.nominal + 0.1))
    for _ in range(50):
        step(robot, client, command)
    robot.send()
    (message,) = client.receive(0.0)
    sensed, read = robot.simulation.sense(), Messages(H1).unpack_state(message).state
    for name in ("q", "dq", "torque", "imu_gyro", "imu_accelerometer", "angular_velocity"):
        np.testing.assert_allclose(getattr(read, name), getattr(sensed, name), rtol=1e-5, atol=1e-5)
    assert abs(read.orientation @ sensed.orientation) == pytest.approx(1.0, abs=1e-6)


def test_the_joints_follow_the_pd_law_at_every_step() -> None:
    """The robot behind the messages moves as the bare simulation does under the same (single-precision) command."""
    robot, client, _ = make()
    message = Messages(H1).pack_command(dataclasses.replace(HOLD, q=H1.nominal + 0.05))
    bare = Simulation(sensing=EXACT)
    command = Messages(H1).unpack_command(message).command
    step(robot, client, message)
    bare.step(command, bare.timestep)
    for _ in range(100):
        step(robot, client)
        bare.step(command, bare.timestep)
    np.testing.assert_array_equal(robot.simulation.qpos, bare.qpos)


def test_motors_are_off_until_a_command_comes_and_hold_the_last_one_after() -> None:
    robot, client, _ = make()
    for _ in range(20):
        step(robot, client)
    assert not np.any(robot.simulation.torque)
    message = Messages(H1).pack_command(HOLD)
    step(robot, client, message)
    for _ in range(200):
        step(robot, client)
    assert np.max(np.abs(robot.simulation.torque)) > 10.0
    assert robot.extremes.silence == pytest.approx(0.4, abs=0.01)


def test_a_client_that_never_sets_the_check_sum_is_refused_and_told() -> None:
    robot, client, told = make()
    content = wire.record("unitree_go.LowCmd_", Messages(H1).pack_command(HOLD))
    content["crc"] = 0
    for _ in range(1200):
        step(robot, client, content.tobytes())
    assert robot.tally.counts == {"check sum": 1200} and not np.any(robot.simulation.torque)
    assert len(told) == 3 and all("never sets it" in line for line in told)


@pytest.mark.parametrize(("name", "other"), [("h1", "g1"), ("g1", "h1")])
def test_a_command_for_another_robot_is_refused_by_name(name, other) -> None:
    told: list[str] = []
    robot_end, client = local_pair()
    robot = SimulatedRobot(Simulation(robot=name, sensing=EXACT), robot_end, hoist=None, tell=told.append)
    kinds = {"h1": "unitree_go", "g1": "unitree_hg"}
    wrong = load_robot(other)
    state = step(robot, client, Messages(wrong).pack_command(JointCommand.position(wrong, wrong.nominal)))[0]
    assert robot.tally.counts == {"size": 1} and not np.any(robot.simulation.torque)
    assert f"it is {kinds[other]}.LowCmd_ instead of {kinds[name]}.LowCmd_, which {name} speaks" in told[0]
    said = f"it is {kinds[name]}.LowState_ instead of {kinds[other]}.LowState_, which {other} speaks"
    messages = Messages(wrong)
    assert messages.refusal(messages.state, state) == ("size", said)


def test_a_command_for_another_variant_of_the_g1_is_refused_and_named() -> None:
    told: list[str] = []
    robot_end, client = local_pair()
    robot = SimulatedRobot(Simulation(robot="g1", sensing=EXACT), robot_end, hoist=None, tell=told.append)
    g1 = load_robot("g1")
    content = wire.record("unitree_hg.LowCmd_", Messages(g1).pack_command(JointCommand.position(g1, g1.nominal)))
    step(robot, client, wire.sealed(content))
    assert not robot.tally.counts
    content["mode_machine"] = 4
    step(robot, client, wire.sealed(content))
    assert robot.tally.counts == {"variant": 1} and "its mode_machine is 4; that of g1 is 5 or 6" in told[0]


def test_commands_are_refused_while_a_motion_mode_is_active() -> None:
    robot, client, told = make(mode="normal")
    message = Messages(H1).pack_command(HOLD)
    step(robot, client, message)
    assert robot.tally.counts == {"motion mode": 1} and "motion mode 'normal' is active" in told[0]
    assert client.call(1003, "{}", 0.0)[0] == 0
    step(robot, client, message)
    assert robot.tally.counts == {"motion mode": 1}


def test_commands_that_are_not_finite_are_refused_and_told() -> None:
    robot, client, told = make()
    step(robot, client, Messages(H1).pack_command(HOLD))
    held = robot._command
    step(robot, client, Messages(H1).pack_command(dataclasses.replace(HOLD, q=np.full(19, np.nan))))
    assert robot.tally.counts == {"numbers": 1} and "not finite" in told[0] and robot._command is held


def test_torn_commands_are_refused() -> None:
    robot, client, _ = make()
    for message in (b"", b"x" * 811, bytes(4000)):
        step(robot, client, message)
    assert robot.tally.counts == {"size": 3}


def test_states_are_as_old_as_the_sensors_latency() -> None:
    robot, client, _ = make(latency=0.01)
    counts = [len(step(robot, client)) for _ in range(8)]
    assert counts == [0] * 5 + [1] * 3
    robot, client, _ = make(latency=0.01)
    for _ in range(30):
        states = step(robot, client)
    tick = Messages(H1).unpack_state(states[-1]).tick
    assert robot.time - (tick - 1) * 1e-3 == pytest.approx(0.012), "10 ms, and the step since then"


def test_a_command_that_was_overtaken_is_left_out() -> None:
    robot, client, _ = make(radio=Radio(jitter=0.02))
    messages, torques = Messages(H1), []
    for index in range(100):
        tau = np.zeros(19)
        tau[0] = index
        step(robot, client, messages.pack_command(dataclasses.replace(HOLD, tau=tau)))
        torques.append(robot._command.tau[0])
    assert np.all(np.diff(torques) >= 0.0) and torques[-1] > 80.0


def test_the_schedule_begins_with_the_first_sound_command() -> None:
    robot, client, _ = make(schedule=Schedule.parse("0.01 Start"))
    for _ in range(50):
        step(robot, client)
    message = Messages(H1).pack_command(HOLD)
    pressed = []
    for _ in range(10):
        (state,) = step(robot, client, message)
        pressed.append("Start" in Messages(H1).unpack_state(state).remote.pressed)
    assert pressed == [False] * 5 + [True] * 5


def test_a_simulation_with_latency_or_a_broken_millisecond_is_refused() -> None:
    robot_end, _ = local_pair()
    with pytest.raises(ConfigError, match="latency"):
        SimulatedRobot(Simulation(sensing="robot"), robot_end)
    with pytest.raises(ConfigError, match="milliseconds"):
        SimulatedRobot(Simulation(sensing=EXACT, timestep=0.0025), robot_end)


def test_it_keeps_the_pace_of_the_clock() -> None:
    robot, _, _ = make()
    begin = time.perf_counter()
    robot.run(0.02, slower=10.0)
    assert 0.15 < time.perf_counter() - begin < 10.0
    assert robot.time == pytest.approx(0.02)


def test_in_lockstep_it_waits_for_each_answer() -> None:
    """A client that takes 20 ms of the wall clock for each answer still answers every state of 2 ms."""
    robot, client, told = make()
    messages, answered, over = Messages(H1), [], threading.Event()

    def answer() -> None:
        command = messages.pack_command(HOLD)
        while not over.is_set():
            for state in client.receive(0.05):
                time.sleep(0.02)
                answered.append(messages.unpack_state(state).tick)
                client.send(messages.answering(command, state))

    thread = threading.Thread(target=answer)
    thread.start()
    try:
        robot.run(0.1, lockstep=True)
    finally:
        over.set()
        thread.join()
    late = answered[5:]
    assert len(late) > 20 and set(np.diff(late)) == {2} and not told


@pytest.mark.parametrize("name", ["h1", "g1"])
def test_from_the_hoist_to_a_stand(monkeypatch, name) -> None:
    """The robot side brings a simulated robot to its start pose, refuses too early a run, runs the QP and damps."""
    monkeypatch.setattr(state_machine, "START_TIME", 0.4)
    schedule = "0.02 Start, 0.1 lower, 0.3 A, 1.3 A, 1.6 release, 2.3 Select"
    pair = Pair(WholeBodyController(load_robot(name)), schedule, robot=load_robot(name))
    pair.run(2.3)
    assert pair.pilot.mode is Mode.RUN and not pair.robot.simulation.fallen
    height = float(pair.robot.simulation.qpos[2])
    assert height == pytest.approx(load_robot(name).nominal_height, abs=0.03)
    pair.run(2.34)
    assert pair.pilot.mode is Mode.DAMPING
    events = [(event.after, event.refused) for event in pair.pilot.machine.events]
    expected = [Mode.ZERO_TORQUE, Mode.START_POSE, Mode.START_POSE, Mode.RUN, Mode.DAMPING]
    assert events == [(mode, index == 2) for index, mode in enumerate(expected)]
    assert not pair.robot.tally.counts and pair.side.intake.wrong_sum == pair.side.intake.old == 0


def arrivals(radio: Radio, count: int = 2000, delay: float = 0.0) -> tuple[Channel, list[tuple[int, float]]]:
    channel: Channel[int] = Channel(radio, np.random.default_rng(0), delay)
    arrived = []
    for step in range(count + 50):
        now = 0.002 * step
        if step < count:
            channel.put(step, now)
        arrived += [(message, now - 0.002 * message) for message in channel.take(now)]
    return channel, arrived


def test_a_good_network_passes_everything_at_once() -> None:
    channel, arrived = arrivals(Radio())
    assert [message for message, _ in arrived] == list(range(2000)) and channel.lost == 0
    assert max(took for _, took in arrived) < 1e-9


def test_a_delay_holds_for_every_message() -> None:
    _, arrived = arrivals(Radio(delay=0.006), delay=0.004)
    np.testing.assert_allclose([took for _, took in arrived], 0.01, atol=1e-6)


def test_losses_have_their_rate() -> None:
    channel, arrived = arrivals(Radio(loss=0.1))
    assert len(arrived) + channel.lost == 2000
    assert channel.lost == pytest.approx(200, abs=50)


def test_jitter_lets_messages_overtake_each_other() -> None:
    _, arrived = arrivals(Radio(jitter=0.01))
    order, took = zip(*arrived, strict=True)
    assert sorted(order) == list(range(2000)) and list(order) != sorted(order)
    assert min(took) >= 0.0 and max(took) <= 0.012 and np.mean(took) == pytest.approx(0.006, abs=0.001)


@pytest.fixture
def simulation() -> Simulation:
    return Simulation()


def run(simulation: Simulation, hoist: Hoist, seconds: float, *, stiff: bool = True) -> None:
    command = JointCommand.position(simulation.robot, simulation.robot.nominal)
    zero = np.zeros(19)
    limp = JointCommand(q=zero, dq=zero, kp=zero, kd=zero, tau=zero)
    for _ in range(round(seconds / simulation.timestep)):
        hoist.update()
        simulation.step(command if stiff else limp, simulation.timestep)


def tension(simulation: Simulation) -> float:
    """Pull of the rope in the last step [N]."""
    trunk = simulation.link_names.index(simulation.robot.trunk)
    return float(np.linalg.norm(simulation.external_force[trunk, :3]))


def test_it_lifts_a_limp_robot_and_carries_its_weight(simulation) -> None:
    before = float(simulation.qpos[2])
    hoist = Hoist(simulation)
    run(simulation, hoist, 3.0, stiff=False)
    weight = simulation.robot.mass * GRAVITY
    assert tension(simulation) == pytest.approx(weight, rel=0.05)
    assert simulation.qpos[2] - before == pytest.approx(LIFTED, abs=0.03)
    foot_force = simulation.state().foot_force
    assert foot_force is not None and abs(foot_force[:, 2].sum()) < 1.0, "the feet may touch each other"
    assert abs(float(simulation.qpos[3])) > 0.95, "upright"


def test_a_lowered_robot_carries_most_of_its_weight_itself(simulation) -> None:
    hoist = Hoist(simulation, 0.0)
    hoist.lower()
    run(simulation, hoist, 1.2)
    foot_force = simulation.state().foot_force
    assert foot_force is not None
    assert foot_force[:, 2].sum() > 0.5 * simulation.robot.mass * GRAVITY
    assert not simulation.fallen
    assert hoist.height == pytest.approx(LOWERED)


def test_a_rope_never_pushes_and_lets_go(simulation) -> None:
    hoist = Hoist(simulation, 0.0)
    simulation.data.qpos[2] += 0.3  # nearer to the pulley: slack
    mujoco.mj_forward(simulation.model, simulation.data)
    hoist.update()
    assert tension(simulation) == 0.0
    hoist = Hoist(simulation, 0.1)
    run(simulation, hoist, 0.2)
    assert tension(simulation) > 100.0
    hoist.release()
    hoist.update()
    assert tension(simulation) == 0.0 and not np.any(simulation.external_force)


def test_buttons_are_held_for_a_while_and_sticks_for_ever() -> None:
    schedule = Schedule.parse("1 Start, 2 ly=0.5,2 lx=-1, 3 lower, 3 release")
    assert schedule.update(0.5) == [] and not schedule.remote.pressed
    schedule.update(1.0)
    assert schedule.remote.pressed == {"Start"}
    schedule.update(1.3)
    assert not schedule.remote.pressed and schedule.remote.ly == 0.0
    schedule.update(2.5)
    assert (schedule.remote.ly, schedule.remote.lx) == (0.5, -1.0)
    assert schedule.update(3.0) == ["lower", "release"] and schedule.update(3.1) == []


def test_something_can_be_added_while_it_runs() -> None:
    schedule = Schedule.parse("5 lift")
    schedule.update(1.0)
    schedule.add(Happening(1.0, "release"))
    assert schedule.update(1.002) == ["release"] and schedule.update(5.0) == ["lift"]


@pytest.mark.parametrize(
    "text",
    ["Start", "x Start", "1 Stat", "1", "1 ly", "1 ly=x", "1 ly=2", "-1 A", "nan A", "inf A", "1 A B", "1 A=0.5"],
)
def test_what_is_not_understood_is_refused(text) -> None:
    with pytest.raises(ConfigError, match="is not valid; give TIME and one of R1"):
        Schedule.parse(text)
