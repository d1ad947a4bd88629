import dataclasses
import math

import numpy as np
import pytest

from hugwbc import rotations
from hugwbc.arm_servo import ArmServo, ArmServoConfig
from hugwbc.arm_servo_rows import ArmServoRows
from hugwbc.controller import UpperBody
from hugwbc.robot import load_robot
from hugwbc.sim.batch import BatchSimulation
from hugwbc.state import RobotState

COUNT, DT = 40, 0.02


@pytest.fixture(params=["h1", "h1-2023"])
def robot(request):
    return load_robot(request.param)


def draw(robot, seed=0):
    """Targets, target speeds and accelerations of the arms, and states of as many robots that lean and turn."""
    rng, arms = np.random.default_rng(seed), robot.arms
    q = rng.uniform(robot.lower[arms], robot.upper[arms], (COUNT, 8))
    dq, ddq = rng.normal(0.0, 3.0, (COUNT, 8)), rng.normal(0.0, 10.0, (COUNT, 8))
    qpos, qvel = rng.normal(0.0, 0.5, (COUNT, 26)), rng.normal(0.0, 2.0, (COUNT, 25))
    qpos[:, 3:7] = [rotations.from_yaw_pitch_roll(*angles) for angles in rng.normal(0.0, 0.6, (COUNT, 3))]
    return q, dq, ddq, qpos, qvel


def states(qpos, qvel):
    return [RobotState(p[7:], v[6:], p[3:7], v[3:6]) for p, v in zip(qpos, qvel, strict=True)]


def test_every_row_is_the_servo_of_one_robot(robot):
    q, dq, ddq, qpos, qvel = draw(robot)
    servo = ArmServo(robot=robot)
    targets, tau = ArmServoRows(robot=robot)(q, dq, qpos, qvel, DT, ddq)
    for i, state in enumerate(states(qpos, qvel)):
        single = servo(UpperBody.targets(q[i], dq[i], ddq[i]), state, DT)
        assert targets[i] == pytest.approx(single.q, abs=1e-12)
        assert tau[i] == pytest.approx(single.tau, abs=1e-9)
    assert (np.abs(tau) < robot.torque_limit[robot.arms]).any(axis=0).all(), "no joint's torque is limited in all rows"


def test_without_motion_only_the_weight_is_left(robot):
    q, _, _, qpos, qvel = draw(robot)
    servo, weight = ArmServo(robot=robot), ArmServoRows(robot=robot).torque(q, qpos, qvel)
    for i, state in enumerate(states(qpos, qvel)):
        assert weight[i] == pytest.approx(servo.torque(q[i], state), abs=1e-9)


def test_the_configured_gains_are_those_of_one_robot(robot):
    config = ArmServoConfig(stiffness=60.0, shoulder_damping=4.0)
    rows, one = ArmServoRows(config, robot), ArmServo(config, robot)
    assert rows.kp.tolist() == one.kp.tolist() == [60.0] * 8
    assert rows.kd.tolist() == one.kd.tolist()


def test_a_bad_row_loses_its_torque_and_spoils_no_other(robot):
    q, dq, ddq, qpos, qvel = draw(robot)
    rows = ArmServoRows(robot=robot)
    good = rows(q, dq, qpos, qvel, DT, ddq)[1]
    qpos[3, 3:7] = math.nan
    bad = rows(q, dq, qpos, qvel, DT, ddq)[1]
    assert bad[3].tolist() == [0.0] * 8
    assert np.delete(bad, 3, axis=0).tolist() == np.delete(good, 3, axis=0).tolist()


def test_position_targets_hold_stretched_arms_of_a_batch(robot):
    """The drives of a batch take positions alone: with the servo's gains and offsets the arms go where they should."""
    batch, rows = BatchSimulation(2, robot=robot), ArmServoRows(robot=robot)
    arms = robot.arms
    gain, bias = batch.batch.expand("actuator_gainprm"), batch.batch.expand("actuator_biasprm")
    drives = np.arange(batch.model.nu)[batch.layout.ctrl][arms]
    gain[:, drives, 0], bias[:, drives, 1], bias[:, drives, 2] = rows.kp, -rows.kp, -rows.kd
    batch.batch.expand("dof_armature")[:, :6] = 1e6  # a pelvis too heavy to move
    goal = np.tile([-0.9, 0.2, 0.1, 0.6, -0.9, -0.2, -0.1, 0.6], (2, 1))
    still = np.zeros((2, 8))
    for _ in range(100):
        q, tau = rows(goal, still, batch.qpos, batch.qvel, DT)
        batch.ctrl[:, arms] = rows.position_targets(q, still, tau)
        batch.step(round(DT / batch.model.opt.timestep))
        batch.qvel[:, :6] = 0.0
        batch.forward(np.arange(2))
    assert np.abs(batch.qpos[:, 7:][:, arms] - goal).max() < 0.005


def test_payloads_and_forces_of_the_hands_are_those_of_one_robot(robot):
    q, dq, ddq, qpos, qvel = draw(robot)
    q, qpos[:, 7:][:, robot.arms] = 0.3 * q, 0.3 * q  # the arms are where they should be, so that none gives way
    rng = np.random.default_rng(3)
    force, payload = rng.normal(0.0, 5.0, (COUNT, 2, 3)), rng.uniform(0.0, 1.0, (COUNT, 2))
    servo, rows = ArmServo(robot=robot), ArmServoRows(robot=robot)
    for hands in (None, force):
        _, tau = rows(q, dq, qpos, qvel, DT, ddq, hands, payload)
        for i, state in enumerate(states(qpos, qvel)):
            body = dataclasses.replace(UpperBody.targets(q[i], dq[i], ddq[i]), payload=payload[i])
            body = body if hands is None else dataclasses.replace(body, hand_force=hands[i])
            assert tau[i] == pytest.approx(servo(body, state, DT).tau, abs=1e-7)
