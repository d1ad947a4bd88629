"""Robot state: gravity, heading, finiteness, and the carry-over from the IMU to the pelvis."""

import dataclasses
import math

import mujoco
import numpy as np
import pytest

from hugwbc import rotations
from hugwbc.state import RobotState, pelvis_from_imu


def _state(**changes: object) -> RobotState:
    upright = RobotState(np.zeros(19), np.zeros(19), np.array([1.0, 0, 0, 0]), np.zeros(3))
    return dataclasses.replace(upright, **changes)


def test_gravity_in_the_pelvis_frame() -> None:
    np.testing.assert_allclose(_state().projected_gravity, [0, 0, -1], atol=1e-12)
    # Leaning forward by 0.3 rad brings gravity towards +x.
    leaning = _state(orientation=rotations.from_yaw_pitch_roll(1.0, 0.3, 0.0))
    np.testing.assert_allclose(leaning.projected_gravity, [math.sin(0.3), 0, -math.cos(0.3)], atol=1e-12)


def test_finiteness_ignores_what_is_absent() -> None:
    assert _state().is_finite
    assert _state(position=np.zeros(3)).is_finite
    assert not _state(velocity=np.array([0, np.nan, 0])).is_finite
    assert not _state(time=math.inf).is_finite


def test_torso_imu_agrees_with_the_simulated_truth(robot) -> None:
    model = mujoco.MjModel.from_xml_path(str(robot.xml_path))
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    for _ in range(100):
        data.qpos[3:7] = rng.normal(size=4)
        data.qpos[3:7] /= np.linalg.norm(data.qpos[3:7])
        data.qpos[7:] = rng.uniform(robot.lower, robot.upper)
        data.qvel[:] = rng.normal(size=25)
        mujoco.mj_forward(model, data)
        orientation, rate = pelvis_from_imu(
            data.sensor("imu_orientation").data,
            data.sensor("imu_gyro").data,
            data.joint("torso_joint").qpos[0],
            data.joint("torso_joint").qvel[0],
        )
        # A quaternion and its negative are the same rotation.
        assert abs(orientation @ data.qpos[3:7]) == pytest.approx(1.0, abs=1e-12)
        np.testing.assert_allclose(rate, data.qvel[3:6], atol=1e-10)
