"""The way down onto the knees: its course, and its end in simulation."""

import dataclasses

import numpy as np
import pytest

from hugwbc import load_robot
from hugwbc.robot import load_mirror
from hugwbc.runtime.lowering import _PLANT_TIME, _STANDING, _SWINGING, Lowering
from hugwbc.sim import Simulation

H1 = load_robot()
STILL = Simulation(sensing="exact").state()
PERIOD = 0.002


def descent(state, duration):
    lowering = Lowering(H1)
    return [lowering.command(state, PERIOD) for _ in range(round(duration / PERIOD))]


def test_commands_are_continuous_within_the_ranges_and_end_in_damping():
    commands = descent(dataclasses.replace(STILL, q=np.full(19, np.nan)), 4.0)
    q = np.array([command.q for command in commands])
    assert np.isfinite(q).all() and (q >= H1.lower).all() and (q <= H1.upper).all()
    np.testing.assert_allclose(q[0], H1.nominal, atol=0.01)
    assert np.abs(np.diff(q, axis=0)).max() < 0.2, "the moves are fast, but no steps"
    kp, kd = (np.array([getattr(command, name)[0] for command in commands]) for name in ("kp", "kd"))
    assert (np.diff(kp) <= 1e-9).all() and kp[500] > 0.0 and kp[-1] == 0.0
    assert (np.diff(kd) >= -1e-9).all() and kd[-1] > 2.0 * H1.kd[0]


@pytest.mark.parametrize("name", ["h1", "g1"])
def test_a_standing_robot_comes_to_rest_near_the_ground(name):
    robot = load_robot(name)
    simulation, lowering = Simulation(sensing="exact", robot=robot), Lowering(robot)
    state = simulation.state()
    for _ in range(round(4.0 / PERIOD)):
        state = simulation.step(lowering.command(simulation.sense(), PERIOD), PERIOD)
    assert state.position is not None and state.velocity is not None
    assert not simulation.diverged and state.position[2] < 0.6 * robot.nominal_height
    assert np.linalg.norm(state.velocity) < 0.2 and np.abs(state.dq).max() < 1.0


def test_rolls_about_opposite_axes_on_the_right_go_outwards_too():
    right = H1.indices(["right_hip_roll_joint", "right_shoulder_roll_joint"])
    axes, lower, upper, nominal = H1.axes.copy(), H1.lower.copy(), H1.upper.copy(), H1.nominal.copy()
    axes[right], nominal[right] = -axes[right], -nominal[right]
    lower[right], upper[right] = -H1.upper[right], -H1.lower[right]
    base_axes = np.where(np.isin(np.arange(H1.kp.size), right)[:, None], -1.0, 1.0) * H1.base_axes
    turned = dataclasses.replace(H1, axes=axes, base_axes=base_axes, lower=lower, upper=upper, nominal=nominal)
    lowering, state = Lowering(turned), dataclasses.replace(STILL, q=nominal)
    q = [lowering.command(state, PERIOD).q for _ in range(400)]
    np.testing.assert_allclose(q[-1], load_mirror(turned).joints(q[-1]), atol=1e-9)
    assert q[-1][H1.pair("hip_roll")] == pytest.approx([-0.15, -0.15])


@pytest.mark.parametrize("loaded", [0, 1])
def test_it_begins_where_the_joints_are_and_stands_on_the_loaded_leg(loaded):
    bent, load = H1.nominal + 0.1, np.zeros((2, 3))
    load[loaded, 2] = 500.0
    lowering, state = Lowering(H1), dataclasses.replace(STILL, q=bent, foot_force=load)
    np.testing.assert_allclose(lowering.command(state, 1e-6).q, bent, atol=1e-3)
    planted = lowering.command(state, _PLANT_TIME).q[lowering._legs]
    expected = np.stack((_STANDING, _SWINGING) if loaded == 0 else (_SWINGING, _STANDING), axis=1)
    expected[3, 1] *= -1.0  # rolls are outwards
    np.testing.assert_allclose(planted, expected, atol=1e-3)
