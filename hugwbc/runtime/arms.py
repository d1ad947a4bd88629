"""The arms in a control period: from arm targets to their drives, and the change between servo and controller."""

import dataclasses
import math

import numpy as np

from hugwbc.arm_servo import ArmServo
from hugwbc.controller import JointCommand, UpperBody
from hugwbc.hand_wrench import FREE, HEAVIEST, STIFFNESS, STRONGEST
from hugwbc.kinematics import in_place
from hugwbc.numeric import changed, smooth_step
from hugwbc.robot import SIDES, Robot
from hugwbc.runtime.safety_report import SafetyLog
from hugwbc.state import GRAVITY, RobotState

HANDOVER_TIME = 0.5  # [s] in which the step between the servo's and the controller's own arm command fades
RATE = 3.0  # [1/s], bandwidth at which a payload is learned; the sway of a walk averages out
BAND = 1.5  # [N], part of a force that counts as friction: without it, sticking joints would make the hands hunt
LEARNED = 6.0  # [kg], largest payload to learn, in case something else pulls the hand down
_BEYOND = (
    f"a force on a hand above {STRONGEST:g} N, a payload outside 0 to {HEAVIEST:g} kg, or a stiffness outside "
    f"{STIFFNESS[0]:g} to {STIFFNESS[1]:g} N/m: limited"
)
_VECTORS = tuple(field.name for field in dataclasses.fields(JointCommand))
_GAINS = [_VECTORS.index(name) for name in ("kp", "kd")]


class ArmDrive:
    """The drive of arms under external control, whatever the controller.

    Targets are clamped to the joint limits; the last good ones replace bad ones. The wrench on the hands comes and goes
    without jumps and within its ranges (`HandWrench.towards`), with the payload that is told or learned. One servo
    (`ArmServo`) completes them.
    """

    def __init__(self, robot: Robot, log: SafetyLog) -> None:
        """Set up for arms that nothing but the controller moves."""
        self._robot, self._log = robot, log
        self._limits = robot.lower[robot.arms], robot.upper[robot.arms]
        self._payload, self._free = PayloadObserver(), UpperBody.none(robot.arms.size)
        self._servo: ArmServo | None = None  # built by the first external control of the arms
        self.reset()

    def reset(self) -> None:
        """Forget targets, wrench and payload."""
        self._last, self._wrench = self._free, FREE
        self._payload.reset()

    def __call__(self, upper_body: UpperBody, state: RobotState, dt: float) -> UpperBody:
        """Return arm targets with the gains and the feed-forward torque of the servo."""
        upper_body = self._admitted(upper_body)
        if not upper_body.indicator:
            self._wrench = FREE
            self._payload.reset()
            return upper_body
        goal = upper_body.wrench.limited()
        if goal is not upper_body.wrench:
            self._log.count("wrench_limited", _BEYOND)
        self._wrench = self._wrench.towards(goal, dt)
        if self._wrench is not upper_body.wrench:
            upper_body = changed(upper_body, wrench=self._wrench)
        if self._servo is None:
            self._servo = ArmServo(robot=self._robot)
        if not state.is_usable:
            return upper_body
        return self._servo(self._payload.complete(upper_body, state, dt), state, dt)

    def _admitted(self, upper_body: UpperBody) -> UpperBody:
        """Return the targets within the joint limits, or the last good ones."""
        low, high = self._limits
        known = isinstance(upper_body, UpperBody) and upper_body.is_finite
        if not known or (upper_body.indicator and upper_body.q.shape != low.shape):
            self._log.count(
                "upper_body_rejected",
                f"external arm targets are not {low.size} finite numbers each, or the wrench on the hands is not "
                "finite: keeping the last good ones",
            )
            return self._last
        if not upper_body.indicator:
            self._last = self._free
            return self._last
        q = np.minimum(np.maximum(upper_body.q, low), high)
        if ((q != upper_body.q) & upper_body.mask).any():
            self._log.count("upper_body_limited", "external arm targets outside the joint limits: clamped")
        # A source may give the same object again, with other numbers in it: what was good is kept apart.
        kept = {name: getattr(upper_body, name).copy() for name in ("dq", "mask", "ddq", "tau")}
        self._last = changed(upper_body, q=q, **kept)
        return self._last


class PayloadObserver:
    """Learn the payload of each hand from the vertical force on it.

    The servo feeds the learned payload forward, which takes the sag out of the arms as an integral term would: as long
    as a joint sticks, the torque of its stiffness counts as load.

    A hand whose stiffness is wanted must give way, so nothing is learned for it. Nor is anything for a hand that
    presses up or down: where it meets nothing, the force that is missing would count as a payload, and the hand would
    float.

    Attributes:
        payload: mass in the left and the right hand [kg], shape (2,).
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget what the hands carry."""
        self.payload = np.zeros(len(SIDES))

    def complete(self, upper_body: UpperBody, state: RobotState, dt: float) -> UpperBody:
        """Return the arm targets with the learned payload, if none is told, `dt` [s] after the last call.

        The state must be finite; without forces on the hands nothing is learned.
        """
        wrench, told = upper_body.wrench, upper_body.wrench.payload
        if wrench.stiffness is not None:
            self.reset()
            return upper_body
        if told is not None:
            self.payload = np.minimum(told, LEARNED)  # what is no longer told is learned from here on
            return upper_body
        if state.hand_force is None:
            return upper_body
        weight = GRAVITY * self.payload
        excess = -(state.hand_force - wrench.force)[:, 2] - weight
        pressing = np.abs(wrench.force[:, 2]) > BAND
        beyond = np.where(pressing, 0.0, np.sign(excess) * np.maximum(np.abs(excess) - BAND, 0.0))
        weight = weight + (1.0 - math.exp(-RATE * dt)) * beyond
        self.payload = np.minimum(np.maximum(weight / GRAVITY, 0.0), LEARNED)
        if not np.count_nonzero(self.payload):
            return upper_body
        return changed(upper_body, wrench=changed(wrench, payload=self.payload.copy()))


class Handover:
    """A blend of the arm command where external control takes the arms, gives them back, or makes them soft or stiff.

    The servo of the arms and the controller drive them with other gains, and one of them carries the arms' weight by
    feed-forward torque, the other perhaps by an offset of its position targets. Hands whose stiffness is wanted have
    other gains than the servo's own, and no learned payload (`PayloadObserver`). The step in each of the five vectors
    of the joint command is therefore added to the new command at first, which leaves the torque as it was, and fades
    over `HANDOVER_TIME`. The gains go from those before to the present ones, so that none leaves their range.

    The positions of a takeover have no step, since the targets start at the controller's own arm command
    (`hugwbc.upper_ik.Takeover`). In a hand-back they return to where that command was before the takeover; its arm
    swing may have moved on meanwhile.
    """

    def __init__(self, arms: np.ndarray) -> None:
        """Set up the blend for the joints `arms`, indices of shape (k,)."""
        self._arms, self._size = in_place(arms), arms.size
        self.reset()

    def reset(self) -> None:
        """Forget any difference."""
        self._driven: tuple[bytes, bool] | None = None  # mask of external control; whether with a wanted stiffness
        self._last: JointCommand | None = None
        self._before = self._offset = np.zeros((len(_VECTORS), self._size))
        self._elapsed = HANDOVER_TIME

    def __call__(self, command: JointCommand, upper_body: UpperBody, dt: float) -> JointCommand:
        """Return the command without a jump of the arms where `upper_body` changes what drives them."""
        mask = upper_body.mask.tobytes() if upper_body.indicator else b""
        driven = mask, upper_body.wrench.stiffness is not None
        changes = self._last is not None and self._driven != driven
        self._driven = driven
        if changes or self._elapsed < HANDOVER_TIME:
            now = self._of_arms(command)
            if self._last is not None and changes:
                self._before, self._elapsed = self._of_arms(self._last), 0.0
                self._offset = self._before - now
            self._offset[_GAINS] = (self._before - now)[_GAINS]
            now = now + (1.0 - smooth_step(self._elapsed / HANDOVER_TIME)) * self._offset
            self._elapsed += dt
            vectors = {name: getattr(command, name).copy() for name in _VECTORS}
            for name, arms in zip(_VECTORS, now, strict=True):
                vectors[name][self._arms] = arms
            command = JointCommand(**vectors)
        self._last = command
        return command

    def _of_arms(self, command: JointCommand) -> np.ndarray:
        """Return the arms' part of the five vectors, shape (5, k)."""
        return np.array([getattr(command, name)[self._arms] for name in _VECTORS])
