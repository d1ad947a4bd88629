"""A way down for a robot that no longer knows its state: it kneels, and then only slows its joints.

The knees and the toes carry a kneeling robot without any balance. It goes down in three parts, each by the motors' own
position control, for which nothing has to be known:

- It crouches. The leg that swings is put down ahead, where it brakes the walk; the other one goes onto its toes.
- It folds both legs, so that the knees reach the ground before the robot has tipped over its toes.
- It holds the posture until it rests. Then the stiffness fades, against strong damping: from a kneeling posture, joints
  that are damped as usual let the trunk fall.
"""

import dataclasses
import math

import numpy as np

from hugwbc.blends import smooth_step
from hugwbc.controller import JointCommand
from hugwbc.robot import SIDES, Robot
from hugwbc.state import RobotState

_FINAL_DAMPING_TIME = 0.1  # [s], in which the damping grows when the stiffness begins to fade


@dataclasses.dataclass(frozen=True)
class LegPosture:
    """Joint positions of a leg [rad], clipped to the joints' ranges.

    Attributes:
        spread: of the hip's roll joint; positive moves the foot outwards.
        hip, knee, ankle: of the pitch joints.
    """

    spread: float
    hip: float
    knee: float
    ankle: float


@dataclasses.dataclass(frozen=True)
class LoweringParams:
    """How the robot goes down.

    Attributes:
        crouch_time, fold_time: durations of the first two parts [s].
        swinging_crouch, standing_crouch: the legs' postures after the first part.
        swinging_fold, standing_fold: the legs' postures after the second part.
        stiffness: of the joints until they are only damped, as a multiple of the robot's own.
        damping: of the joints on the way, as a multiple of the robot's own.
        hold: how long the folded legs are held [s].
        fade: time in which the stiffness then goes to zero [s].
        final_damping: of the joints from then on, as a multiple of the robot's own.
    """

    crouch_time: float = 0.07
    fold_time: float = 0.21
    swinging_crouch: LegPosture = LegPosture(0.17, -0.74, 1.38, -0.53)
    standing_crouch: LegPosture = LegPosture(-0.06, -0.27, 1.39, 0.38)
    swinging_fold: LegPosture = LegPosture(0.17, 0.49, 2.05, 0.52)
    standing_fold: LegPosture = LegPosture(-0.06, 0.34, 2.05, 0.52)
    stiffness: float = 0.72
    damping: float = 1.8
    hold: float = 1.0
    fade: float = 1.0
    final_damping: float = 4.0


class Lowering:
    """One way down; it needs encoders no further than for where it begins, and no IMU."""

    def __init__(self, robot: Robot, params: LoweringParams | None = None) -> None:
        """Set up for a robot that does not go down yet."""
        self._robot, self.params = robot, params or LoweringParams()
        self._from: np.ndarray | None = None
        self._crouched = self._folded = robot.nominal
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
            left = swings_left(robot, self._from)
            self._crouched = self._posture(params.swinging_crouch, params.standing_crouch, left=left)
            self._folded = self._posture(params.swinging_fold, params.standing_fold, left=left)
        self._elapsed += period
        folding = self._elapsed - params.crouch_time
        resting = folding - params.fold_time - params.hold
        q = self._from + smooth_step(self._elapsed / params.crouch_time) * (self._crouched - self._from)
        q = q + smooth_step(folding / params.fold_time) * (self._folded - self._crouched)
        stiffness = params.stiffness * (1.0 - smooth_step(resting / params.fade))
        growth = (params.final_damping - params.damping) * smooth_step(resting / _FINAL_DAMPING_TIME)
        zero = np.zeros_like(robot.kd)
        return JointCommand(
            q=q, dq=zero, kp=stiffness * robot.kp, kd=(params.damping + growth) * robot.kd, tau=zero.copy()
        )

    def _posture(self, swinging: LegPosture, standing: LegPosture, *, left: bool) -> np.ndarray:
        """Return the joint positions [rad], shape (19,); `left` tells which leg swings."""
        robot, q = self._robot, self._robot.nominal.copy()
        for side, outwards, leg in zip(
            SIDES, (1.0, -1.0), (swinging, standing) if left else (standing, swinging), strict=True
        ):
            names = [f"{side}_{name}_joint" for name in ("hip_roll", "hip_pitch", "knee", "ankle")]
            q[robot.indices(names)] = outwards * leg.spread, leg.hip, leg.knee, leg.ankle
        return np.clip(q, robot.lower, robot.upper)


def swings_left(robot: Robot, q: np.ndarray) -> bool:
    """Return whether the left ankle is higher than the right one, below a pelvis without pitch.

    Thigh and shank are equally long, so that the ankle is l (cos(hip) + cos(hip + knee)) below the hip.

    Args:
        robot: names of the joints.
        q: joint positions [rad], shape (19,).
    """
    left, right = (
        math.cos(hip) + math.cos(hip + knee)
        for hip, knee in (q[robot.indices([f"{side}_hip_pitch_joint", f"{side}_knee_joint"])] for side in SIDES)
    )
    return left < right
