import dataclasses
import math

import numpy as np
import pytest

from hugwbc import Command, Gait, load_robot
from hugwbc.evaluation import effort_metrics as effort

ROBOT = load_robot()
MASS = 50.0
NAMES = ("time", "qpos", "qvel", "torque", "target")


@pytest.fixture
def walk(synthetic_trace):
    """0.5 m/s for 10 s; one joint drives at 20 N*m and 2 rad/s, another brakes at -10 N*m and 3 rad/s."""
    trace = synthetic_trace(Command(gait=Gait.WALKING, v_x=0.5))
    qpos, qvel, torque = np.zeros((500, 26)), np.zeros((500, 25)), np.zeros((500, 19))
    qpos[:, 0] = 0.5 * trace.time
    torque[:, 3], qvel[:, 6 + 3] = 20.0, 2.0
    torque[:, 7], qvel[:, 6 + 7] = -10.0, 3.0
    return dataclasses.replace(trace, qpos=qpos, qvel=qvel, torque=torque)


def test_cost_of_transport_by_hand(walk):
    assert effort.mechanical_power(walk) == pytest.approx(20.0 * 2.0 + 10.0 * 3.0)
    assert effort.speed(walk) == pytest.approx(0.5)
    assert effort.cost_of_transport(walk, MASS) == pytest.approx(70.0 / (MASS * 9.81 * 0.5))


def test_on_the_spot_there_is_power_and_no_cost_of_transport(walk):
    still = dataclasses.replace(walk, qpos=0.01 * walk.qpos)
    assert effort.mechanical_power(still) == 70.0
    assert math.isnan(effort.cost_of_transport(still, MASS))


def test_limits_are_used_by_the_joint_that_uses_most(walk):
    torque = np.zeros((500, 19))
    torque[250:, 3] = 0.8 * ROBOT.torque_limit[3]
    torque[:, 4] = 0.1 * ROBOT.torque_limit[4]
    trace = dataclasses.replace(walk, torque=torque)
    assert effort.torque_use(trace, 0.0) == pytest.approx({"rms": 0.8 * math.sqrt(0.5), "peak": 0.8})
    assert effort.torque_use(trace, 6.0)["rms"] == pytest.approx(0.8)  # type: ignore[index]
    assert effort.joint_speed_use(walk)["peak"] == pytest.approx(  # type: ignore[index]
        max(2.0 / ROBOT.velocity_limit[3], 3.0 / ROBOT.velocity_limit[7])
    )


def test_roughness_by_hand(walk):
    assert effort.torque_rate(walk) == 0.0
    rising = dataclasses.replace(walk, torque=np.tile(walk.time[:, None] * 5.0, 19))
    assert effort.torque_rate(rising) == pytest.approx(5.0)
    cubic = dataclasses.replace(walk, target=np.tile(2.0 * walk.time[:, None] ** 3, 19))
    assert effort.target_jerk(cubic) == pytest.approx(12.0**2, rel=1e-3)


def test_a_run_that_ended_in_the_settling_time_has_no_effort(walk):
    short = dataclasses.replace(
        walk, **{n: getattr(walk, n)[:20] for n in ("time", "qpos", "qvel", "torque", "target")}
    )
    for measure in (effort.mechanical_power, effort.speed, effort.torque_rate, effort.target_jerk):
        assert math.isnan(measure(short)), measure
    assert effort.torque_use(short) is None and effort.joint_speed_use(short) is None
