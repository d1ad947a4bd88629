"""Faults of a robot's sensors and motors, declared as text and injected into its readings and its drives.

A fault is written `KIND@START`, for good, or `KIND@START:DURATION` in seconds; that of one joint is
`KIND=JOINT@START:DURATION`, and lost readings are `dropped=SHARE@START:DURATION`. `imu-gone@4:0.2` takes the IMU away
for 200 ms from 4 s on.
"""

import dataclasses
import math
import re
from typing import Annotated

import numpy as np
from pydantic import Field

from hugwbc import rotations
from hugwbc.errors import ConfigError
from hugwbc.robot import Robot
from hugwbc.settings import NotNegative, one_of, settings
from hugwbc.sim.sensors import ROBOT
from hugwbc.state import RobotState

IMU_GONE, IMU_BIAS, ENCODER_STUCK, ENCODER_NOISE, WILD_SPEED, FROZEN, DROPPED, DISORDERED, MOTOR_DEAD = FAULTS = (
    "imu-gone",
    "imu-bias",
    "encoder-stuck",
    "encoder-noise",
    "wild-speed",
    "frozen",
    "dropped",
    "disordered",
    "motor-dead",
)
_OF_A_JOINT = (ENCODER_STUCK, WILD_SPEED, MOTOR_DEAD)
WILD = 500.0  # [rad/s], the reading of a wild speed
TILT, TURN = math.radians(2.0), 0.1  # [rad], [rad/s], of a biased IMU, in pitch
NOISE = 3.0  # of the encoders, as a multiple of the noise of sensing `robot`
_DISORDER = 0.02  # [s], largest error of a time stamp that is out of order
_PATTERN = re.compile(r"(?P<kind>[a-z-]+)(=(?P<what>[^@]+))?@(?P<start>[^:]+)(:(?P<duration>.+))?")


@settings
class Fault:
    """One fault."""

    # imu-gone (its numbers are NaN), imu-bias (it is tilted by 2 degrees, and its gyro reads 0.1 rad/s too much, in
    # pitch), encoder-stuck (position and velocity of a joint stay at their last reading), encoder-noise (of all joints,
    # three times as much as usual), wild-speed (a joint's velocity reads 500 rad/s), frozen (all readings stay, while
    # time stamps continue), dropped (readings are lost at random, and the last one stands), disordered (time stamps are
    # wrong by up to 20 ms in both directions), or motor-dead (a joint has no torque but its friction)
    kind: Annotated[str, one_of("fault", lambda: FAULTS)]
    start: NotNegative  # when it begins [s]
    # how long it lasts [s]; infinite for good. A wild speed of duration 0 is a single reading
    duration: Annotated[float, Field(ge=0.0, allow_inf_nan=True)] = math.inf
    joint: str | None = None  # name of the joint; None for a fault that is not of a joint
    # share of the readings that are dropped, from 0 to less than 1; None for other faults
    share: Annotated[float, Field(ge=0.0, lt=1.0)] | None = None

    def __post_init__(self) -> None:
        if (self.joint is None) == (self.kind in _OF_A_JOINT):
            wanted = "needs a joint: write it as" if self.joint is None else "has no joint: leave out"
            raise ConfigError(f"fault {self.kind} {wanted} =JOINT")
        if (self.share is None) == (self.kind == DROPPED):
            raise ConfigError(f"fault {self.kind} has share {self.share}; write dropped=SHARE with 0 to less than 1")
        if self.duration == 0.0 and self.kind != WILD_SPEED:
            raise ConfigError(f"fault {self.kind} lasts 0 s, so nothing would happen; give a duration above 0")

    @classmethod
    def parse(cls, text: str) -> "Fault":
        """Return the fault that a text declares."""
        found = _PATTERN.fullmatch(text)
        try:
            if found is None:
                raise ValueError
            start, duration = float(found["start"]), math.inf if found["duration"] is None else float(found["duration"])
            share = float(found["what"]) if found["kind"] == DROPPED and found["what"] else None
        except ValueError:
            raise ConfigError(
                f"'{text}' is not a fault; write KIND@START:DURATION, KIND=JOINT@START:DURATION or "
                f"dropped=SHARE@START:DURATION in seconds, such as imu-gone@4:0.2; kinds are {', '.join(FAULTS)}"
            ) from None
        return cls(found["kind"], start, duration, None if found["kind"] == DROPPED else found["what"], share)


class FaultInjector:
    """Faults of one robot; the readings pass through `apply`, and what the drives are told through `drive`."""

    def __init__(self, faults: tuple[Fault, ...], robot: Robot, seed: int) -> None:
        """Set up; faults that overlap add up in their order, and what is random of them follows from the seed."""
        self._faults = faults
        self._columns = {f: robot.index(f.joint) for f in faults if f.joint is not None}
        self._robot, self._seed = robot, seed
        self.reset()

    def reset(self) -> None:
        """Begin a new episode."""
        self._held: dict[Fault, RobotState] = {}
        self._done: set[Fault] = set()
        self._rng = np.random.default_rng(self._seed)

    def apply(self, reading: RobotState) -> RobotState:
        """Return a reading with the faults of its time."""
        for fault in self._faults:
            now = reading.time + reading.age
            if fault.start <= now and fault not in self._done:
                if now >= fault.start + fault.duration:
                    self._done.add(fault)  # a wild speed that is shorter than a period still spoils one reading
                    if fault in self._held or fault.kind != WILD_SPEED:
                        continue
                reading = self._with(fault, reading)
        return reading

    def drive(
        self, time: float, drives: tuple[np.ndarray, np.ndarray, np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return stiffness, damping and constant torque of the drives at a time [s], each (n,); 0 for dead ones."""
        for fault in self._faults:
            if fault.kind == MOTOR_DEAD and fault.start <= time < fault.start + fault.duration:
                for values in drives:
                    values[self._columns[fault]] = 0.0
        return drives

    def _with(self, fault: Fault, reading: RobotState) -> RobotState:
        if fault.kind == MOTOR_DEAD:
            return reading
        held = self._held.setdefault(fault, reading)
        if fault.kind == DROPPED:
            assert fault.share is not None
            if self._rng.random() < fault.share:
                return dataclasses.replace(held, age=reading.time + reading.age - held.time)
            self._held[fault] = reading
            return reading
        if fault.kind == IMU_BIAS:
            return _tilted(reading, self._robot.imu_turn(reading.q, reading.dq)[0])
        if fault.kind == IMU_GONE:
            nothing = np.full(3, np.nan)
            return dataclasses.replace(
                reading,
                orientation=np.full(4, np.nan),
                angular_velocity=nothing,
                imu_gyro=nothing,
                imu_accelerometer=nothing,
            )
        if fault.kind == FROZEN:
            return dataclasses.replace(held, time=reading.time, age=reading.age)
        if fault.kind == DISORDERED:
            return dataclasses.replace(reading, time=reading.time + self._rng.uniform(-_DISORDER, _DISORDER))
        q, dq = reading.q.copy(), reading.dq.copy()
        if fault.kind == ENCODER_NOISE:
            more = math.sqrt(NOISE**2 - 1.0)
            q += more * ROBOT.encoder * self._rng.standard_normal(q.size)
            dq += more * ROBOT.joint_velocity * self._rng.standard_normal(dq.size)
            return dataclasses.replace(reading, q=q, dq=dq)
        joint = self._columns[fault]
        if fault.kind == ENCODER_STUCK:
            q[joint], dq[joint] = held.q[joint], held.dq[joint]
        else:
            dq[joint] = WILD
        return dataclasses.replace(reading, q=q, dq=dq)


def _tilted(reading: RobotState, waist: float) -> RobotState:
    """Return a reading of an IMU that is biased by `TILT` and `TURN`, and that the waist has turned by an angle [rad].

    Orientation and angular velocity are the pelvis's, so their errors are about the IMU's y axis in the pelvis.
    """
    axis, turn = rotations.rotation_z(waist)[:, 1], np.array([0.0, TURN, 0.0])
    mounted = rotations.from_axis_angle(np.array([0.0, 1.0, 0.0]), TILT)
    gyro, accelerometer = reading.imu_gyro, reading.imu_accelerometer
    return dataclasses.replace(
        reading,
        orientation=rotations.multiply(reading.orientation, rotations.from_axis_angle(axis, TILT)),
        angular_velocity=reading.angular_velocity + TURN * axis,
        imu_gyro=None if gyro is None else gyro + turn,
        imu_accelerometer=None if accelerometer is None else rotations.rotate_inverse(mounted, accelerometer),
    )
