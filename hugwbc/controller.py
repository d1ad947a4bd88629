"""The message to the joints, external control of the arms, and the interface that every controller implements."""

import dataclasses
import functools
import math
from typing import Any, Protocol, runtime_checkable

import numpy as np

from hugwbc.commands import Command
from hugwbc.errors import ConfigError, TargetError
from hugwbc.hand_wrench import FREE, HandWrench
from hugwbc.numeric import JOINTS, Shape, flags, keep_floats, number
from hugwbc.robot import Robot
from hugwbc.state import RobotState


@dataclasses.dataclass(frozen=True, eq=False)
class JointCommand:
    """A command to all joints: torque = tau + kp (q - q_measured) + kd (dq - dq_measured), then limited.

    It holds the five vectors of a Unitree robot's low-level command, each of shape (n,), in the robot's joint order.
    What other libraries call numbers is converted; what is none, or has another shape, becomes NaN (`is_finite`).

    Attributes:
        q: position targets [rad].
        dq: velocity targets [rad/s].
        kp: stiffness [N*m/rad].
        kd: damping [N*m*s/rad].
        tau: feed-forward torque [N*m].
    """

    q: np.ndarray
    dq: np.ndarray
    kp: np.ndarray
    kd: np.ndarray
    tau: np.ndarray

    def __post_init__(self) -> None:
        keep_floats(self, _JOINT_VECTORS)

    @classmethod
    def position(cls, robot: Robot, q: np.ndarray) -> "JointCommand":
        """Build a command that holds positions with the robot's nominal gains and without feed-forward torque."""
        zero = np.zeros_like(robot.kp)
        return cls(q=q, dq=zero, kp=robot.kp, kd=robot.kd, tau=zero)

    @functools.cached_property
    def is_finite(self) -> bool:
        """Whether all numbers are finite and can be squared."""
        together = np.concatenate((self.q, self.dq, self.kp, self.kd, self.tau))
        return math.isfinite(together.dot(together))  # squares do not cancel


@dataclasses.dataclass(frozen=True, eq=False)
class UpperBody:
    """External control of the arms by IK, a motion file or noise; `UpperBody.none()` leaves them to the controller.

    A source of targets gives `q`, `dq` and `mask`, and may add an acceleration and a torque. The servo of the arms
    (`hugwbc.arm_servo`) then completes the torque and sets the gains, so that the arms are driven alike whatever
    controls the rest of the body.

    Attributes:
        q: position targets of the k arm joints, in the order of `Robot.arms` [rad], shape (k,).
        dq: velocity targets [rad/s], shape (k,).
        mask: which of these joints are taken over, shape (k,), bool.
        ddq: accelerations of the planned motion [rad/s^2], shape (k,); by default none. Corrections for the measured
            motion of the body do not belong here (`hugwbc.arm_servo`).
        tau: feed-forward torques [N*m], shape (k,); by default none.
        kp, kd: stiffness [N*m/rad] and damping [N*m*s/rad], shape (k,); None for the robot's nominal gains.
        wrench: forces that the hands should meet, in the axes of the world, what they carry, and their stiffness.

    What other libraries call numbers is converted; what is none, or has another shape, becomes NaN (`is_finite`).
    """

    q: np.ndarray
    dq: np.ndarray
    mask: np.ndarray
    ddq: np.ndarray = None  # type: ignore[assignment]  zeros
    tau: np.ndarray = None  # type: ignore[assignment]  zeros
    kp: np.ndarray | None = None
    kd: np.ndarray | None = None
    wrench: HandWrench = FREE

    def __post_init__(self) -> None:
        keep_floats(self, _ARM_NUMBERS, _OPTIONAL)
        mask = flags(self.mask, self.q.shape)
        if mask is None:
            object.__setattr__(self, "q", np.full_like(self.q, np.nan))
        object.__setattr__(self, "mask", np.zeros(self.q.shape, dtype=bool) if mask is None else mask)
        for name in ("ddq", "tau"):
            if getattr(self, name) is None:
                object.__setattr__(self, name, np.zeros_like(self.q))

    @classmethod
    def none(cls, joints: int = 0) -> "UpperBody":
        """Return no external control, as controllers get it with the number of arm joints, k."""
        return cls(np.zeros(joints), np.zeros(joints), np.zeros(joints, dtype=bool))

    @classmethod
    def targets(
        cls,
        q: np.ndarray,
        dq: np.ndarray | None = None,
        ddq: np.ndarray | None = None,
        *,
        tau: np.ndarray | None = None,
    ) -> "UpperBody":
        """Build targets that take over both arms.

        Args:
            q: positions of the k arm joints [rad], shape (k,).
            dq: velocities [rad/s], shape (k,); None for zeros.
            ddq: accelerations [rad/s^2], shape (k,); None for zeros.
            tau: torques in addition to those of the servo [N*m], shape (k,); None for zeros.
        """
        size = np.size(q)
        dq, ddq, tau = (np.zeros(size) if value is None else value for value in (dq, ddq, tau))
        given = cls(q, dq, np.ones(size, dtype=bool), ddq, tau)
        for name, value, kept, unit in (
            ("positions", q, given.q, "radians"),
            ("velocities", dq, given.dq, "radians per second"),
            ("accelerations", ddq, given.ddq, "radians per second squared"),
            ("torques", tau, given.tau, "newton metres"),
        ):
            if not np.isfinite(kept).all():
                raise TargetError(
                    f"arm {name} are {value}; give a finite number for each of Robot.arm_names, in {unit}"
                )
        return given

    @property
    def is_finite(self) -> bool:
        """Whether all numbers, those of the wrench too, are finite and not absurdly large."""
        given = [self.q, self.dq, self.ddq, self.tau]
        together = np.concatenate(given + [value for value in (self.kp, self.kd) if value is not None])
        known = self.wrench is FREE or (isinstance(self.wrench, HandWrench) and self.wrench.is_finite)
        return known and float(together.dot(together)) < _LARGEST_SQUARE  # a NaN fails the comparison

    @functools.cached_property
    def indicator(self) -> bool:
        """The paper's I(t): whether any arm joint is under external control."""
        return bool(self.mask.any())


_LARGEST_SQUARE = 1e12  # sum of the squares of all numbers; larger ones are no targets
_JOINT_VECTORS: dict[str, Shape] = {field.name: JOINTS for field in dataclasses.fields(JointCommand)}
_OPTIONAL = ("ddq", "tau", "kp", "kd")
_ARM_NUMBERS: dict[str, Shape] = dict.fromkeys(("q", "dq", *_OPTIONAL), JOINTS)


@runtime_checkable
class Controller(Protocol):
    """A whole-body controller.

    These four members are all that simulation, deployment, evaluation, viewer and command line require; a class need
    not inherit from this one. Properties that a controller may have beyond them (`hugwbc.runtime.guard.Guard`):

    - `phase`: the common phase of the gait (`hugwbc.gait`) in the current control period, in [0, 1), for pictures.
    - `footholds`: where the sole centre of each swing foot will land, world x and y [m], shape (2, 2); NaN for other
      feet; for pictures.
    - `planned_acceleration`: joint accelerations that the last command should cause [rad/s^2], shape (n,), or None,
      with which the state estimator lags less.
    - `stop`: by how much a stop moves the robot, if it is told to stand in the moment of a stride that `hugwbc.stride`
      tells, in the heading frame [m, m, rad], shape (3,), for behaviours that walk to a place.

    Attributes:
        name: short name for tables.
        period: time between two calls of `act` [s].
    """

    name: str
    period: float

    def reset(self, state: RobotState) -> None:
        """Forget the past and start from this state."""
        ...

    def act(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand | None:
        """Return the joint command for the next period, or None if there is none now. Never raise on bad numbers.

        For want of a command the guard holds the last one for a while, then damps the joints, and counts both.
        """
        ...


def check_controller(controller: Any, origin: str) -> tuple[str, float]:  # noqa: ANN401  of somebody else
    """Return name and period [s] of a controller; refuse an object that is none, from an origin for the message."""
    if isinstance(controller, type):
        raise ConfigError(f"{origin} gives the class {controller.__name__}; give an object of it")
    if not isinstance(controller, Controller):
        missing = [name for name in ("name", "period", "reset", "act") if not hasattr(controller, name)]
        what = f"a {type(controller).__name__} without {', '.join(missing)}"
        raise ConfigError(f"{origin} gives {what}; see hugwbc.controller.Controller")
    if not isinstance(controller.name, str) or not controller.name:
        raise ConfigError(f"{origin} has name = {controller.name!r}; give a short text for tables")
    period = number(controller.period)
    if period is None or not 0.0 < period < math.inf:
        raise ConfigError(f"{origin} has period = {controller.period!r}; give the time between two calls of act [s]")
    return controller.name, period


def override_arms(joint_command: JointCommand, upper_body: UpperBody, robot: Robot) -> JointCommand:
    """Return the command with the externally controlled arm joints driven as `upper_body` says.

    `hugwbc.runtime.guard.Guard` does this for every controller. A controller that also runs without it, and
    does not place external arm targets in its own output, calls it as the last step of `act`.
    """
    if not upper_body.indicator:
        return joint_command
    mask, joints = upper_body.mask, robot.arms[upper_body.mask]
    fields = {field.name: getattr(joint_command, field.name).copy() for field in dataclasses.fields(joint_command)}
    for name in ("q", "dq", "tau"):
        fields[name][joints] = getattr(upper_body, name)[mask]
    for name in ("kp", "kd"):
        given = getattr(upper_body, name)
        fields[name][joints] = getattr(robot, name)[joints] if given is None else given[mask]
    return JointCommand(**fields)
