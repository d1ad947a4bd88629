"""The way down onto the knees: its course, its choice of the leg that brakes, and how softly it ends in simulation."""

import dataclasses

import numpy as np
import pytest

from hugwbc import load_robot
from hugwbc.kinematics import Kinematics
from hugwbc.robot import SIDES
from hugwbc.runtime.lowering import Lowering, swings_left
from hugwbc.sim import Simulation

H1 = load_robot()
STILL = Simulation().state()
PERIOD = 0.002


def descent(state, duration):
    lowering = Lowering(H1)
    return [lowering.command(state, PERIOD) for _ in range(round(duration / PERIOD))]


def test_the_higher_ankle_is_that_of_the_leg_that_swings():
    kinematics, rng = Kinematics(H1), np.random.default_rng(0)
    for _ in range(50):
        q = H1.nominal.copy()
        for side in SIDES:
            q[H1.indices([f"{side}_hip_pitch_joint", f"{side}_knee_joint"])] = rng.uniform((-0.9, 0.1), (0.3, 1.5))
        kinematics.update(dataclasses.replace(STILL, q=q, orientation=np.array([1.0, 0.0, 0.0, 0.0])))
        left, right = (kinematics.position(f"{side}_sole")[2] for side in SIDES)
        ankles = [
            np.cos(q[H1.indices([f"{side}_hip_pitch_joint", f"{side}_knee_joint"])].cumsum()).sum() for side in SIDES
        ]
        assert swings_left(H1, q) == (ankles[0] < ankles[1])
        if abs(left - right) > 0.1:  # the sole's centre lies away from the ankle's axis
            assert swings_left(H1, q) == (left > right)


def test_the_way_down_mirrors_with_the_leg_that_swings():
    lifted = {}
    for side in SIDES:
        q = H1.nominal.copy()
        q[H1.index(f"{side}_knee_joint")] += 0.4
        lifted[side] = descent(dataclasses.replace(STILL, q=q), 0.5)[-1].q
    for name in ("hip_pitch", "knee", "ankle"):
        left, right = H1.index(f"left_{name}_joint"), H1.index(f"right_{name}_joint")
        assert lifted["left"][left] == pytest.approx(lifted["right"][right])
        assert lifted["left"][right] == pytest.approx(lifted["right"][left])


def test_commands_are_continuous_within_the_ranges_and_end_in_damping():
    commands = descent(dataclasses.replace(STILL, q=np.full(19, np.nan)), 4.0)
    q = np.array([command.q for command in commands])
    assert np.isfinite(q).all() and (q >= H1.lower).all() and (q <= H1.upper).all()
    np.testing.assert_allclose(q[0], H1.nominal, atol=0.01)
    assert np.abs(np.diff(q, axis=0)).max() / PERIOD < H1.velocity_limit.max()
    kp, kd = (np.array([getattr(command, name)[0] for command in commands]) for name in ("kp", "kd"))
    assert (np.diff(kp) <= 1e-9).all() and kp[500] > 0.0 and kp[-1] == 0.0
    assert (np.diff(kd) >= -1e-9).all() and kd[-1] > 2.0 * H1.kd[0]


def test_a_standing_robot_comes_to_rest_near_the_ground():
    simulation, lowering = Simulation(), Lowering(H1)
    state = simulation.state()
    for _ in range(round(4.0 / PERIOD)):
        state = simulation.step(lowering.command(simulation.sense(), PERIOD), PERIOD)
    assert state.position is not None and state.velocity is not None
    assert not simulation.diverged and state.position[2] < 0.6
    assert np.linalg.norm(state.velocity) < 0.2 and np.abs(state.dq).max() < 1.0
