"""Faults of a robot's sensors, declared as text and injected into its readings.

A fault is written `KIND@START`, for good, or `KIND@START:DURATION` in seconds; that of one joint is
`KIND=JOINT@START:DURATION`. `imu-gone@4:0.2` takes the IMU away for 200 ms from 4 s on.
"""

import dataclasses
import math
import re

import numpy as np

from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.robot import Robot
from hugwbc.state import RobotState

IMU_GONE, ENCODER_STUCK, FROZEN, WILD_SPEED, DISORDERED = FAULTS = (
    "imu-gone",
    "encoder-stuck",
    "frozen",
    "wild-speed",
    "disordered",
)
_OF_A_JOINT = (ENCODER_STUCK, WILD_SPEED)
WILD = 500.0  # [rad/s], the reading of a wild speed
_DISORDER = 0.02  # [s], largest error of a time stamp that is out of order
_PATTERN = re.compile(r"(?P<kind>[a-z-]+)(=(?P<joint>\w+))?@(?P<start>[^:]+)(:(?P<duration>.+))?")


@dataclasses.dataclass(frozen=True)
class SensorFault:
    """One fault.

    Attributes:
        kind: imu-gone (its numbers are NaN), encoder-stuck (position and velocity of a joint stay at their last
            reading), frozen (all readings stay), wild-speed (a joint's velocity reads 500 rad/s), or disordered (time
            stamps are wrong by up to 20 ms in both directions).
        start: [s].
        duration: [s]; infinite for good. A wild speed of duration 0 is a single reading.
        joint: name of the joint; None for a fault that is not of a joint.
    """

    kind: str
    start: float
    duration: float = math.inf
    joint: str | None = None

    def __post_init__(self) -> None:
        if self.kind not in FAULTS:
            raise UnknownNameError("sensor fault", self.kind, FAULTS)
        if not 0.0 <= self.start < math.inf or not self.duration >= 0.0:
            raise ConfigError(
                f"sensor fault {self.kind} starts at {self.start} s for {self.duration} s; give 0 s or more"
            )
        if (self.joint is None) == (self.kind in _OF_A_JOINT):
            wanted = "needs a joint: write it as" if self.joint is None else "has no joint: leave out"
            raise ConfigError(f"sensor fault {self.kind} {wanted} =JOINT")

    @classmethod
    def parse(cls, text: str) -> "SensorFault":
        """Return the fault that a text declares.

        Raises:
            ConfigError: if the text is none.
            UnknownNameError: if there is no such fault.
        """
        found = _PATTERN.fullmatch(text)
        try:
            if found is None:
                raise ValueError
            start, duration = float(found["start"]), math.inf if found["duration"] is None else float(found["duration"])
        except ValueError:
            raise ConfigError(
                f"'{text}' is no sensor fault; write KIND@START:DURATION or KIND=JOINT@START:DURATION in seconds, "
                f"such as imu-gone@4:0.2; kinds are {', '.join(FAULTS)}"
            ) from None
        return cls(found["kind"], start, duration, found["joint"])


class FaultInjector:
    """Faults of the sensors of one robot; the readings pass through `apply` in the order of time."""

    def __init__(self, faults: tuple[SensorFault, ...], robot: Robot, seed: int) -> None:
        """Set up.

        Args:
            faults: all of them; those that overlap add up in this order.
            robot: names of the joints.
            seed: of the disorder of time stamps.

        Raises:
            UnknownNameError: if a joint does not exist.
        """
        self._faults = faults
        self._columns = {f: robot.index(f.joint) for f in faults if f.joint is not None}
        self._seed = seed
        self.reset()

    def reset(self) -> None:
        """Begin a new episode."""
        self._held: dict[SensorFault, RobotState] = {}
        self._done: set[SensorFault] = set()
        self._rng = np.random.default_rng(self._seed)

    def apply(self, reading: RobotState) -> RobotState:
        """Return a reading with the faults of its time."""
        for fault in self._faults:
            now = reading.time + reading.age
            if fault.start <= now and fault not in self._done:
                if now >= fault.start + fault.duration:
                    self._done.add(fault)  # a fault that is shorter than a period still spoils one reading
                    if fault in self._held or fault.kind != WILD_SPEED:
                        continue
                reading = self._with(fault, reading)
        return reading

    def _with(self, fault: SensorFault, reading: RobotState) -> RobotState:
        held = self._held.setdefault(fault, reading)
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
        joint, q, dq = self._columns[fault], reading.q.copy(), reading.dq.copy()
        if fault.kind == ENCODER_STUCK:
            q[joint], dq[joint] = held.q[joint], held.dq[joint]
        else:
            dq[joint] = WILD
        return dataclasses.replace(reading, q=q, dq=dq)
