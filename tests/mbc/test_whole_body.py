"""The controller as others see it: fallbacks, counts, symmetry, and limits, without a simulation."""

import collections
import dataclasses
import functools
import math

import numpy as np
import pytest
import yaml

from hugwbc import Command, Gait, UpperBody, load_robot, rotations
from hugwbc.commands import MEASURED_NAMES
from hugwbc.errors import ConfigError
from hugwbc.mbc import ControllerParams, QpStatus, WholeBodyController
from hugwbc.mbc.gait_plan import Mode
from hugwbc.mbc.rigid_body_mpc import RigidBodyMpc
from hugwbc.robot import load_mirror
from hugwbc.robot_tables import robot_table
from hugwbc.runtime import rollout
from hugwbc.runtime.guard import Guard
from hugwbc.runtime.safety import SafetyFilter, StateCheck
from hugwbc.runtime.safety_report import SafetyLog
from hugwbc.sim import Simulation
from hugwbc.state import RobotState
from tests.conftest import make_state, mirror_command, mirror_state

ROBOT = load_robot()
NONE = UpperBody.none()


@pytest.fixture
def controller(standing_state):
    """A controller that begins with the standing robot."""
    controller = WholeBodyController(load_robot())
    controller.reset(standing_state)
    return controller


def _total_torque(joint_command, state):
    gain = joint_command.kp * (joint_command.q - state.q) + joint_command.kd * (joint_command.dq - state.dq)
    return joint_command.tau + gain


@pytest.mark.parametrize("period", [0.0, -0.002, math.nan, math.inf, 4.0])  # milliseconds
def test_a_period_that_is_no_time_is_refused(period):
    with pytest.raises(ConfigError, match="give a finite time above 0"):
        WholeBodyController(load_robot(), period=period)


def test_a_state_without_position_or_velocity_is_refused(controller, standing_state):
    for lacking in ("position", "velocity"):
        state = dataclasses.replace(standing_state, **{lacking: None})
        for call in (controller.reset, functools.partial(controller.act, command=Command(), upper_body=NONE)):
            with pytest.raises(ConfigError, match="complete it with a"):
                call(state)


@pytest.mark.parametrize("name", ["position", "q", "foot_force", "hand_force"])
def test_nothing_of_a_state_that_is_not_usable_stays(controller, standing_state, name):
    seen = dataclasses.replace(standing_state, foot_force=np.full((2, 3), 290.0), hand_force=np.full((2, 3), 30.0))
    expected = [controller.act(seen, Command(), NONE).tau for _ in range(3)][-1]
    controller.reset(seen)
    broken = dataclasses.replace(seen, **{name: np.full_like(getattr(seen, name), math.nan)})
    assert controller.act(broken, Command(), NONE) is None
    assert controller.diagnostics.fallbacks == 1 and controller.diagnostics.status is QpStatus.FAILED
    taus = [controller.act(seen, Command(), NONE).tau for _ in range(3)]
    assert controller.diagnostics.status is QpStatus.SOLVED
    assert taus[-1] == pytest.approx(expected, abs=1e-6)


def test_the_guard_holds_and_damps_while_the_qp_has_no_solution(controller, standing_state, monkeypatch):
    log = SafetyLog()
    guard = Guard(controller, StateCheck(ROBOT), SafetyFilter(ROBOT, log), log)
    guard.reset(standing_state)
    last = guard.act(standing_state, Command(), NONE)
    monkeypatch.setattr(controller._qp, "solve", lambda *_: controller._unsolved)
    commands = [guard.act(standing_state, Command(), NONE) for _ in range(26)]
    assert controller.planned_acceleration is None
    np.testing.assert_array_equal(commands[23].q, last.q)
    assert not commands[25].kp.any() and np.array_equal(commands[25].kd, ROBOT.kd)
    report = log.report()
    assert (report.held, report.damped, report.failures) == (24, 2, 0)  # 25 periods add up to a little more than 0.1 s
    assert "no joint command from qp: holding the last one" in report.messages[0]
    monkeypatch.undo()
    assert guard.act(standing_state, Command(), NONE).tau.any(), "a reset, and it goes on"


def test_standing_still_it_carries_the_weight(controller, standing_state):
    for _ in range(3):
        command = controller.act(standing_state, Command(), NONE)
    diagnostics = controller.diagnostics
    assert diagnostics.status is QpStatus.SOLVED
    assert sum(force[2] for force in diagnostics.contact_forces.values()) == pytest.approx(ROBOT.mass * 9.81, rel=0.05)
    # The knees bear the load, alike on both sides.
    knees = command.tau[ROBOT.indices(["left_knee_joint", "right_knee_joint"])]
    assert np.all(knees < -20.0)
    assert knees[0] == pytest.approx(knees[1], rel=0.1)


@pytest.mark.parametrize("name", ["h1", "h1-2023"])
def test_it_believes_the_robot_that_it_is_told(standing_state, name):
    told = load_robot(name)
    controller = WholeBodyController(robot=told)
    controller.reset(standing_state)
    for _ in range(3):
        controller.act(standing_state, Command(), NONE)
    weight = sum(force[2] for force in controller.diagnostics.contact_forces.values())
    assert controller.robot is told and weight == pytest.approx(told.mass * 9.81, rel=0.05)


def test_it_says_where_the_foot_in_the_air_is_to_land(standing_state):
    controller = WholeBodyController(load_robot())
    assert np.isnan(controller.footholds).all()
    controller.reset(standing_state)
    walk = Command(v_x=0.5, gait=Gait.WALKING)
    for _ in range(1000):
        controller.act(standing_state, walk, NONE)
        if controller.diagnostics.swing is not None:
            break
    swing = ("left", "right").index(controller.diagnostics.swing)
    assert np.isfinite(controller.footholds[swing]).all()
    assert np.isnan(controller.footholds[1 - swing]).all()


def test_in_a_jump_both_feet_have_footholds_in_flight_and_none_in_stance(controller, standing_state):
    seen = []
    for _ in range(480):  # by the clock alone, past the first flight
        controller.act(standing_state, Command(gait=Gait.JUMPING), NONE)
        seen.append((controller.phase >= 0.5, bool(np.isfinite(controller.footholds).all())))
    assert [flight for flight, _ in seen] == [planned for _, planned in seen]
    assert [seen[0][0], seen[-1][0]] == [False, False] and any(flight for flight, _ in seen)


def test_it_counts_footholds_out_of_reach(controller, standing_state):
    counts = []
    for speed in (0.0, 4.0):
        moving = dataclasses.replace(standing_state, velocity=np.array([speed, 0.0, 0.0]))
        for _ in range(350):
            controller.act(moving if controller.diagnostics.swing else standing_state, Command(gait=Gait.WALKING), NONE)
        counts.append(controller.diagnostics.out_of_reach)
    assert counts[0] == 0 and counts[1] > 300
    controller.reset(standing_state)
    controller.act(standing_state, Command(), NONE)
    assert controller.diagnostics.out_of_reach == 0


def test_it_counts_force_plans_that_failed(controller, standing_state, monkeypatch):
    monkeypatch.setattr(RigidBodyMpc, "_run", lambda *_: None)
    for _ in range(51):  # the first tick finds that the robot stands still; 0.2 s of stance, a plan every 8 ms
        controller.act(standing_state, Command(gait=Gait.JUMPING), NONE)
    diagnostics = controller.diagnostics
    assert diagnostics.mode is Mode.LEAPING and diagnostics.failed_plans == 25
    assert diagnostics.status is QpStatus.SOLVED
    vertical = [force[2] for force in diagnostics.contact_forces.values()]
    assert sum(vertical) == pytest.approx(ROBOT.mass * 9.81, rel=0.2), "an even push instead"


@pytest.mark.parametrize("gait", [Gait.WALKING, Gait.JUMPING, Gait.HOPPING_LEFT], ids=lambda gait: gait.label)
def test_a_second_episode_begins_as_the_first_one_did(standing_state, gait):
    """After a walk, a jump or the shift for a hop, by the clock, arms taken over, a push to catch, loads and slips."""
    load, used = np.array([[0.0, 0.0, 290.0]] * 2), WholeBodyController(load_robot())
    used.reset(standing_state)
    arms = UpperBody.targets(np.full(8, 0.3))
    for tick in range(500):
        velocity, pull = np.array([0.0, 1.5 * (tick > 300), 0.0]), np.full((2, 3), 30.0)
        pushed = dataclasses.replace(standing_state, velocity=velocity, foot_force=load, hand_force=pull)
        used.act(pushed, Command(v_x=0.3, h=-0.1, w=0.5, gait=gait), arms)
    assert gait is not Gait.WALKING or used.diagnostics.friction < 0.7, "there is something to forget"
    loaded = dataclasses.replace(standing_state, foot_force=load, hand_force=np.zeros((2, 3)))
    outputs = []
    for controller in (WholeBodyController(load_robot()), used):
        controller.reset(loaded)
        outputs.append(np.array([controller.act(loaded, Command(gait=Gait.WALKING), NONE).tau for _ in range(150)]))
    assert np.array_equal(*outputs)


def test_absurd_states_in_a_jump_give_finite_torques_within_the_limits(standing_state):
    rng = np.random.default_rng(1)
    controller = WholeBodyController(load_robot())
    jump, solved = Command(gait=Gait.JUMPING), collections.Counter[float]()
    for scale in (0.1, 1.0, 10.0, 1e3):
        controller.reset(standing_state)
        for _ in range(2):  # the first one finds that the robot stands still
            controller.act(standing_state, jump, NONE)
        assert controller.diagnostics.mode is Mode.LEAPING
        for _ in range(4):
            orientation, sizes = rng.normal(size=4), {"dq": 19, "angular_velocity": 3, "position": 3, "velocity": 3}
            fields = {name: scale * rng.normal(size=size) for name, size in sizes.items()}
            turned = orientation / np.linalg.norm(orientation)
            state = make_state(scale * rng.normal(size=19), orientation=turned, **fields)
            command = controller.act(state, jump, NONE)
            if command is not None:
                solved[scale] += 1
                assert command.is_finite
                assert np.all(np.abs(command.tau) <= 0.95 * ROBOT.torque_limit + 1e-9)
    assert solved[0.1] == 4, "states in which a robot may be"


def test_mirrored_state_and_command_give_mirrored_torques(symmetric_model, standing_state, monkeypatch):
    rng = np.random.default_rng(3)
    mirror = load_mirror(load_robot())
    # A tight tolerance, so that the two optima are the same number and not only the same within the solver's.
    params = ControllerParams(qp_tolerance=1e-10)
    command = Command(h=-0.1, p=0.2, w=0.4)
    monkeypatch.setattr("hugwbc.kinematics.pinocchio_model", lambda _: symmetric_model)
    for _ in range(5):
        state = dataclasses.replace(
            standing_state,
            q=standing_state.q + rng.uniform(-0.05, 0.05, 19),
            dq=rng.uniform(-0.2, 0.2, 19),
            orientation=rotations.from_yaw_pitch_roll(0.3, 0.05, 0.02),
            angular_velocity=rng.uniform(-0.1, 0.1, 3),
            velocity=rng.uniform(-0.1, 0.1, 3),
        )
        arms = UpperBody.targets(rng.uniform(-0.3, 0.3, 8), rng.uniform(-0.5, 0.5, 8))
        torques, other_arms = [], UpperBody.targets(mirror.arms(arms.q, ROBOT), mirror.arms(arms.dq, ROBOT))
        for s, c, u in ((state, command, arms), (mirror_state(state, mirror), mirror_command(command), other_arms)):
            controller = WholeBodyController(load_robot(), params)
            controller.reset(s)
            torques.append(controller.act(s, c, u).tau)
            assert controller.diagnostics.status is QpStatus.SOLVED
        assert mirror.joints(torques[0]) == pytest.approx(torques[1], abs=1e-6)


def test_the_joint_pd_adds_nothing_on_average_along_the_planned_motion(standing_state):
    controller = WholeBodyController(load_robot(), period=0.01)
    moving = dataclasses.replace(standing_state, dq=np.full(19, 0.3))
    controller.reset(moving)
    command = controller.act(moving, Command(), NONE)
    acceleration = (command.dq - moving.dq) / 0.005
    torques = []
    for t in np.linspace(0.0, 0.01, 101):
        later = dataclasses.replace(moving, q=moving.q + moving.dq * t, dq=moving.dq + acceleration * t)
        torques.append(_total_torque(command, later) - command.tau)
    assert np.mean(torques, axis=0) == pytest.approx(np.zeros(19), abs=1e-6)


def _turned(state: RobotState, yaw: float) -> RobotState:
    to_world = rotations.rotation_z(yaw)
    orientation = rotations.multiply(rotations.from_yaw_pitch_roll(yaw, 0.0, 0.0), state.orientation)
    world = {name: getattr(state, name) @ to_world.T for name in ("position", "velocity", "foot_force", "hand_force")}
    return dataclasses.replace(state, orientation=orientation, **world)


@pytest.mark.parametrize("yaw", [0.5, 2.5])
def test_what_it_does_is_the_same_in_all_directions(yaw):
    class Recorder(WholeBodyController):
        def act(self, state, command, upper_body):
            states.append(dataclasses.replace(state, hand_force=np.zeros((2, 3))))
            return super().act(state, command, upper_body)

    states, walk = list[RobotState](), Command(v_x=0.5, omega=0.6, gait=Gait.WALKING)
    rollout(Recorder(ROBOT), walk, Simulation(seed=5), duration=1.0)
    torques = []
    for turn in (0.0, yaw):
        controller = WholeBodyController(ROBOT)
        controller.reset(_turned(states[0], turn))
        torques.append([controller.act(_turned(state, turn), walk, NONE).tau for state in states])
    differences = np.abs(np.subtract(*torques)).max(axis=1)
    # A tick or two may end at another of several solutions that are equally good.
    assert np.median(differences) < 1e-4 and (differences > 0.01).mean() < 0.03


def test_a_right_hip_that_yaws_about_the_opposite_axis_gives_the_opposite_torque_in_a_turning_jump(tmp_path):
    table = {**robot_table(), "drives": []}  # the joints have their figures
    del table["interface"], table["name"]
    joint = next(joint for joint in table["joints"] if joint["name"] == "right_hip_yaw_joint")
    joint["axis"] = [0, 0, -1]
    (tmp_path / "turned.yaml").write_text(yaml.safe_dump(table, sort_keys=False))
    jump, torques = Command(omega=0.4, gait=Gait.JUMPING), []
    for robot in (ROBOT, load_robot(str(tmp_path / "turned.yaml"))):
        simulation = Simulation(sensing="exact", robot=robot)
        torques.append(rollout(WholeBodyController(robot), jump, simulation, duration=0.1).torque)
    hip = ROBOT.index(joint["name"])
    assert np.abs(torques[0][:, hip]).max() > 1.0
    assert torques[1][:, hip] == pytest.approx(-torques[0][:, hip], abs=1e-3)


def test_a_robot_with_ankle_rolls_and_held_joints_walks():
    """The G1: six rows for a foot, and a waist roll and pitch that stay where they are."""
    robot = load_robot("g1")
    walk = Command(v_x=0.5, gait=Gait.WALKING, l=0.1)
    trace = rollout(WholeBodyController(robot), walk, Simulation(sensing="exact", robot=robot), duration=4.0)
    assert not trace.fell and trace.measured[len(trace.time) // 2 :, 0].mean() == pytest.approx(0.5, abs=0.03)
    held = trace.qpos[:, 7:][:, robot.held] - robot.nominal[robot.held]
    assert robot.held.size == 2 and np.abs(held).max() < 0.1


def test_a_foot_whose_ankle_rolls_hops_on_the_middle_of_its_sole():
    """The G1: as if on the outer edge, as the H1 does, it drifts aside at 0.3 m/s and yaws."""
    robot = load_robot("g1")
    hop = Command(v_x=0.3, gait=Gait.HOPPING_LEFT)
    trace = rollout(WholeBodyController(robot), hop, Simulation(sensing="exact", robot=robot), duration=4.0)
    assert not trace.fell
    assert trace.measured[len(trace.time) // 2 :, :2].mean(axis=0) == pytest.approx([0.3, 0.0], abs=0.06)


def test_a_trunk_on_a_waist_of_little_torque_yields_to_the_push_off_of_a_jump():
    """The G1: with its trunk held level it takes off with too much pitch, which grows to 0.35 rad until it lands."""
    robot = load_robot("g1")
    jump = Command(v_x=0.3, gait=Gait.JUMPING)
    trace = rollout(WholeBodyController(robot), jump, Simulation(sensing="exact", robot=robot), duration=1.6)
    assert np.abs(trace.measured[:, MEASURED_NAMES.index("p")]).max() < 0.25
