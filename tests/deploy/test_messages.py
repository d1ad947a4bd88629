"""What the H1's messages say: 1,000 random ones there and back, and the slot of each motor."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

from hugwbc import JointCommand, load_robot, rotations
from hugwbc.deploy import wire
from hugwbc.deploy.messages import NO_POSITION, NO_VELOCITY, Messages
from hugwbc.deploy.remote import Remote
from hugwbc.sim import Simulation
from hugwbc.state import RobotState

H1 = load_robot()
# The maker's table (unitree_rl_gym, deploy_real; H1JointIndex of unitree_sdk2), written out by hand.
SLOTS = {
    "right_hip_roll_joint": 0, "right_hip_pitch_joint": 1, "right_knee_joint": 2, "left_hip_roll_joint": 3,
    "left_hip_pitch_joint": 4, "left_knee_joint": 5, "torso_joint": 6, "left_hip_yaw_joint": 7,
    "right_hip_yaw_joint": 8, "left_ankle_joint": 10, "right_ankle_joint": 11, "right_shoulder_pitch_joint": 12,
    "right_shoulder_roll_joint": 13, "right_shoulder_yaw_joint": 14, "right_elbow_joint": 15,
    "left_shoulder_pitch_joint": 16, "left_shoulder_roll_joint": 17, "left_shoulder_yaw_joint": 18,
    "left_elbow_joint": 19,
}  # fmt: skip


@pytest.fixture(scope="module")
def messages() -> Messages:
    return Messages(H1)


@pytest.mark.parametrize("name", ["h1", "h1-2023"])
def test_slots_and_modes_are_the_makers(name: str) -> None:
    robot = load_robot(name)
    messages = Messages(robot)
    assert dict(zip(robot.joint_names, messages.slots.tolist(), strict=True)) == SLOTS
    assert messages.modes.tolist() == [0x0A] * 10 + [0x01] * 10


def random_command(rng: np.random.Generator) -> JointCommand:
    fields = [field.name for field in dataclasses.fields(JointCommand)]
    return JointCommand(**{name: rng.uniform(-300, 300, 19).astype(np.float32).astype(float) for name in fields})


def random_reading(rng: np.random.Generator) -> RobotState:
    def single(size: int, scale: float) -> np.ndarray:
        return rng.uniform(-scale, scale, size).astype(np.float32).astype(float)

    q, dq, gyro = single(19, 2.0), single(19, 20.0), single(3, 5.0)
    attitude = rng.normal(size=4)
    torso = attitude / np.linalg.norm(attitude)
    turn = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), q[H1.waist])
    return RobotState(
        q=q,
        dq=dq,
        orientation=rotations.multiply(torso, rotations.conjugate(turn)),
        angular_velocity=rotations.rotate(turn, gyro) - np.array([0.0, 0.0, dq[H1.waist]]),
        imu_gyro=gyro,
        imu_accelerometer=single(3, 50.0),
        torque=single(19, 300.0),
    )


def test_a_thousand_random_commands_are_read_as_they_were_written(messages: Messages) -> None:
    rng = np.random.default_rng(0)
    for _ in range(1000):
        command, answers = random_command(rng), int(rng.integers(2**32))
        message = messages.pack_command(command, answers)
        assert wire.is_sealed(message)
        read = messages.unpack_command(message)
        assert read.answers == answers
        for field in dataclasses.fields(JointCommand):
            np.testing.assert_array_equal(getattr(read.command, field.name), getattr(command, field.name))


def test_a_thousand_random_states_are_read_as_they_were_written(messages: Messages) -> None:
    rng = np.random.default_rng(1)
    for _ in range(1000):
        reading, tick = random_reading(rng), int(rng.integers(2**32))
        temperature = rng.integers(0, 256, 19).astype(float)
        message = messages.pack_state(reading, tick, temperature, Remote())
        assert wire.is_sealed(message)
        read = messages.unpack_state(message, age=0.01)
        assert read.tick == tick and read.state.time == pytest.approx(tick * 1e-3) and read.state.age == 0.01
        np.testing.assert_array_equal(read.temperature, temperature)
        for name in ("q", "dq", "imu_gyro", "imu_accelerometer", "torque"):
            np.testing.assert_array_equal(getattr(read.state, name), getattr(reading, name))
        assert abs(read.state.orientation @ reading.orientation) == pytest.approx(1.0, abs=1e-6)
        np.testing.assert_allclose(read.state.angular_velocity, reading.angular_velocity, atol=1e-5)
        assert read.state.position is None and read.state.foot_force is None


@pytest.mark.parametrize("joint", H1.joint_names)
def test_each_joint_moves_alone(joint: str, messages: Messages) -> None:
    """A target in a joint's slot of the maker's table moves this joint of the simulated robot alone."""
    raw = wire.record("LowCmd_", messages.pack_command(JointCommand.position(H1, H1.nominal)))
    goal = H1.nominal[H1.index(joint)] + 0.1
    raw["motor_cmd"]["q"][SLOTS[joint]] = goal
    simulation = Simulation(sensing="exact")
    simulation.model.opt.gravity[:] = 0.0
    command = messages.unpack_command(wire.sealed(raw)).command
    simulation.data.qpos[2] += 0.5
    simulation.step(command, 0.3)
    state = wire.record("LowState_", messages.pack_state(_readable(simulation), 1, np.zeros(19), Remote()))
    moved = {name: state["motor_state"]["q"][slot] - H1.nominal[H1.index(name)] for name, slot in SLOTS.items()}
    assert moved.pop(joint) > 0.05
    assert max(map(abs, moved.values())) < 0.03
    assert state["motor_state"]["q"][9] == 0.0, "slot 9 has no motor"


def _readable(simulation: Simulation) -> RobotState:
    return dataclasses.replace(simulation.sense(), imu_gyro=np.zeros(3), imu_accelerometer=np.zeros(3))


def test_the_imu_of_a_turned_torso_tells_the_pelvis(messages: Messages) -> None:
    """The message holds the torso's orientation; the pelvis's comes back, with the waist turned and turning."""
    rng = np.random.default_rng(3)
    reading = dataclasses.replace(random_reading(rng), orientation=rotations.from_yaw_pitch_roll(0.4, 0.1, -0.2))
    message = wire.record("LowState_", messages.pack_state(reading, 1, np.zeros(19), Remote()))
    torso = rotations.to_matrix(message["imu_state"]["quaternion"].astype(float))
    pelvis = torso @ rotations.rotation_z(reading.q[H1.waist]).T
    np.testing.assert_allclose(pelvis, rotations.to_matrix(reading.orientation), atol=1e-6)
    np.testing.assert_allclose(message["imu_state"]["rpy"][2], rotations.yaw_of(rotations_of(torso)), atol=1e-5)


def rotations_of(matrix: np.ndarray) -> np.ndarray:
    return pin.Quaternion(matrix).coeffs()[[3, 0, 1, 2]]


def test_motors_without_a_target_or_out_of_their_mode_are_limp(messages: Messages) -> None:
    message = wire.record("LowCmd_", messages.pack_command(JointCommand.position(H1, H1.nominal)))
    motors = message["motor_cmd"]
    motors["q"][SLOTS["left_knee_joint"]] = NO_POSITION
    motors["dq"][SLOTS["right_knee_joint"]] = NO_VELOCITY
    motors["mode"][SLOTS["torso_joint"]] = 0
    read = messages.unpack_command(wire.sealed(message)).command
    assert read.kp[H1.index("left_knee_joint")] == 0.0 and read.kd[H1.index("left_knee_joint")] > 0.0
    assert read.kd[H1.index("right_knee_joint")] == 0.0 and read.kp[H1.index("right_knee_joint")] > 0.0
    assert read.kp[H1.waist] == read.kd[H1.waist] == 0.0
    assert read.is_finite and np.abs(read.q).max() < 10.0


def test_an_answer_differs_from_its_command_in_the_tick_alone(messages: Messages) -> None:
    command = JointCommand.position(H1, H1.nominal)
    state = messages.pack_state(random_reading(np.random.default_rng(5)), 4711, np.zeros(19), Remote())
    answer = messages.answering(messages.pack_command(command), state)
    assert answer == messages.pack_command(command, 4711)
    assert messages.answering(messages.pack_command(command, 3), b"torn") == messages.pack_command(command)
