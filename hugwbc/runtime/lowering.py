"""Controlled kneel after loss of the state estimate, followed by damping of the joints.

The knees and the toes carry a kneeling robot without any balance. Its thighs stand upright on them, so that the trunk
keeps the walk's momentum only while the legs fold. Then the stiffness fades against strong damping:
joints that are damped as usual let the trunk of a kneeling robot fall.
"""

import dataclasses

import numpy as np

from hugwbc.blends import smooth_step
from hugwbc.controller import JointCommand
from hugwbc.robot import SIDES, Robot
from hugwbc.state import RobotState

_FINAL_DAMPING_TIME = 0.1  # [s], in which the damping grows when the stiffness begins to fade


@dataclasses.dataclass(frozen=True)
class LoweringParams:
    """Settings of the kneel.

    Attributes:
        time: until the legs are folded [s].
        hip, knee, ankle: joint positions of the folded legs [rad].
        stiffness: of the joints, as a multiple of the robot's own.
        damping: of the joints on the way, as a multiple of the robot's own.
        hold: how long the folded legs are held [s].
        fade: time in which the stiffness then goes to zero [s].
        final_damping: of the joints from then on, as a multiple of the robot's own.
    """

    time: float = 0.35
    hip: float = 0.1
    knee: float = 2.0
    ankle: float = 0.5
    stiffness: float = 1.0
    damping: float = 2.0
    hold: float = 1.0
    fade: float = 1.0
    final_damping: float = 4.0


class Lowering:
    """One kneel; it needs encoders only at its start, and no IMU."""

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
        resting = self._elapsed - params.time - params.hold
        q = self._from + smooth_step(self._elapsed / params.time) * (self._folded - self._from)
        stiffness = params.stiffness * (1.0 - smooth_step(resting / params.fade))
        growth = (params.final_damping - params.damping) * smooth_step(resting / _FINAL_DAMPING_TIME)
        zero = np.zeros_like(robot.kd)
        return JointCommand(q=q, dq=zero, kp=stiffness * robot.kp, kd=(params.damping + growth) * robot.kd, tau=zero)
