"""Hands of the steady frame: what is learned of a body that sways, turns and walks on."""

import dataclasses

import numpy as np
import pytest
import yaml

from hugwbc import rotations
from hugwbc.commands import Command
from hugwbc.gait import Gait
from hugwbc.kinematics import Kinematics
from hugwbc.robot import load_robot
from hugwbc.robot_tables import robot_table
from hugwbc.state import GRAVITY
from hugwbc.targets import HandTargets
from hugwbc.upper_ik import UpperBodySource
from hugwbc.upper_ik.steady_hands import LAG, SteadyHands
from tests.conftest import make_state

POINTS = np.array([[0.35, 0.2, 0.15], [0.35, -0.2, 0.15]])
TARGETS = HandTargets.of(*POINTS, "steady")
WALK = Command(v_x=0.5, f=2.0, gait=Gait.WALKING)
DT = 0.002
TURN = 2.0 * np.pi * WALK.f


def swaying(t, yaw=0.0, rate=0.0):
    """A pelvis that walks ahead at 0.5 m/s and sways sideways and up and down, as the gait does; also its velocity."""
    axes = rotations.rotation_z(yaw)
    sway = np.array([0.5 * t, 0.02 * np.sin(TURN * t), 1.0 + 0.01 * np.cos(2.0 * TURN * t)])
    return make_state(yaw=yaw + rate * t, position=axes @ sway, time=t)


def run(seconds, read, command=WALK, dt=DT, targets=TARGETS):
    """Return the true hands in the world at each tick, shape (n, 2, 3), for arms that follow their targets at once."""
    steady, world, wanted = SteadyHands(load_robot()), [], []
    for tick in range(round(seconds / dt)):
        state = read(tick * dt)
        # The hand reaches a target after LAG and a period; what is measured now was wanted then.
        late = round((LAG + dt) / dt)
        hands = wanted[-late] if len(wanted) >= late else POINTS
        world.append(state.position + hands @ rotations.to_matrix(state.orientation).T)
        wanted.append(steady.place(targets, hands, state, command, dt).array())
    return np.array(world), steady


def swing(world):
    """The largest departure from a straight line in the last two strides [m]."""
    last = world[-round(1.0 / DT) :].reshape(-1, 6)
    line = np.linspace(0.0, 1.0, len(last))
    return max(np.abs(column - np.polyval(np.polyfit(line, column, 1), line)).max() for column in last.T)


def test_a_sway_that_repeats_is_cancelled():
    world, _ = run(6.0, lambda t: swaying(t, 2.0))
    assert swing(world[: round(0.6 / DT)]) > 0.015
    assert swing(world) < 0.002


def test_the_accelerometer_tells_the_sway_without_a_position():
    def read(t):
        sway = swaying(t)
        acceleration = np.array(
            [0.0, -0.02 * TURN**2 * np.sin(TURN * t), -0.01 * (2 * TURN) ** 2 * np.cos(2 * TURN * t)]
        )
        return dataclasses.replace(sway, imu_accelerometer=acceleration + np.array([0.0, 0.0, GRAVITY]))

    steady = SteadyHands(load_robot())
    wanted = [POINTS] * 3
    for tick in range(round(6.0 / DT)):
        state = dataclasses.replace(read(tick * DT), position=None)
        wanted.append(steady.place(TARGETS, wanted[-3], state, WALK, DT).array())
    t = np.arange(round(6.0 / DT)) * DT
    truth = np.array([swaying(now).position for now in t])[:, None] + np.array(wanted)[: len(t)]
    assert swing(truth) < 0.002


def test_the_hands_are_seen_from_the_imu_of_a_trunk_that_turns_above_the_pelvis(tmp_path):
    table = {**robot_table(), "drives": []}  # the joints have their figures
    del table["interface"], table["name"]
    waist = next(joint for joint in table["joints"] if joint["name"] == "torso_joint")
    waist["xyz"] = [-0.02, 0.0, 0.1]
    (tmp_path / "tall.yaml").write_text(yaml.safe_dump(table, sort_keys=False))
    robot = load_robot(str(tmp_path / "tall.yaml"))
    q = robot.nominal.copy()
    q[robot.waist] = 0.6
    state = make_state(q, yaw=0.3, pitch=0.4, roll=-0.2, position=np.zeros(3))
    kinematics, steady = Kinematics(robot), SteadyHands(robot)
    kinematics.update(state)
    hands = np.array([kinematics.position(f"{side}_hand") for side in ("left", "right")])
    in_pelvis = hands @ rotations.to_matrix(state.orientation)
    felt = dataclasses.replace(state, position=None, imu_accelerometer=np.array([0.0, 0.0, GRAVITY]))
    steady.place(TARGETS, in_pelvis, felt, WALK, DT)
    assert steady._past[-1, :6].reshape(2, 3) == pytest.approx(hands - kinematics.position("imu"))


def test_the_mean_speed_and_height_are_kept():
    world, _ = run(6.0, swaying)
    strides = world[-round(1.0 / DT) :].reshape(2, -1, 2, 3).mean(axis=1)
    assert strides[1] - strides[0] == pytest.approx(np.tile((0.25, 0.0, 0.0), (2, 1)), abs=0.002)
    assert strides[1, :, 2] == pytest.approx(1.15, abs=0.002)
    assert strides[1, :, 1] == pytest.approx([0.2, -0.2], abs=0.002)


def test_the_targets_turn_with_the_heading():
    state = swaying(0.0, yaw=1.0)
    assert SteadyHands(load_robot()).place(TARGETS, POINTS, state, WALK, DT).array() == pytest.approx(POINTS)


def test_a_lasting_lean_is_taken_out():
    lean = rotations.from_yaw_pitch_roll(0.3, 0.2, -0.1)
    state = dataclasses.replace(swaying(0.0), orientation=lean)
    ahead = dataclasses.replace(TARGETS, left_direction=np.array([1.0, 0.0, 0.0]))
    placed = SteadyHands(load_robot()).place(ahead, POINTS, state, Command(), DT)
    level = rotations.rotation_z(0.3).T @ rotations.to_matrix(lean)
    assert placed.array() @ level.T == pytest.approx(POINTS)
    assert level @ placed.left_direction == pytest.approx([1.0, 0.0, 0.0])
    assert placed.frame == "pelvis"


def test_a_motion_of_the_targets_is_not_cancelled():
    steady, hands = SteadyHands(load_robot()), POINTS
    for tick in range(2000):
        move = 0.03 * np.sin(TURN * tick * DT) * np.array([1.0, 0.0, 0.0])
        targets = HandTargets(*(POINTS + move), "steady")
        still = dataclasses.replace(swaying(tick * DT), position=np.zeros(3))
        placed = steady.place(targets, hands, still, WALK, DT).array()
        hands = placed
    assert placed == pytest.approx(POINTS + move, abs=0.002)


def test_a_stand_forgets():
    _, steady = run(4.0, swaying)
    assert np.abs(steady.correction).max() > 0.005
    for tick in range(2000):
        steady.place(TARGETS, POINTS, swaying(4.0 + tick * DT), Command(), DT)
    assert np.abs(steady.correction).max() < 1e-4


def test_bad_numbers_do_no_harm():
    steady = SteadyHands(load_robot())
    for value in (np.nan, np.inf, 1e300):
        bad = dataclasses.replace(swaying(0.0), position=np.full(3, value))
        for command in (WALK, dataclasses.replace(WALK, f=value)):
            for dt in (DT, 0.0, np.nan):
                steady.place(TARGETS, POINTS * value, bad, command, dt)
    for tick in range(600):
        placed = steady.place(TARGETS, POINTS, swaying(tick * DT), WALK, DT)
    assert placed.is_usable
    assert np.abs(steady.correction).max() <= 0.05


def test_the_source_takes_the_frame():
    source = UpperBodySource(load_robot())
    state = swaying(0.0)
    for _ in range(100):
        arms, _ = source.update(state, TARGETS, Command(), 0.01)
    assert source.solution is not None and source.solution.residual.max() < 0.01
    lost = dataclasses.replace(state, q=np.full(19, np.nan))
    arms, _ = source.update(lost, TARGETS, Command(), 0.01)
    assert np.isfinite(arms.q).all()


def test_the_stride_is_that_of_the_command_that_is_followed(monkeypatch):
    source, told = UpperBodySource(load_robot()), []
    place = source._steady.place
    monkeypatch.setattr(source._steady, "place", lambda *given: told.append(given[3]) or place(*given))
    for followed in (WALK, None):
        source.update(swaying(0.0), TARGETS, Command(), 0.01, None, followed)
    assert told == [WALK, Command()]


@pytest.mark.parametrize("between", [None, HandTargets(None, None, joints=np.zeros(8))], ids=["nothing", "joints"])
def test_what_was_learned_before_a_pause_is_forgotten(between):
    """Nobody knows where in the stride the robot is when the targets come back."""
    source, still = UpperBodySource(load_robot()), swaying(0.0)
    for tick in range(300):
        source.update(swaying(0.01 * tick), TARGETS, WALK, 0.01)
    source.update(still, between, WALK, 0.01)
    for _ in range(40):  # less than a stride: nothing is learned yet
        source.update(still, TARGETS, WALK, 0.01)
    assert source.ik.hands(source.ik.q, 0.0) == pytest.approx(POINTS, abs=0.005)
