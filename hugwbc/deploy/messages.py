"""Contents of low-level messages: joint commands and sensor readings, in the order of the robot's joints."""

import dataclasses
import math

import numpy as np

from hugwbc import rotations
from hugwbc.controller import JointCommand
from hugwbc.deploy.remote import Remote
from hugwbc.deploy.wire import COMMAND, PACKAGES, STATE, check_sum, is_sealed, kind_of, layout, record, sealed
from hugwbc.errors import ModelError
from hugwbc.robot import Robot
from hugwbc.robot_tables import robot_table
from hugwbc.state import RobotState, pelvis_from_imu

TICK = 1e-3  # [s]; the robot counts milliseconds, and the maker's simulator too
TICKS = 2**32  # after which the count starts again
_HEAD, _LEVEL = (0xFE, 0xEF), 0xFF
# "No target" of the maker's examples; a motor without a joint gets these and no gains.
NO_POSITION, NO_VELOCITY = 2.146e9, 16000.0
_UP = np.array([0.0, 0.0, 1.0])


@dataclasses.dataclass(frozen=True, eq=False)
class StateMessage:
    """A state message."""

    tick: int  # the robot's clock [ms]
    state: RobotState  # readings of encoders, motors and IMU; its `time` is that of the tick
    temperature: np.ndarray  # of the motors' casings [degrees Celsius], shape (n,)
    remote: Remote  # the remote control


@dataclasses.dataclass(frozen=True, eq=False)
class CommandMessage:
    """A command message."""

    command: JointCommand  # the joint command; a motor that is not in its mode has no gains and no torque
    answers: int  # tick of the state that the command answers, in lockstep with a simulated robot; else 0


class Messages:
    """Packing and unpacking of a robot's messages. All joint vectors follow `Robot.joint_names`.

    Attributes:
        package: IDL package of the messages.
        command, state: kinds of the messages.
        slots: motor slot of each joint, shape (n,).
        modes: mode in which each slot's motor follows commands; 0 where no motor is.
        machine: variant of the robot by the last state that was read, which commands repeat; 0 where none is told.
    """

    def __init__(self, robot: Robot) -> None:
        """Read the low-level interface of a robot; a `ModelError` says that its table has none."""
        table = robot_table(robot.name).get("interface", {})
        self.package = table.get("messages")
        if self.package not in PACKAGES:
            raise ModelError(f"{robot.name} has no `interface` of {' or '.join(PACKAGES)}; see models/h1/h1.yaml")
        self.command, self.state = f"{self.package}.{COMMAND}", f"{self.package}.{STATE}"
        self._machines = table.get("machines", [])
        self.machine = self._machines[0] if self._machines else 0
        self._tells = "mode_machine" in (layout(self.state).names or ())
        self.slots = np.array([table["motors"].index(name) for name in robot.joint_names])
        self._robot = robot
        blank, modes = record(self.command), table["modes"]
        motors = blank["motor_cmd"]
        if len(modes) > motors.size:
            raise ModelError(f"{robot.name} has {len(modes)} motor slots; a {self.command} has {motors.size}")
        self._begin(blank)
        motors["mode"][: len(modes)] = modes
        self.modes = motors["mode"].copy()
        motors["q"], motors["dq"] = (np.where(self.modes, none, 0.0) for none in (NO_POSITION, NO_VELOCITY))
        self._blank = blank.tobytes()

    def _begin(self, message: np.ndarray) -> None:
        """Fill in what each message begins with: the robot's variant, or marks that never change."""
        if self._tells:
            message["mode_machine"] = self.machine
        else:
            message["head"], message["level_flag"] = _HEAD, _LEVEL

    def refusal(self, kind: str, message: bytes) -> tuple[str, str] | None:
        """Return what is wrong with a message of a kind, in a word and in words; None if it is sound."""
        if len(message) != layout(kind).itemsize:
            return "size", f"it is {kind_of(message)} instead of {kind}, which {self._robot.name} speaks"
        if not is_sealed(message):
            given, right = int.from_bytes(message[-4:], "little"), check_sum(message)
            hint = "the sender never sets it; " if given == 0 else ""
            return "check sum", f"its crc is 0x{given:08X} instead of 0x{right:08X}; {hint}see docs/deploy.md"
        machine = int(record(kind, message)["mode_machine"]) if self._machines else 0
        # A simulated robot of the maker's may tell none.
        if self._machines and machine not in self._machines and (machine or kind == self.command):
            right = " or ".join(map(str, self._machines))
            return "variant", f"its mode_machine is {machine}; that of {self._robot.name} is {right}"
        return None

    def pack_command(self, command: JointCommand, answers: int = 0) -> bytes:
        """Return a joint command as a message with its check sum.

        Only a simulated robot reads which state it answers, by the state's tick (field `reserve`).
        """
        message, slots = record(self.command, self._blank), self.slots
        self._begin(message)
        for field in dataclasses.fields(command):
            message["motor_cmd"][field.name][slots] = getattr(command, field.name)
        message["reserve"] = answers
        return sealed(message)

    def answering(self, command: bytes, state: bytes) -> bytes:
        """Return a command message that says which state message it answers; see `CommandMessage.answers`."""
        content = record(self.command, command)
        content["reserve"] = self.tick(state)
        return sealed(content)

    def tick(self, state: bytes) -> int:
        """Return the tick of a state message; 0 for one of another size."""
        right = len(state) == layout(self.state).itemsize
        return int(record(self.state, state)["tick"]) if right else 0

    def unpack_command(self, message: bytes) -> CommandMessage:
        """Read a command message whose check sum is right."""
        content, slots = record(self.command, message), self.slots
        motors = content["motor_cmd"][slots]
        given = {field.name: motors[field.name].astype(float) for field in dataclasses.fields(JointCommand)}
        off = motors["mode"] != self.modes[slots]
        for name in ("kp", "kd", "tau"):
            given[name][off] = 0.0
        # A motor without a target: its gain times a number of 2e9 would be a torque.
        for name, gain, none in (("q", "kp", NO_POSITION), ("dq", "kd", NO_VELOCITY)):
            empty = given[name] >= np.float32(none)
            given[name][empty] = given[gain][empty] = 0.0
        return CommandMessage(JointCommand(**given), content["reserve"].item(0))

    def pack_state(self, reading: RobotState, tick: int, temperature: np.ndarray, remote: Remote) -> bytes:
        """Return a reading of a robot as a message with its check sum.

        The reading has the raw readings of the IMU and the joint torques; the temperatures are those of the motors
        [degrees Celsius], shape (n,).
        """
        message, slots = record(self.state), self.slots
        assert reading.imu_gyro is not None and reading.imu_accelerometer is not None and reading.torque is not None
        torso = rotations.from_axis_angle(_UP, self._robot.imu_turn(reading.q, reading.dq)[0])
        attitude = rotations.multiply(reading.orientation, torso)
        imu, motors = message["imu_state"], message["motor_state"]
        imu["quaternion"], imu["gyroscope"], imu["accelerometer"] = (
            attitude,
            reading.imu_gyro,
            reading.imu_accelerometer,
        )
        imu["rpy"] = rotations.roll_of(attitude), rotations.pitch_of(attitude), rotations.yaw_of(attitude)
        self._begin(message)
        motors["mode"] = self.modes
        motors["q"][slots], motors["dq"][slots], motors["tau_est"][slots] = reading.q, reading.dq, reading.torque
        motors["temperature"].T[..., slots] = np.clip(temperature, 0, 255)  # unitree_hg: of casing and winding
        message["tick"] = tick % TICKS
        message["wireless_remote"] = np.frombuffer(remote.pack(), dtype=np.uint8)
        return sealed(message)

    def adopt(self, state: bytes) -> None:
        """Let commands repeat the variant of the robot that a state tells."""
        if self._tells:
            self.machine = int(record(self.state, state)["mode_machine"])

    def unpack_state(self, message: bytes, age: float = 0.0, turns: int = 0) -> StateMessage:
        """Read a state message whose check sum is right, of an age [s], after so many turns of the count of ticks."""
        content, slots = record(self.state, message), self.slots
        imu, motors = content["imu_state"], content["motor_state"][slots]
        q, dq, gyro = motors["q"].astype(float), motors["dq"].astype(float), imu["gyroscope"].astype(float)
        attitude = imu["quaternion"].astype(float)
        length = math.sqrt(float(attitude @ attitude))
        # A quaternion of single precision is a unit one to 1e-7; what is far from that stays as it is, to be seen.
        attitude = attitude / length if 0.9 < length < 1.1 else attitude
        orientation, rate = pelvis_from_imu(attitude, gyro, *self._robot.imu_turn(q, dq))
        tick = int(content["tick"])
        state = RobotState(
            q=q,
            dq=dq,
            orientation=orientation,
            angular_velocity=rate,
            imu_gyro=gyro,
            imu_accelerometer=imu["accelerometer"].astype(float),
            torque=motors["tau_est"].astype(float),
            time=(tick + turns * TICKS) * TICK,
            age=age,
        )
        remote = Remote.parse(content["wireless_remote"].tobytes())
        return StateMessage(tick, state, np.atleast_2d(motors["temperature"].T)[0].astype(float), remote)
