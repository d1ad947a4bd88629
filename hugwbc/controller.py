"""The message to the joints, the external upper body, and the interface that every controller implements."""

import dataclasses
from typing import Protocol, runtime_checkable

import numpy as np

from hugwbc.commands import Command
from hugwbc.errors import TargetError
from hugwbc.robot import Robot
from hugwbc.state import RobotState


@dataclasses.dataclass(frozen=True, eq=False)
class JointCommand:
    """What a joint receives: torque = tau + kp (q - q_measured) + kd (dq - dq_measured), then limited.

    The same five vectors as a Unitree robot's low-level command; each of shape (19,), in the robot's joint order.

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

    @classmethod
    def position(cls, robot: Robot, q: np.ndarray) -> "JointCommand":
        """Hold joint positions with the robot's nominal gains and no feed-forward."""
        zero = np.zeros_like(robot.kp)
        return cls(q=q, dq=zero, kp=robot.kp, kd=robot.kd, tau=zero)

    @property
    def is_finite(self) -> bool:
        """Whether all five vectors hold finite numbers only."""
        return all(np.all(np.isfinite(getattr(self, field.name))) for field in dataclasses.fields(self))


@dataclasses.dataclass(frozen=True, eq=False)
class UpperBody:
    """External control of the arms: from IK, a motion file or noise. `UpperBody.none()` leaves them to the controller.

    Attributes:
        q: targets of the eight arm joints (order of `Robot.arms`) [rad], shape (8,).
        dq: their velocities [rad/s], shape (8,).
        mask: which of the eight are taken over, shape (8,), bool.
    """

    q: np.ndarray
    dq: np.ndarray
    mask: np.ndarray

    @classmethod
    def none(cls) -> "UpperBody":
        """No external control."""
        return cls(np.zeros(8), np.zeros(8), np.zeros(8, dtype=bool))

    @classmethod
    def targets(cls, q: np.ndarray, dq: np.ndarray | None = None) -> "UpperBody":
        """Take over both arms.

        Raises:
            TargetError: if the targets are not eight finite numbers.
        """
        q = np.asarray(q, dtype=float)
        dq = np.zeros(8) if dq is None else np.asarray(dq, dtype=float)
        for name, value in (("positions", q), ("velocities", dq)):
            if value.shape != (8,) or not np.all(np.isfinite(value)):
                raise TargetError(
                    f"arm {name} are {value}; give eight finite numbers in the order of Robot.arm_names, in radians"
                )
        return cls(q, dq, np.ones(8, dtype=bool))

    @property
    def indicator(self) -> bool:
        """The paper's I(t): whether any arm joint is under external control."""
        return bool(self.mask.any())


@runtime_checkable
class Controller(Protocol):
    """A whole-body controller. Simulation, safety, evaluation, viewer and command line know nothing else of it.

    Attributes:
        name: short name for tables.
        period: time between two calls of `act` [s].

    Two more members are shown in pictures where a controller has them: `phase`, the common phase of its gait
    (`hugwbc.gait`), and `footholds`, where the soles of the feet in the air are to land (`hugwbc.runtime.moment`).
    Where it has `planned_acceleration`, what its last command is to do to the joints [rad/s^2], shape (19,), or None,
    the state estimator follows the joints more closely.
    """

    name: str
    period: float

    def reset(self, state: RobotState) -> None:
        """Forget the past and start from this state."""
        ...

    def act(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand:
        """The joint command for the next period. Never raises on bad numbers: clamps, falls back, counts."""
        ...


def override_arms(joint_command: JointCommand, upper_body: UpperBody, robot: Robot) -> JointCommand:
    """The command with the arm joints under external control set to their targets, at the robot's nominal arm gains.

    For controllers that, like the learned one, do not place external arm targets in their own output.
    """
    if not upper_body.indicator:
        return joint_command
    joints = robot.arms[upper_body.mask]
    fields = {field.name: getattr(joint_command, field.name).copy() for field in dataclasses.fields(joint_command)}
    fields["q"][joints] = upper_body.q[upper_body.mask]
    fields["dq"][joints] = upper_body.dq[upper_body.mask]
    fields["kp"][joints], fields["kd"][joints] = robot.kp[joints], robot.kd[joints]
    fields["tau"][joints] = 0.0
    return JointCommand(**fields)
