"""Faults of sensors and motors, as they are declared and as they change readings and torques."""

import itertools
import math

import numpy as np
import pytest

from hugwbc import JointCommand, load_robot
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.rotations import conjugate, multiply, pitch_of
from hugwbc.sim import Simulation
from hugwbc.sim.faults import NOISE, TILT, TURN, WILD, Fault
from hugwbc.sim.sensors import ROBOT

H1 = load_robot()
HOLD = JointCommand.position(H1, H1.nominal)
KNEE = H1.index("left_knee_joint")


def readings(*faults, count=20, latency=0.0):
    simulation = Simulation(sensing="robot", latency=latency, faults=tuple(map(Fault.parse, faults)))
    found = []
    for _ in range(count):
        simulation.step(HOLD, simulation.timestep)
        found.append(simulation.sense())
    return found


def test_a_fault_is_read_from_its_text():
    assert Fault.parse("imu-gone@4:0.2") == Fault("imu-gone", 4.0, 0.2)
    assert Fault.parse("encoder-stuck=left_knee_joint@1") == Fault("encoder-stuck", 1.0, math.inf, "left_knee_joint")
    assert Fault.parse("motor-dead=left-leg/knee@3:1") == Fault("motor-dead", 3.0, 1.0, "left-leg/knee")


TEXTS = (
    "", "imu-gone", "imu-gone@soon", "imu-gone@-1", "imu-gone@nan", "encoder-stuck@1", "imu-gone=left_knee_joint@1",
    "dropped@1", "dropped=some@1", "dropped=1@1", "dropped=nan@1", "motor-dead@1", "imu-gone@1:0",
)  # fmt: skip


@pytest.mark.parametrize("text", TEXTS)
def test_a_text_that_is_no_fault_is_refused(text):
    with pytest.raises(ConfigError, match=r"(?i)fault"):
        Fault.parse(text)


def test_unknown_kinds_and_joints_are_refused():
    with pytest.raises(UnknownNameError, match="imu-gone"):
        Fault.parse("imu-lost@1")
    with pytest.raises(UnknownNameError, match="left_knee_joint"):
        Simulation(sensing="exact", faults=(Fault("wild-speed", 1.0, 0.0, "knee"),))


def test_each_fault_spoils_what_it_says_and_only_in_its_time():
    sound, gone = readings(), readings("imu-gone@0.009:0.02")
    for name in ("orientation", "angular_velocity", "imu_gyro", "imu_accelerometer"):
        lacking = [np.isnan(getattr(r, name)).tolist() for r in gone]
        assert [all(of) for of in lacking] == [any(of) for of in lacking] == [False] * 4 + [True] * 10 + [False] * 6
    np.testing.assert_array_equal(gone[8].q, sound[8].q)
    stuck = readings("encoder-stuck=left_knee_joint@0.009")
    for name in ("q", "dq"):
        values = np.array([getattr(r, name) for r in stuck[4:]])
        assert [len(set(of)) for of in values.T] == [1 if joint == KNEE else 16 for joint in range(19)]
    frozen = readings("frozen@0.009")
    for name in ("q", "dq", "torque", "orientation", "imu_gyro", "imu_accelerometer"):
        assert len({getattr(r, name).tobytes() for r in frozen[4:]}) == 1, name
    assert frozen[9].time == sound[9].time
    wild = readings("wild-speed=left_knee_joint@0.009:0")
    assert [r.dq[KNEE] == WILD for r in wild] == [False] * 4 + [True] + [False] * 15
    off = np.array([r.time for r in readings("disordered@0.009")]) - [r.time for r in sound]
    assert not off[:4].any() and -0.02 <= off.min() < -0.01 and 0.01 < off.max() <= 0.02


def test_lost_readings_leave_the_last_one_standing():
    sound, lost = readings(count=200, latency=0.01), readings("dropped=0.3@0.029", count=200, latency=0.01)
    stood = [now.time == before.time for before, now in itertools.pairwise(lost)]
    assert not any(stood[5:13]) and 0.2 < np.mean(stood[14:]) < 0.4
    assert all(r.time + r.age == pytest.approx(s.time + s.age) for r, s in zip(lost, sound, strict=True))
    assert {r.imu_gyro.tobytes() for r in lost} < {s.imu_gyro.tobytes() for s in sound}


def test_a_biased_imu_is_tilted_and_turns():
    sound, biased = readings(), readings("imu-bias@0.009")
    np.testing.assert_array_equal(biased[3].imu_gyro, sound[3].imu_gyro)
    np.testing.assert_allclose(biased[9].imu_gyro - sound[9].imu_gyro, [0.0, TURN, 0.0], atol=1e-12)
    assert pitch_of(biased[9].orientation) - pitch_of(sound[9].orientation) == pytest.approx(TILT, abs=1e-3)
    up = sound[9].imu_accelerometer / np.linalg.norm(sound[9].imu_accelerometer)
    turned = np.array([up[0] * np.cos(TILT) - up[2] * np.sin(TILT), up[1], up[0] * np.sin(TILT) + up[2] * np.cos(TILT)])
    np.testing.assert_allclose(
        biased[9].imu_accelerometer, np.linalg.norm(sound[9].imu_accelerometer) * turned, atol=1e-9
    )


def test_a_biased_imu_tilts_about_its_own_axis_where_the_waist_has_turned_it():
    q = H1.nominal.copy()
    q[H1.waist] = 0.6
    simulations = (Simulation(faults=faults, latency=0.0) for faults in ((), (Fault.parse("imu-bias@0"),)))
    sound, biased = ((simulation.reset(q=q), simulation.sense())[1] for simulation in simulations)
    axis = np.array([-np.sin(0.6), np.cos(0.6), 0.0])  # the IMU's y axis in the pelvis
    np.testing.assert_allclose(biased.angular_velocity - sound.angular_velocity, TURN * axis, atol=2e-3)
    tilt = multiply(conjugate(sound.orientation), biased.orientation)
    np.testing.assert_allclose(tilt[1:], np.sin(0.5 * TILT) * axis, atol=1e-3)


def test_encoders_can_be_noisier():
    noisy, sound = readings("encoder-noise@0", count=400), readings(count=400)
    for name, usual in (("q", ROBOT.encoder), ("dq", ROBOT.joint_velocity)):
        added = np.array([getattr(a, name) - getattr(b, name) for a, b in zip(noisy, sound, strict=True)])
        assert added.std() == pytest.approx(np.sqrt(NOISE**2 - 1.0) * usual, rel=0.05)


def test_a_dead_motor_has_no_torque():
    simulation = Simulation(sensing="exact", faults=(Fault.parse("motor-dead=left_knee_joint@0.1:0.1"),))
    torques = []
    for _ in range(150):
        simulation.step(HOLD, simulation.timestep)
        torques.append(abs(simulation.torque[KNEE]))
    assert min(torques[20:45]) > 1.0 and max(torques[60:95]) == 0.0 and min(torques[110:]) > 0.0
