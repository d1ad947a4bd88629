"""What the messages of H1 and G1 say: 1,000 random ones there and back, and the slot of each motor."""

import dataclasses

import numpy as np
import pytest
from deploy_bench import make_pilot
from local_endpoint import local_pair

from hugwbc import JointCommand, load_robot, rotations
from hugwbc.deploy import wire
from hugwbc.deploy.messages import NO_POSITION, NO_VELOCITY, Messages
from hugwbc.deploy.remote import Remote
from hugwbc.deploy.robot_side import RobotSide
from hugwbc.deploy.state_machine import DAMPING_GAIN
from hugwbc.deploy.watchdogs import Intake, Limits
from hugwbc.errors import ModelError
from hugwbc.robot import Robot
from hugwbc.robot_tables import robot_table
from hugwbc.runtime import HoldController
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


# The same of the G1 with 29 joints (G1JointIndex of unitree_sdk2_python's g1_low_level_example.py).
LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch", "wrist_yaw")
G1_ORDER = (
    *(f"left_{part}_joint" for part in LEG), *(f"right_{part}_joint" for part in LEG),
    "waist_yaw_joint", "waist_roll_joint", "waist_pitch_joint",
    *(f"left_{part}_joint" for part in ARM), *(f"right_{part}_joint" for part in ARM),
)  # fmt: skip
G1 = load_robot("g1")


@pytest.fixture(scope="module")
def messages() -> Messages:
    return Messages(H1)


@pytest.mark.parametrize("name", ["h1", "h1-2023"])
def test_slots_and_modes_are_the_makers(name: str) -> None:
    robot = load_robot(name)
    messages = Messages(robot)
    assert dict(zip(robot.joint_names, messages.slots.tolist(), strict=True)) == SLOTS
    assert messages.modes.tolist() == [0x0A] * 10 + [0x01] * 10


def test_more_motors_than_a_message_has_are_refused(monkeypatch) -> None:
    table = {**robot_table("g1"), "interface": {**robot_table("g1")["interface"], "messages": "unitree_go"}}
    monkeypatch.setattr("hugwbc.deploy.messages.robot_table", lambda name: table)
    with pytest.raises(ModelError, match=r"g1 has 29 motor slots; a unitree_go\.LowCmd_ has 20"):
        Messages(G1)


def test_slots_and_modes_of_the_g1_are_the_makers() -> None:
    messages = Messages(G1)
    assert [messages.slots[G1.index(name)] for name in G1_ORDER] == list(range(29))
    assert messages.modes.tolist() == [1] * 29 + [0] * 6


def random_command(rng: np.random.Generator, robot: Robot = H1) -> JointCommand:
    fields = [field.name for field in dataclasses.fields(JointCommand)]
    size = len(robot.joint_names)
    return JointCommand(**{name: rng.uniform(-300, 300, size).astype(np.float32).astype(float) for name in fields})


def random_reading(rng: np.random.Generator, robot: Robot = H1) -> RobotState:
    def single(size: int, scale: float) -> np.ndarray:
        return rng.uniform(-scale, scale, size).astype(np.float32).astype(float)

    size = len(robot.joint_names)
    q, dq, gyro = single(size, 2.0), single(size, 20.0), single(3, 5.0)
    attitude = rng.normal(size=4)
    imu = attitude / np.linalg.norm(attitude)
    angle, rate = (q[robot.waist], dq[robot.waist]) if robot is H1 else (0.0, 0.0)  # the G1's IMU is on the pelvis
    turn = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), angle)
    return RobotState(
        q=q,
        dq=dq,
        orientation=rotations.multiply(imu, rotations.conjugate(turn)),
        angular_velocity=rotations.rotate(turn, gyro) - np.array([0.0, 0.0, rate]),
        imu_gyro=gyro,
        imu_accelerometer=single(3, 50.0),
        torque=single(size, 300.0),
    )


@pytest.mark.parametrize("robot", [H1, G1], ids=["h1", "g1"])
def test_a_thousand_random_commands_are_read_as_they_were_written(robot: Robot) -> None:
    rng, messages = np.random.default_rng(0), Messages(robot)
    for _ in range(1000):
        command, answers = random_command(rng, robot), int(rng.integers(2**32))
        message = messages.pack_command(command, answers)
        assert wire.is_sealed(message)
        read = messages.unpack_command(message)
        assert read.answers == answers
        for field in dataclasses.fields(JointCommand):
            np.testing.assert_array_equal(getattr(read.command, field.name), getattr(command, field.name))


@pytest.mark.parametrize("robot", [H1, G1], ids=["h1", "g1"])
def test_a_thousand_random_states_are_read_as_they_were_written(robot: Robot) -> None:
    rng, messages = np.random.default_rng(1), Messages(robot)
    remote = Remote(lx=0.5, pressed=frozenset({"A"}))
    for _ in range(1000):
        reading, tick = random_reading(rng, robot), int(rng.integers(2**32))
        temperature = rng.integers(0, 256, len(robot.joint_names)).astype(float)
        message = messages.pack_state(reading, tick, temperature, remote)
        assert wire.is_sealed(message)
        read = messages.unpack_state(message, age=0.01)
        assert read.remote == remote
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
    raw = wire.record("unitree_go.LowCmd_", messages.pack_command(JointCommand.position(H1, H1.nominal)))
    goal = H1.nominal[H1.index(joint)] + 0.1
    raw["motor_cmd"]["q"][SLOTS[joint]] = goal
    simulation = Simulation(sensing="exact")
    simulation.model.opt.gravity[:] = 0.0
    command = messages.unpack_command(wire.sealed(raw)).command
    simulation.data.qpos[2] += 0.5
    simulation.step(command, 0.3)
    state = wire.record("unitree_go.LowState_", messages.pack_state(_readable(simulation), 1, np.zeros(19), Remote()))
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
    message = wire.record("unitree_go.LowState_", messages.pack_state(reading, 1, np.zeros(19), Remote()))
    torso = rotations.to_matrix(message["imu_state"]["quaternion"].astype(float))
    pelvis = torso @ rotations.rotation_z(reading.q[H1.waist]).T
    np.testing.assert_allclose(pelvis, rotations.to_matrix(reading.orientation), atol=1e-6)
    np.testing.assert_allclose(
        message["imu_state"]["rpy"][2], rotations.yaw_of(rotations.from_matrix(torso)), atol=1e-5
    )


def test_motors_without_a_target_or_out_of_their_mode_are_limp(messages: Messages) -> None:
    message = wire.record("unitree_go.LowCmd_", messages.pack_command(JointCommand.position(H1, H1.nominal)))
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


READING = random_reading(np.random.default_rng(7), G1)


def test_commands_and_damping_repeat_the_variant_that_the_g1s_states_tell() -> None:
    """As in the maker's example; a robot that is told another variant may ignore the command."""
    side = RobotSide(make_pilot(HoldController(G1), robot=G1), G1, local_pair()[1], tell=lambda line: None)
    variant = "unitree_hg.LowCmd_"
    for tick, machine in enumerate((5, 6), 1):
        raw = wire.record("unitree_hg.LowState_", Messages(G1).pack_state(READING, tick, np.full(29, 30.0), Remote()))
        raw["mode_machine"] = machine
        state = side.accept(wire.sealed(raw), 0.002 * tick)
        assert state is not None
        command = side.handle(wire.sealed(raw), state, 0.002 * tick)
        assert command is not None and wire.record(variant, command)["mode_machine"] == machine
    side._outlet._active = True
    side._outlet.fail("a test")
    damping = side._outlet.take(0.005, side.timing)
    assert damping is not None and wire.is_sealed(damping)
    content = wire.record(variant, damping)
    assert content["mode_machine"] == 6 and content["mode_pr"] == 0
    assert content["motor_cmd"]["kd"].tolist() == [DAMPING_GAIN] * 29 + [0.0] * 6


def test_states_of_another_variant_of_the_g1_are_refused_by_name() -> None:
    intake = Intake(Messages(G1), Limits())
    raw = wire.record("unitree_hg.LowState_", Messages(G1).pack_state(READING, 1, np.full(29, 30.0), Remote()))
    raw["mode_machine"] = 4  # 23 joints
    assert intake.accept(wire.sealed(raw), 0.0) is None
    assert intake.refusal == "states with a wrong variant: its mode_machine is 4; that of g1 is 5 or 6"
    raw["mode_machine"] = 0  # the maker's simulator
    assert intake.accept(wire.sealed(raw), 0.0) is not None


def test_the_g1s_motors_tell_the_temperature_of_casing_and_winding() -> None:
    """The watchdog's limit is that of the casing, the first of the two."""
    messages = Messages(G1)
    raw = wire.record("unitree_hg.LowState_", messages.pack_state(READING, 1, np.full(29, 30.0), Remote()))
    raw["motor_state"]["temperature"][:, 1] = 110
    assert messages.unpack_state(wire.sealed(raw)).temperature.tolist() == [30.0] * 29
