"""A way down for a robot that no longer knows its state: it kneels, and then only slows its joints.

The knees and the toes carry a kneeling robot without any balance. Its thighs stand upright on them, so that the trunk
keeps its momentum of a walk for no longer than the legs fold.
"""

import dataclasses

import numpy as np

from hugwbc.blends import smooth_step
from hugwbc.controller import JointCommand
from hugwbc.robot import SIDES, Robot
from hugwbc.state import RobotState


@dataclasses.dataclass(frozen=True)
class LoweringParams:
    """How the robot goes down.

    Attributes:
        time: until the legs are folded [s].
        hip, knee, ankle: joint positions of the folded legs [rad].
        stiffness: of the joints, as a multiple of the robot's own.
        damping: of the joints on the way and afterwards, as a multiple of the robot's own.
        hold: how long the folded legs are held before the joints are only damped [s].
    """

    time: float = 0.35
    hip: float = 0.1
    knee: float = 2.0
    ankle: float = 0.5
    stiffness: float = 1.0
    damping: float = 2.0
    hold: float = 1.0


class Lowering:
    """One way down; it needs encoders no further than for where it begins, and no IMU."""

    def __init__(self, robot: Robot, params: LoweringParams | None = None) -> None:
        """Set up for a robot that does not go down yet."""
        self._robot, self.params = robot, params or LoweringParams()
        self._folded = robot.nominal.copy()
        for name, position in (
            ("hip_pitch", self.params.hip),
            ("knee", self.params.knee),
            ("ankle", self.params.ankle),
        ):
            self._folded[robot.indices([f"{side}_{name}_joint" for side in SIDES])] = position
        self._folded = np.clip(self._folded, robot.lower, robot.upper)
        self._from: np.ndarray | None = None
        self._elapsed = 0.0

    @property
    def begun(self) -> bool:
        """Whether the robot is on its way down, or has arrived."""
        return self._from is not None

    def command(self, state: RobotState, period: float) -> JointCommand:
        """Return the joint command of the next period [s]; the first call begins at the joints' estimated positions."""
        robot, params = self._robot, self.params
        if self._from is None:
            self._from = np.where(np.isfinite(state.q), state.q, robot.nominal)
        self._elapsed += period
        zero, kd = np.zeros_like(robot.kd), params.damping * robot.kd
        q = self._from + smooth_step(min(self._elapsed / params.time, 1.0)) * (self._folded - self._from)
        stiff = params.stiffness if self._elapsed < params.time + params.hold else 0.0
        return JointCommand(q=q, dq=zero, kp=stiff * robot.kp, kd=kd, tau=zero)
