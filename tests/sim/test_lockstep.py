import numpy as np
import pytest

from hugwbc.controller import JointCommand
from hugwbc.robot import load_robot
from hugwbc.sim import Actuators, Simulation, Variation
from hugwbc.sim.engine import FALL_HEIGHT, FALL_PITCH, FALL_ROLL
from hugwbc.sim.lockstep import LockstepSimulation
from hugwbc.sim.robot_model import load_model

VARIATIONS = [Variation(), Variation(payload=3.0, gain=1.1), Variation(friction=0.4, strength=0.9), Variation()]


@pytest.mark.parametrize(
    ("timestep", "name", "actuators"),
    [
        (0.002, "h1", Actuators.ideal()),
        (0.005, "h1", Actuators.ideal()),
        (0.002, "h1-2023", Actuators.ideal()),
        (0.002, "h1", Actuators()),
        (0.005, "h1", Actuators(delay=0.01)),
    ],
)
def test_each_robot_moves_as_one_alone(timestep, name, actuators):
    robot, rng = load_robot(name), np.random.default_rng(0)
    options = {"robot": robot, "actuators": actuators, "timestep": timestep}
    n = len(VARIATIONS)
    kp, kd = np.tile(robot.kp, (n, 1)), np.tile(robot.kd, (n, 1))
    kp[3, robot.arms] *= 0.5
    many = LockstepSimulation(VARIATIONS, kp, kd, **options)
    alone = [Simulation(variation=variation, **options) for variation in VARIATIONS]
    rows = np.arange(n)
    for tick in range(60):
        q, dq = robot.nominal + 0.3 * rng.standard_normal((n, 19)), 0.1 * rng.standard_normal((n, 19))
        if tick == 20:
            many.forces[1, many.model.body("torso_link").id, :3] = [100.0, 50.0, 0.0]
            alone[1].apply_force(np.array([100.0, 50.0, 0.0]), 10.0)
        if tick == 40:
            rows = rows[rows != 2]
        many.command(rows, q[rows], dq[rows])
        for _ in range(2):
            many.step(rows)
        for row in rows:
            alone[row].step(JointCommand(q[row], dq[row], kp[row], kd[row], np.zeros(19)), 2 * timestep)
    for row in rows:
        one = np.array([row])
        np.testing.assert_array_equal(many.qpos[row], alone[row].data.qpos)
        np.testing.assert_array_equal(many.qvel[row], alone[row].data.qvel)
        np.testing.assert_array_equal(many.torque[row], alone[row].torque)
        np.testing.assert_array_equal(many.foot_force(one)[0], alone[row].state().foot_force)
        assert many.fallen(one)[0] == alone[row].fallen
    assert np.isfinite(many.qpos).all() and not many.diverged.any()


def test_no_trunk_touches_the_ground_before_it_is_too_low_or_leans_too_far():
    model = load_model(0.005)
    geom, torso = model.geom("torso_link"), model.body("torso_link").id
    assert not model.body_pos[torso].any(), "it turns about the pelvis' own vertical axis"
    # The centre of its shape rises from the pelvis' origin by no less than this much, whatever the waist does.
    tilt = np.cos(FALL_PITCH) * np.cos(FALL_ROLL)
    rise = geom.pos[2] * tilt - np.hypot(*geom.pos[:2])
    assert FALL_HEIGHT + rise > geom.rbound[0]


def test_a_robot_that_leans_too_far_or_diverges_is_down():
    robot = load_robot()
    gains = np.tile(robot.kp, (3, 1)), np.tile(robot.kd, (3, 1))
    many = LockstepSimulation([Variation()] * 3, *gains, timestep=0.005)
    many.command(np.arange(3), np.tile(robot.nominal, (3, 1)), np.zeros((3, 19)))
    many.qpos[1, 2] += 0.2
    many.qpos[1, 3:7] = [np.cos(0.7), 0.0, np.sin(0.7), 0.0]  # leans forward by 1.4 rad
    many.qvel[2, 0] = np.nan
    many.step(np.arange(3))
    assert many.fallen(np.arange(3)).tolist() == [False, True, True]
    assert many.diverged.tolist() == [False, False, True]
