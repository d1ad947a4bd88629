"""How far the pelvis comes down for a long step."""

import math

import numpy as np

from hugwbc.mbc.command_filter import approach
from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.footsteps import Pendulum, StepPlan
from hugwbc.mbc.params import ControllerParams
from hugwbc.robot import SIDES

_HIPS = tuple(f"{side}_hip_pitch_link" for side in SIDES)
_ANKLE_HEIGHT = 0.07  # [m], above the sole


class Crouch:
    """Lowers the pelvis so that at the end of a long step both legs reach the ground.

    A pushed robot steps further than its legs reach from the commanded height: the foot would come down late, and the
    trailing leg, straight, could not be lifted. Steps within the commands' ranges need none of this.

    Attributes:
        depth: by which the pelvis is lower than commanded [m].
        rate: of the depth [m/s].
    """

    def __init__(self, params: ControllerParams) -> None:
        self._params = params
        self.reset()

    def reset(self) -> None:
        """Upright."""
        self.depth = self.rate = 0.0
        self._needed = 0.0

    def advance(self, dt: float) -> None:
        """Go down as far as the last `prepare` asked for, or, more slowly, up again if none did since."""
        params = self._params
        limits = params.crouch_rate if self._needed > self.depth else params.rise_rate
        if self._needed or self.depth or self.rate:
            self.depth, self.rate = approach(self.depth, self.rate, self._needed, limits, dt)
        self._needed = 0.0

    def prepare(
        self, dynamics: Dynamics, pendulum: Pendulum, step: StepPlan, swing: int, remaining: float, height: float
    ) -> None:
        """See what a step needs.

        Args:
            dynamics: updated.
            pendulum: about the stance foot.
            step: as planned.
            swing: the foot in the air, 0 left or 1 right.
            remaining: to the end of the step [s].
            height: of the pelvis above the stance sole, without a crouch [m].
        """
        x, y = (step.foothold - pendulum.pivot).tolist()
        if math.hypot(x, y) <= self._params.long_step:
            return
        pelvis = dynamics.position("pelvis")
        travel = pendulum.com_after(step.cop, remaining) - pendulum.com
        for foot, pivot in ((1 - swing, pendulum.pivot), (swing, step.foothold)):
            hip = dynamics.position(_HIPS[foot])
            above = height + float(hip[2] - pelvis[2]) - _ANKLE_HEIGHT
            self._needed = max(self._needed, above - self._hip_height(hip[:2] + travel - pivot))
        self._needed = min(self._needed, self._params.max_crouch)

    def _hip_height(self, offset: np.ndarray) -> float:
        """Greatest height of a hip above an ankle this far away along the ground [m]."""
        return math.sqrt(max(self._params.leg_length**2 - float(offset.dot(offset)), 0.0))
