import dataclasses
import json
import sys

import numpy as np
import pytest
from local_endpoint import local_pair

from hugwbc.cli import deploy, main
from hugwbc.deploy import wire
from hugwbc.deploy.messages import Messages
from hugwbc.deploy.recording import DECISION, FORMAT, STATE, Recorder
from hugwbc.deploy.relay import Settings
from hugwbc.deploy.remote import Remote, Request
from hugwbc.deploy.robot_side import RobotSide
from hugwbc.deploy.watchdogs import Limits
from hugwbc.errors import DeploymentError
from hugwbc.robot import load_robot
from hugwbc.sim import Simulation

HEADER = {"controller": "hold", "policy": None, "robot": "h1", "script": None, "task": None, "seed": 0, "age": 0.01}
HEADER |= {"limits": dataclasses.asdict(Limits()), "format": FORMAT}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--controller", "pq"], "unknown controller 'pq'"),
        (["--net", "eth77"], "no network interface 'eth77'"),
        (["--net", "eth0", "--lockstep"], "a real one does not wait"),
        (["--net", "eth0", "--slower", "2"], "a real one does not wait"),
        (["--domain", "999"], "DDS domain is 999"),
        (["--slower", "0"], "slower is 0"),
        (["--duration", "-1"], "duration is -1"),
        (["--age", "3"], "age is 3"),
        (["--tilt", "0"], "hugwbc: tilt is 0.0; it should be greater than 0"),
        (["--script", "missing"], "missing"),
        (["--task", "press_button", "--seed", "-1"], "seed is -1; give 0 or more"),
        (["--record", "/no/such/folder/run.bin"], "cannot write /no/such/folder/run.bin"),
        (["--replay", "missing.bin"], "no recording missing.bin"),
    ],
)
def test_deploy_refuses_what_it_cannot_do(words, message, capsys) -> None:
    assert main(["deploy", "--controller", "hold", *words]) == 2
    assert message in capsys.readouterr().err


def test_a_terminal_that_is_gone_ends_no_control(monkeypatch) -> None:
    def gone(text: str) -> None:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(deploy, "say", gone)
    _, pilot, _ = deploy._build({**HEADER, "limits": {}})
    pilot.machine.refuse("asked to run", 0.0)
    assert len(pilot.machine.events) == 1


class Line:
    """An endpoint on which no state of this robot arrives, but messages of another kind may."""

    def __init__(self, kind: str | None) -> None:
        self.foreign = lambda: kind

    def receive(self, wait: float) -> list[bytes]:
        return []


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("unitree_hg.LowState_", r"the robot on lo sends unitree_hg\.LowState_, so it is no h1; name it with --robot"),
        (None, "no state has arrived on lo for 0 s; check the robot, the network and the domain"),
    ],
)
def test_another_robot_and_none_are_told(kind, message, monkeypatch) -> None:
    monkeypatch.setattr(deploy, "_PATIENCE", 0.0)
    with pytest.raises(DeploymentError, match=message):
        deploy._await_robot(Line(kind), load_robot("h1"), "lo")  # type: ignore[arg-type]


def test_a_deployment_that_cannot_begin_leaves_the_last_recording(tmp_path, capsys) -> None:
    path = tmp_path / "run.bin"
    path.write_text("what was recorded before")
    for net in ("eth77", "lo"):
        assert main(["deploy", "--controller", "hold", "--net", net, "--record", str(path)]) == 2
    assert path.read_text() == "what was recorded before"
    assert "recordings are never overwritten: give a new file" in capsys.readouterr().err


@pytest.mark.parametrize(
    "header",
    [
        '{"format": "hugwbc deployment 1"}',
        '{"format": "hugwbc deployment 1", "robot": "h1", "controller": 3, "policy": 4}',
        json.dumps({name: value for name, value in HEADER.items() if name != "task"}),
        json.dumps({name: value for name, value in HEADER.items() if name != "seed"}),
    ],
)
def test_a_recording_that_does_not_say_what_was_run_is_refused(header, tmp_path, capsys) -> None:
    path = tmp_path / "run.bin"
    path.write_text(header + "\n")
    assert main(["deploy", "--replay", str(path)]) == 2
    assert "does not say what was run" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("changes", "words", "message"),
    [
        ({"controller": "evil.py:X"}, [], "the recording runs evil.py:X; give --controller evil.py:X to allow it"),
        ({"policy": "evil.pt"}, [], "give --policy evil.pt to allow it"),
        ({"task": "evil.py"}, [], "give --task evil.py to allow it"),
        ({}, ["--controller", "qp"], "leave --controller out"),
        ({}, ["--tilt", "0.2"], "leave --tilt out"),
        ({}, [], "has no commands to compare"),
    ],
)
def test_a_replay_runs_nothing_that_only_the_recording_names(changes, words, message, tmp_path, capsys) -> None:
    path = tmp_path / "run.bin"
    path.write_text(json.dumps(HEADER | changes) + "\n")
    assert main(["deploy", "--replay", str(path), *words]) == 2
    assert message in capsys.readouterr().err


def test_a_replay_prints_the_joints_of_the_last_state(tmp_path, capsys) -> None:
    robot, path = load_robot("h1"), tmp_path / "run.bin"
    count = len(robot.joint_names)
    sensed = Simulation(robot=robot, latency=0.0).sense()
    reading = dataclasses.replace(sensed, q=robot.nominal + 0.1 * np.arange(count))
    recorder = Recorder(path, HEADER)
    recorder.add(STATE, 1.0, Messages(robot).pack_state(reading, 1000, np.full(count, 30.0), Remote()))
    recorder.add(DECISION, 1.0)
    recorder.close()
    main(["deploy", "--replay", str(path)])
    lines = capsys.readouterr().out.splitlines()
    joint = robot.joint_names[2]
    assert f"  {joint:<26} {robot.nominal[2] + 0.2:7.3f} {robot.nominal[2]:7.3f}" in lines


def test_the_extra_is_named_where_it_is_missing(monkeypatch, capsys) -> None:
    for module in [name for name in sys.modules if name.startswith("unitree_sdk2py")]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, "unitree_sdk2py", None)
    wire.idl_class.cache_clear()
    wire.layout.cache_clear()
    try:
        assert main(["simulate-robot", "--duration", "0.01", "--domain", "231"]) == 2
        assert "pip install 'hugwbc[deploy]'" in capsys.readouterr().err
    finally:
        wire.idl_class.cache_clear()
        wire.layout.cache_clear()


@pytest.mark.parametrize(
    ("words", "net", "steps"),
    [
        ({}, "lo", ["await lo", "release, if it can be", "be alone", "run"]),
        ({}, "eth0", ["await eth0", "release", "be alone", "run"]),
        ({"release": False}, "eth0", ["await eth0", "be alone", "run"]),
        ({"settings": Settings(dry_run=True)}, "eth0", ["await eth0", "run"]),
    ],
)
def test_a_deployment_frees_the_robot_and_is_alone_before_it_runs_and_a_dry_run_touches_nothing(
    monkeypatch, words, net, steps
) -> None:
    done, robot, faults = [], load_robot("h1"), iter((None, "tilted"))

    def release(endpoint, *, required: bool) -> str:
        done.append("release" if required else "release, if it can be")
        return "released"

    def run(side) -> None:
        done.append("run")
        side._outlet.fault = next(faults)

    monkeypatch.setattr(deploy, "_await_robot", lambda endpoint, robot, net: done.append(f"await {net}"))
    monkeypatch.setattr(deploy, "release_modes", release)
    monkeypatch.setattr(deploy, "_be_alone", lambda endpoint, slower: done.append("be alone"))
    monkeypatch.setattr(RobotSide, "run", run)
    endpoint = local_pair()[1]
    for code in (0, deploy.FAULT):
        _, pilot, _ = deploy._build(HEADER)
        options = deploy.DeployOptions(controller="hold", net=net, **words)
        assert deploy._deploy(options, pilot, robot, endpoint, None, local_pair) == code  # type: ignore[arg-type]
        assert done == steps
        done.clear()


def test_keys_ask_and_what_is_none_of_them_stops(monkeypatch) -> None:
    asked, typed = [], []
    monkeypatch.setattr(deploy, "_await_robot", lambda *_: None)
    monkeypatch.setattr(deploy, "listen", typed.append)
    monkeypatch.setattr(RobotSide, "run", lambda side: None)
    monkeypatch.setattr(RobotSide, "ask", lambda side, request: asked.append(request))
    options = deploy.DeployOptions(controller="hold", settings=Settings(dry_run=True))
    endpoint = local_pair()[1]
    deploy._deploy(options, deploy._build(HEADER)[1], load_robot("h1"), endpoint, None, lambda: endpoint)  # type: ignore[arg-type]
    for line in ("s", "run", "q", "", "x"):
        typed[0](line)
    assert asked == [Request.START, Request.RUN, Request.STOP, Request.STOP, Request.STOP]
