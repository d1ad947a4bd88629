"""Watchdogs of a controlled robot: fresh messages, and a body within its limits."""

import math

import numpy as np

from hugwbc.deploy.messages import TICK, TICKS, Messages, StateMessage
from hugwbc.robot import Robot
from hugwbc.settings import Positive, settings
from hugwbc.state import RobotState

_RESTART = 1.0  # [s] of robot time without a fresh tick, after which a lower count is that of a restarted robot


@settings
class Limits:
    """When the robot side damps the joints. Times are those of the robot's clock.

    Until then the last command is held, which a walk survives for longer than damping (`tests/deploy/test_gaps.py`).
    """

    silence: Positive = 0.1  # longest time without a fresh, sound state [s]
    late: Positive = 0.1  # longest time by which the controller may lag behind the states [s]
    tilt: Positive = 1.0  # largest angle between the pelvis's axis and the vertical [rad]; published for the G1
    start_tilt: Positive = 0.3  # the same at a start [rad]
    # largest speed of a joint, as a multiple of its limit in the robot's table. Where a foot lands hard, the ankles
    # reach 1.8 times theirs (a policy at 1 m/s in simulation)
    joint_speed: Positive = 2.5
    temperature: Positive = 85.0  # largest temperature of a motor [degrees Celsius]; published for the G1's casings
    # how long joint speed and tilt must be exceeded [s]: single wrong readings are the estimator's task
    lasting: Positive = 0.006
    start_speed: Positive = 2.0  # largest speed of a joint when the controller starts [rad/s]
    carried: Positive = 0.3  # least part of the weight on the feet when the controller starts


class Intake:
    """A check of arriving states: their size, check sum, robot and tick.

    Attributes:
        received, torn, wrong_sum, old: messages in all, of a wrong size, with a wrong check sum, and with a tick that
            is not newer than the last one's.
        gap: longest time between two fresh states by their ticks [s].
        time: of the last fresh state, continuous where the count of ticks wraps around [s].
        refusal: what was wrong since the last fresh state; empty if nothing was.
    """

    def __init__(self, messages: Messages, limits: Limits, age: float = 0.0) -> None:
        """Begin without a state; `age` is the assumed age of a reading at its arrival [s]."""
        self._messages, self._limits, self._age = messages, limits, age
        self.received = self.torn = self.wrong_sum = self.old = 0
        self.gap = self.time = 0.0
        self._tick: int | None = None
        self._turns = 0
        self._fresh_at = math.inf
        self.refusal = ""

    def accept(self, message: bytes, now: float) -> StateMessage | None:
        """Return a state that is fresh; else None; see `check`."""
        return self.unpacked(message) if self.check(message, now) else None

    def unpacked(self, message: bytes) -> StateMessage:
        """Return the content of the last fresh state."""
        return self._messages.unpack_state(message, self._age, self._turns)

    def check(self, message: bytes, now: float) -> bool:
        """Return whether a state is valid and newer than all before.

        The time `now` is that of this side's clock, at the robot's pace [s].
        """
        self.received += 1
        refusal = self._messages.refusal(self._messages.state, message)
        if refusal is not None:
            self.torn += refusal[0] == "size"
            self.wrong_sum += refusal[0] == "check sum"
            return self._refuse(f"states with a wrong {refusal[0]}: {refusal[1]}")
        tick = self._messages.tick(message)
        if self._tick is not None and now - self._fresh_at < _RESTART:
            ahead = (tick - self._tick) % TICKS
            if not 0 < ahead < TICKS // 2:
                self.old += 1
                return self._refuse("states with an old tick")
            self._turns += tick < self._tick
            self.gap = max(self.gap, ahead * TICK)
        self._tick, self._fresh_at, self.refusal = tick, now, ""
        self.time = (tick + self._turns * TICKS) * TICK
        self._messages.adopt(message)
        return True

    def _refuse(self, what: str) -> bool:
        self.refusal = what
        return False

    def fault(self, now: float) -> str | None:
        """Return the fault of the connection at time `now` [s]; None if a fresh state arrived in time."""
        silence = now - self._fresh_at
        if silence <= self._limits.silence:
            return None
        return f"no state for {silence * 1e3:.0f} ms" + (f", but {self.refusal}" if self.refusal else "")


class BodyLimits:
    """A check of tilt, joint speeds and temperatures."""

    def __init__(self, robot: Robot, limits: Limits) -> None:
        """Take the joint speeds' limits from a robot."""
        self._robot, self._limits = robot, limits
        self._speed = limits.joint_speed * robot.velocity_limit
        self._since: dict[str, float] = {}  # when what is exceeded began [s]

    def fault(self, message: StateMessage) -> str | None:
        """Return the limit that a reading exceeds for long enough, or None."""
        state, limits = message.state, self._limits
        names = self._robot.joint_names
        hottest = int(np.argmax(message.temperature))
        if message.temperature[hottest] > limits.temperature:
            return (
                f"motor of {names[hottest]} has {message.temperature[hottest]:.0f} degrees Celsius, "
                f"above {limits.temperature:.0f}"
            )
        lean = tilt(state)
        if self._lasts("tilt", lean > limits.tilt, state.time):
            return f"the robot leans {lean:.2f} rad, above {limits.tilt:.2f}"
        if self._lasts("orientation", math.isnan(lean), state.time, limits.silence):
            return f"the IMU has given no orientation for {limits.silence * 1e3:.0f} ms"
        fast = np.abs(state.dq) > self._speed
        if self._since or fast.any():
            for joint, exceeded in enumerate(fast.tolist()):
                if self._lasts(names[joint], exceeded, state.time):
                    return f"{names[joint]} turns at {state.dq[joint]:.1f} rad/s, above {self._speed[joint]:.1f}"
        return None

    def _lasts(self, name: str, exceeded: bool, time: float, lasting: float | None = None) -> bool:
        """Return whether a limit has been exceeded without a break for a time [s], the limits' `lasting` by default."""
        if not exceeded:
            self._since.pop(name, None)
            return False
        lasting = self._limits.lasting if lasting is None else lasting
        return time - self._since.setdefault(name, time) >= lasting - 1e-9


def tilt(state: RobotState) -> float:
    """Return the angle between the pelvis's axis and the vertical [rad]; NaN if the orientation is not known.

    A broken IMU may send zeros, which turn nothing.
    """
    if not abs(float(state.orientation.dot(state.orientation)) - 1.0) < 0.1:
        return math.nan
    upright = -float(state.projected_gravity[2])
    return math.acos(min(max(upright, -1.0), 1.0)) if math.isfinite(upright) else math.nan


def start_refusal(state: RobotState, robot: Robot, limits: Limits) -> str | None:
    """Return why the robot must not go to its start pose from a state; None if it may."""
    if not state.is_usable:
        return "the readings are not usable numbers: check the IMU and the encoders"
    lean = tilt(state)
    if lean > limits.start_tilt:
        return f"the robot leans {lean:.2f} rad, above {limits.start_tilt:.2f}: hang or hold it upright"
    beyond = np.maximum(robot.lower - state.q, state.q - robot.upper)
    worst = int(np.argmax(beyond))
    if beyond[worst] > 0.1:
        return f"{robot.joint_names[worst]} reads {state.q[worst]:.2f} rad, outside its range: calibrate its zero"
    return None


def run_refusal(state: RobotState, carried: float, robot: Robot, limits: Limits) -> str | None:
    """Return why the controller must not start from a state; None if it may.

    The feet carry a part of the weight, 0 to 1.
    """
    refusal = start_refusal(state, robot, limits)
    if refusal is not None:
        return refusal
    if carried < limits.carried:
        return (
            f"the robot hangs, with {100 * max(carried, 0.0):.0f} % of its weight on its feet: lower the hoist until "
            f"they carry {100 * limits.carried:.0f} %"
        )
    fastest = int(np.argmax(np.abs(state.dq)))
    if abs(state.dq[fastest]) > limits.start_speed:
        return f"{robot.joint_names[fastest]} turns at {state.dq[fastest]:.1f} rad/s: wait until the robot is still"
    return None
