"""Running figures of training: reward terms, tracking errors, episodes; and the averages that open the curricula."""

import math

import torch

from hugwbc.commands import COMMAND_NAMES
from hugwbc.gait import Gait
from hugwbc.learned.env.readings import TRACKED, tracked
from hugwbc.learned.env.transition import Transition

TRACKING_MEMORY = 0.99  # of the exponential averages of the tracking rewards, per control step
_COLUMNS = [COMMAND_NAMES.index(name) for name in TRACKED]
_EVENTS = ("episodes", "falls", "diverged")


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
        self._levels: dict[str, float] = {}
        self._start_anew()

    def _start_anew(self) -> None:
        self._sums: dict[str, tuple[float, float]] = {}  # of each average: total, and of how many
        self._events = dict.fromkeys(_EVENTS, 0.0)
        self._finished_steps = 0.0

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
        for name, value in rewards.items():
            self._average(f"reward/{name}", float(value.mean()), 1.0)
        errors = (tracked(t, self._waist) - t.command[:, _COLUMNS]).abs()
        known = errors.isfinite().all(1)
        for label, (first, last) in self._gaits.items():
            robots = known & (gait >= first) & (gait <= last)
            for name, total in zip(TRACKED, errors[robots].sum(0).tolist(), strict=True):
                self._average(f"{label}_error/{name}", total, float(robots.sum()))
        happened = (finished_age.numel(), t.fallen.sum(), diverged.sum())
        for name, number in zip(_EVENTS, happened, strict=True):
            self._events[name] += float(number)
        self._finished_steps += float(finished_age.sum())

    def add_share(self, name: str, flag: torch.Tensor, robots: torch.Tensor) -> None:
        """Add the part of some robots for which a flag is set; both arguments of shape (n,), bool."""
        self._average(name, float((flag & robots).sum()), float(robots.sum()))

    def _average(self, name: str, total: float, count: float) -> None:
        before, samples = self._sums.get(name, (0.0, 0.0))
        # What is not finite is of a robot whose physics failed.
        self._sums[name] = (before + total, samples + count) if math.isfinite(total) else (before, samples)

    def set_level(self, name: str, value: float) -> None:
        """A level that `pop` reports as it is, not as an average."""
        self._levels[name] = value

    def pop(self) -> dict[str, float]:
        """Averages since the last call, NaN of nothing; numbers of events, mean length of episodes; then start anew."""
        result = {name: total / count if count else math.nan for name, (total, count) in self._sums.items()}
        episodes = self._events["episodes"]
        result |= self._events | {"episode_length": self._finished_steps / episodes if episodes else math.nan}
        self._start_anew()
        return result | self._levels
