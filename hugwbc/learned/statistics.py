"""Running figures of training: reward terms, tracking errors, episodes; and the averages that open the curricula."""

import math

import torch

from hugwbc.commands import COMMAND_NAMES
from hugwbc.gait import Gait
from hugwbc.learned.transition import Transition

TRACKING_MEMORY = 0.99  # of the exponential averages of the tracking rewards, per control step
_MEASURED_COLUMNS = tuple(COMMAND_NAMES.index(name) for name in ("v_x", "v_y", "omega", "h", "p", "w"))
_COUNTS = ("episodes", "falls", "diverged", "finished_steps")


class Statistics:
    """Sums over control steps, and per-robot averages of the tracking rewards.

    Attributes:
        tracking: exponential averages of the linear and angular tracking reward relative to their maxima, shape (n, 2).
    """

    def __init__(self, count: int, waist: int, *, hopping: bool = False) -> None:
        """Start empty.

        Args:
            count: number of robots.
            waist: index of the waist joint.
            hopping: whether the errors of hopping robots are figures too, beside those of walking ones.
        """
        self.tracking = torch.zeros(count, 2)
        self._gaits = {"walking": (Gait.WALKING, Gait.WALKING)}
        if hopping:
            self._gaits["hopping"] = (Gait.HOPPING_LEFT, Gait.HOPPING_RIGHT)
        self._waist = waist
        self._sums: dict[str, float] = {}
        self._steps = 0
        self._levels: dict[str, float] = {}

    def add(
        self,
        rewards: dict[str, torch.Tensor],
        tracking: torch.Tensor,
        t: Transition,
        gait: torch.Tensor,
        finished_age: torch.Tensor,
        diverged: torch.Tensor,
    ) -> None:
        """Add a control step.

        Args:
            rewards: weighted terms, each of shape (n,).
            tracking: linear and angular tracking reward relative to their maxima, shape (n, 2).
            t: the transition.
            gait: values of `Gait`, shape (n,).
            finished_age: steps of the episodes that ended, shape (number of those,).
            diverged: robots whose physics failed, shape (n,), bool.
        """
        self.tracking = TRACKING_MEMORY * self.tracking + (1.0 - TRACKING_MEMORY) * torch.nan_to_num(tracking)
        values = {f"reward/{name}": float(value.mean()) for name, value in rewards.items()}
        for label, (first, last) in self._gaits.items():
            errors = self._errors(t, (gait >= first) & (gait <= last))
            for column, error in zip(_MEASURED_COLUMNS, errors, strict=True):
                values[f"{label}_error/{COMMAND_NAMES[column]}"] = error
        values["episodes"] = float(finished_age.numel())
        values["falls"] = float(t.fallen.sum())
        values["diverged"] = float(diverged.sum())
        values["finished_steps"] = float(finished_age.sum())
        for name, value in values.items():
            if math.isfinite(value):
                self._sums[name] = self._sums.get(name, 0.0) + value
        self._steps += 1

    def add_share(self, name: str, flag: torch.Tensor, robots: torch.Tensor) -> None:
        """Add the part of some robots for which a flag is set, after `add`; both arguments of shape (n,), bool."""
        share = float((flag & robots).sum()) / max(float(robots.sum()), 1.0)
        self._sums[name] = self._sums.get(name, 0.0) + share

    def set_level(self, name: str, value: float) -> None:
        """A level that `pop` reports as it is, not as an average."""
        self._levels[name] = value

    def _errors(self, t: Transition, robots: torch.Tensor) -> list[float]:
        weight = robots.float()
        measured = (t.velocity[:, 0], t.velocity[:, 1], t.yaw_rate, t.height, t.pitch, t.q[:, self._waist])
        error = (torch.stack(measured, dim=1) - t.command[:, _MEASURED_COLUMNS]).abs()
        return ((error * weight[:, None]).sum(0) / weight.sum().clamp(min=1.0)).tolist()

    def pop(self) -> dict[str, float]:
        """Averages per step since the last call, and sums and mean length of episodes; then start anew."""
        sums, steps = self._sums, max(self._steps, 1)
        self._sums, self._steps = {}, 0
        result = {name: value / steps for name, value in sums.items() if name not in _COUNTS}
        result |= {name: sums.get(name, 0.0) for name in ("episodes", "falls", "diverged")}
        result["episode_length"] = sums.get("finished_steps", 0.0) / max(sums.get("episodes", 0.0), 1.0)
        return result | self._levels
