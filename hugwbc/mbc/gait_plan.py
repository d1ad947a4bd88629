"""Which foot stands and which swings: standing, the weight shift before the first step, and walking."""

import enum

import numpy as np

from hugwbc.gait import Gait, advance_phase, foot_phases


class Mode(enum.Enum):
    """What the plan is doing."""

    STANDING = "standing"
    SHIFTING = "shifting weight"
    WALKING = "walking"


def supported(gait: Gait) -> tuple[Gait, tuple[str, ...]]:
    """The gait that this controller executes for a commanded one, and a report if it is another."""
    if gait in (Gait.STANDING, Gait.WALKING):
        return gait, ()
    return Gait.WALKING, (f"gait {gait.label} is not in the model-based controller: using walking",)


class GaitPlan:
    """Gait clock of the model-based controller: modes change at the ends of steps only.

    Attributes:
        mode: what the plan is doing.
        phase: common phase of `hugwbc.gait`, in [0, 1); steps end at 0 and 0.5.
        frequency: stride frequency [Hz].
        swing: index of the foot in the air (0 left, 1 right), or None.
        elapsed: since the last change of mode or step [s].
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Stand."""
        self.mode = Mode.STANDING
        self.phase = 0.0
        self.frequency = 2.0
        self.swing: int | None = None
        self.elapsed = 0.0

    @property
    def step_time(self) -> float:
        """Duration of a step [s]: half a stride."""
        return 0.5 / self.frequency

    @property
    def remaining(self) -> float:
        """Time to the end of the step [s]; zero unless walking."""
        return (0.5 - self.phase % 0.5) / self.frequency if self.mode is Mode.WALKING else 0.0

    @property
    def stance(self) -> int | None:
        """Index of the foot that carries the step, or None when both do."""
        return None if self.swing is None else 1 - self.swing

    def advance(
        self, gait: Gait, frequency: float, dt: float, *, may_start: bool, may_stop: bool, first_swing: int = 0
    ) -> bool:
        """Move on by one tick.

        Args:
            gait: standing or walking, as commanded.
            frequency: stride frequency [Hz].
            dt: [s].
            may_start: whether the weight is where the first step needs it.
            may_stop: whether the robot can stand where the current step ends.
            first_swing: the foot that a walk starts with, 0 left or 1 right.

        Returns:
            Whether a foot lifts off now.
        """
        self.frequency = frequency
        self.elapsed += dt
        if self.mode is Mode.STANDING:
            if gait is Gait.WALKING:
                self._enter(Mode.SHIFTING)
            return False
        if self.mode is Mode.SHIFTING:
            if gait is Gait.STANDING:
                self._enter(Mode.STANDING)
            elif may_start:
                self._enter(Mode.WALKING, 0.5 * first_swing)
                return True
            return False
        step = self.phase >= 0.5
        self.phase = float(advance_phase(self.phase, frequency, dt))
        if (self.phase >= 0.5) is step:
            return False
        self.elapsed = 0.0
        if gait is Gait.STANDING and may_stop:
            self._enter(Mode.STANDING)
            return False
        self._set_swing()
        return True

    def _enter(self, mode: Mode, phase: float = 0.0) -> None:
        self.mode = mode
        self.elapsed = 0.0
        self.phase = phase
        self._set_swing()

    def _set_swing(self) -> None:
        if self.mode is Mode.WALKING:
            self.swing = int(np.argmax(foot_phases(self.phase, Gait.WALKING)))
        else:
            self.swing = None
