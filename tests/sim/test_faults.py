"""Faults of sensors, as they are declared and as they change the readings."""

import math

import numpy as np
import pytest

from hugwbc import JointCommand, load_robot
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.sim import Simulation
from hugwbc.sim.faults import WILD, SensorFault

H1 = load_robot()
HOLD = JointCommand.position(H1, H1.nominal)
KNEE = H1.index("left_knee_joint")


def readings(*faults, count=20):
    simulation = Simulation(sensing="robot", latency=0.0, faults=tuple(map(SensorFault.parse, faults)))
    found = []
    for _ in range(count):
        simulation.step(HOLD, simulation.timestep)
        found.append(simulation.sense())
    return found


def test_a_fault_is_read_from_its_text():
    assert SensorFault.parse("imu-gone@4:0.2") == SensorFault("imu-gone", 4.0, 0.2)
    assert SensorFault.parse("encoder-stuck=left_knee_joint@1") == SensorFault(
        "encoder-stuck", 1.0, math.inf, "left_knee_joint"
    )


@pytest.mark.parametrize("text", ["", "imu-gone", "imu-gone@soon", "imu-gone@-1", "imu-gone@nan", "encoder-stuck@1"])
def test_a_text_that_is_no_fault_is_refused(text):
    with pytest.raises(ConfigError, match="sensor fault"):
        SensorFault.parse(text)


def test_unknown_kinds_and_joints_are_refused():
    with pytest.raises(UnknownNameError, match="imu-gone"):
        SensorFault.parse("imu-lost@1")
    with pytest.raises(UnknownNameError, match="left_knee_joint"):
        Simulation(faults=(SensorFault("wild-speed", 1.0, 0.0, "knee"),))


def test_each_fault_spoils_what_it_says_and_only_in_its_time():
    sound, gone = readings(), readings("imu-gone@0.009:0.02")
    assert [bool(np.isnan(r.imu_gyro).any()) for r in gone] == [False] * 4 + [True] * 10 + [False] * 6
    np.testing.assert_array_equal(gone[8].q, sound[8].q)
    stuck = readings("encoder-stuck=left_knee_joint@0.009")
    assert len({r.q[KNEE] for r in stuck[4:]}) == 1 and len({r.q[KNEE + 1] for r in stuck[4:]}) == 16
    frozen = readings("frozen@0.009")
    assert len({r.imu_gyro.tobytes() for r in frozen[4:]}) == 1 and frozen[9].time == sound[9].time
    wild = readings("wild-speed=left_knee_joint@0.009:0")
    assert [r.dq[KNEE] == WILD for r in wild] == [False] * 4 + [True] + [False] * 15
    times = [r.time for r in readings("disordered@0.009")]
    assert (np.diff(times[4:]) < 0.0).any() and times[:4] == [r.time for r in sound[:4]]
