"""Objects and grippers as texts, beside the states and commands of a robot."""

import json

import numpy as np
import pytest
from deploy_bench import RecordedSide, Standing, bring_to, make_pilot
from local_endpoint import local_pair

from hugwbc import Command, Gait, load_robot
from hugwbc.deploy import recording
from hugwbc.deploy.capture import GRIPS, OBJECTS, Capture, CapturedWorld, grips_of, text_of_grips
from hugwbc.deploy.messages import Messages
from hugwbc.deploy.recording import Recording, replay
from hugwbc.deploy.simulated_robot import SimulatedRobot
from hugwbc.deploy.state_machine import Mode
from hugwbc.errors import CaptureError
from hugwbc.runtime import Constant
from hugwbc.scripts.view import Grip, View
from hugwbc.sim import Simulation
from hugwbc.sim.scenes import Box, Scene

H1 = load_robot()
POSE = [1.0, 0.2, 0.5, 1.0, 0.0, 0.0, 0.0]
SOUND = {"tick": 1500, "robot": POSE, "objects": {"parcel": POSE}, "held": [None, "parcel"]}


class Looker(Constant):
    """Stands still, and keeps what it sees."""

    def __init__(self) -> None:
        super().__init__(Command(gait=Gait.STANDING))
        object.__setattr__(self, "views", [])

    grips = (Grip("left", "parcel"),)

    def restart(self) -> None:
        self.views.clear()

    def see(self, view: View) -> None:
        self.views.append(view)


def test_a_capture_is_read_as_it_was_written() -> None:
    capture = Capture.of(json.dumps(SOUND))
    again = Capture.of(capture.text())
    assert again.time == pytest.approx(1.5) and again.names == ("parcel",) and again.held == (None, "parcel")
    np.testing.assert_allclose(again.poses, [POSE])
    np.testing.assert_allclose(again.robot, POSE)


@pytest.mark.parametrize(
    "changes",
    [
        {"tick": -1}, {"tick": "1"}, {"tick": 10**400}, {"tick": True}, {"robot": POSE[:6]}, {"robot": None},
        {"robot": [float("nan"), *POSE[1:]]}, {"robot": [1e400, *POSE[1:]]}, {"robot": [10**400, *POSE[1:]]},
        {"objects": []}, {"objects": {"parcel": [0.0] * 7}}, {"objects": {"parcel": "x"}}, {"held": [None]},
        {"held": [1, 2]}, {"robot": [200, 30, 980, 1, 0, 0, 0]}, {"more": 1},
        {"objects": {str(n): POSE for n in range(101)}}, {"objects": {"\ud800": POSE}}, {"held": [None, "a\nb"]},
    ],
)  # fmt: skip
def test_a_malformed_capture_is_refused(changes: dict[str, object]) -> None:
    with pytest.raises(CaptureError):
        Capture.of(json.dumps(SOUND | changes))


@pytest.mark.parametrize("text", ["", "[", "[]", "1", "{}", '{"tick": 1}', "[" * 5000, '"' + "x" * 40000 + '"'])
def test_what_is_no_capture_is_refused(text: str) -> None:
    for read in (Capture.of, grips_of):
        with pytest.raises(CaptureError):
            read(text)


def test_grips_are_read_as_they_were_written() -> None:
    grips = (Grip("left", "tray", hook=True, breaking_force=80.0), Grip("right", None))
    assert grips_of(text_of_grips(grips)) == grips
    assert grips_of('{"grips": [{"side": "left", "name": "tray"}]}') == (Grip("left", "tray"),)


@pytest.mark.parametrize(
    "grip",
    [
        1, {}, {"side": "left"}, {"side": "up", "name": None}, {"side": "left", "name": 1},
        {"side": "left", "name": "a", "hook": 1}, {"side": "left", "name": "a", "breaking_force": 0},
        {"side": "left", "name": "a", "breaking_force": float("inf")}, {"side": "left", "name": "a", "x": 1},
        {"side": "left", "name": "a", "breaking_force": True}, {"side": "left", "name": "a", "breaking_force": "9"},
        {"side": "left", "name": "\x1b[2J"},
    ],
)  # fmt: skip
def test_a_malformed_grip_is_refused(grip: object) -> None:
    with pytest.raises(CaptureError):
        grips_of(json.dumps({"grips": [grip]}))


def test_a_late_capture_does_not_replace_a_newer_one() -> None:
    world = CapturedWorld()
    assert world.picture() is None and world.names == () and world.held("left") is None
    world.take(Capture.of(json.dumps(SOUND)))
    world.take(Capture.of(json.dumps(SOUND | {"tick": 1400, "objects": {}})))
    world.advance(1.53)
    picture = world.picture()
    assert picture is not None and picture.age == pytest.approx(0.03)
    assert world.names == ("parcel",) and world.held("right") == "parcel"
    world.take(Capture.of(json.dumps(SOUND | {"tick": 10, "objects": {}})))  # of a robot that was restarted
    assert world.names == ()


def simulated() -> tuple[SimulatedRobot, object, list[str]]:
    told: list[str] = []
    robot_end, client = local_pair()
    client.texts(OBJECTS)
    box = Box(name="parcel", size=(0.2, 0.2, 0.2), mass=1.0, position=(1.0, 0.0, 0.1))
    simulation = Simulation(latency=0.0, seed=1, scene=Scene(objects=(box,)))
    return SimulatedRobot(simulation, robot_end, hoist=None, tell=told.append), client, told


def test_a_simulated_robot_says_where_its_objects_are() -> None:
    robot, client, _ = simulated()
    for _ in range(100):
        robot.send()
        robot.move()
    captures = [Capture.of(text) for text in client.texts(OBJECTS)]
    assert 16 <= len(captures) <= 19, "a picture every 10 ms, from 30 ms on"
    assert captures[-1].names == ("parcel",) and captures[-1].held == (None, None)
    assert robot.time - captures[-1].time == pytest.approx(0.03, abs=0.012)
    np.testing.assert_allclose(captures[-1].poses[0, :3], [1.0, 0.0, 0.1], atol=0.03)


def test_a_simulated_robot_hears_of_grips_and_refuses_nonsense() -> None:
    robot, client, told = simulated()
    client.publish(GRIPS, text_of_grips([Grip("left", "spoon")]))
    client.publish(GRIPS, "nonsense")
    robot.send()
    robot.move()
    assert robot.tally.counts == {"grips": 1} and "refused: grips" in told[0]
    assert any("spoon" in problem for problem in robot.simulation.objects.problems)


def test_a_behaviour_sees_what_was_captured(standing: Standing) -> None:
    source = Looker()
    pilot = make_pilot(source=source)
    bring_to(Mode.RUN, pilot, standing)
    pilot.see(Capture.of(json.dumps(SOUND | {"tick": standing.tick - 20})))
    message = standing.next()
    pilot.observe(message)
    view = source.views[-1]
    np.testing.assert_allclose(view.objects["parcel"].position, POSE[:3])
    assert view.objects["parcel"].age == pytest.approx(0.022, abs=1e-6)
    assert view.held == (None, "parcel") and pilot.grips == Looker.grips
    np.testing.assert_allclose(view.state.position[:2], POSE[:2], atol=0.01)
    pilot.observe(standing.next(), fault="a fault")
    assert pilot.grips == ()


def test_a_run_among_objects_is_replayed_bit_for_bit(tmp_path, standing, jumping_pilot):
    source, again = Looker(), Looker()
    run = RecordedSide(tmp_path / "run.bin", standing, source)
    run.robot_end.texts(GRIPS)
    for index in range(20):
        run.robot_end.publish(OBJECTS, json.dumps(SOUND | {"tick": standing.tick}))
        if index == 3:
            run.robot_end.publish(OBJECTS, "nonsense")
        run.slot()
    run.recorder.close()
    assert run.side.pilot.mode is Mode.RUN and run.side.captures.counts["refused"] == 1 and len(run.told) == 1
    assert [grips_of(text) for text in run.robot_end.texts(GRIPS)] == [Looker.grips] * 20
    file = Recording(tmp_path / "run.bin")
    assert sum(entry.kind == recording.SEEN for entry in file.entries()) == 20
    result = replay(file, make_pilot(source=again), Messages(H1), 0.0)
    assert result.different == 0 and result.states == 52
    np.testing.assert_array_equal(again.views[-1].state.position, source.views[-1].state.position)
    np.testing.assert_array_equal(again.views[-1].objects["parcel"].position, POSE[:3])


@pytest.mark.parametrize("y_up", [False, True])
def test_a_capture_with_y_up_is_refused_in_the_log_and_not_looked_at(standing, y_up) -> None:
    source, rng = Looker(), np.random.default_rng(0)
    pilot = make_pilot(source=source)
    bring_to(Mode.RUN, pilot, standing)
    turn = np.array([np.sqrt(0.5), -np.sqrt(0.5), 0.0, 0.0]) if y_up else np.array([1.0, 0.0, 0.0, 0.0])
    box = np.array([[1.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0]])
    for _ in range(250):
        state = standing.next()
        robot = np.append(np.add((3.0, 2.0, 1.0), rng.normal(0.0, 0.002, 3)), turn)
        pilot.see(Capture(state.state.time - 0.01, robot, ("box",), box, (None, None)))
        pilot.observe(state)
    view = source.views[-1]  # type: ignore[attr-defined]
    told = [str(event) for event in pilot.machine.events if "motion capture" in event.reason]
    assert len(told) == y_up and all("run: motion capture refused" in line and "y up" in line for line in told)
    assert (view.objects.keys() == {"box"}) is not y_up
    assert bool(np.linalg.norm(view.position[:2] - [3.0, 2.0]) < 0.05) is not y_up
    assert pilot.mode is Mode.RUN
