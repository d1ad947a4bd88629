"""Verdicts on an episode: success, or the first milestone that was missed, and a score between 0 and 1."""

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np

from hugwbc.behaviours.source import FARTHEST, RAN_AWAY, Straying
from hugwbc.errors import ConfigError, HugwbcError
from hugwbc.extensions import described
from hugwbc.runtime.trace import RECORD_PERIOD
from hugwbc.tasks.record import TaskRecord, bumps

FELL = "the robot fell"
FASTEST = 0.15  # [m/s], of the pelvis at the end


@dataclasses.dataclass(frozen=True)
class Milestone:
    """One thing that an episode must show.

    Attributes:
        missed: what is said of an episode without it, such as "the box was not lifted". It holds no numbers, so that
            equal failures can be counted.
        progress: how much of it there was, in [0, 1]; 1 once it is reached. It is asked of the first sample, too,
            when nothing has happened yet.
    """

    missed: str
    progress: Callable[[TaskRecord], float]

    def __post_init__(self) -> None:
        if not isinstance(self.missed, str) or not self.missed:
            raise ConfigError(
                f"missed is {self.missed!r}; give what is said of an episode without the milestone, such as 'the box "
                "was not lifted'"
            )
        if not callable(self.progress):
            raise ConfigError(f"progress of '{self.missed}' is {self.progress!r}; give a function of a TaskRecord")

    def share(self, record: TaskRecord) -> float:
        """Return how much of it a record shows, in [0, 1]; NaN counts as 0."""
        try:
            value = float(self.progress(record))
        except HugwbcError:
            raise
        except Exception as error:  # the code of somebody else may raise anything
            raise ConfigError(
                f"the milestone '{self.missed}' cannot be judged: {described(error)}; give a number from 0 to 1 for "
                "every record, also for one in which nothing has happened yet"
            ) from error
        return min(max(value, 0.0), 1.0) if math.isfinite(value) else 0.0


@dataclasses.dataclass(frozen=True)
class Verdict:
    """A judge's verdict on one episode.

    Attributes:
        success: whether the task was done.
        reason: why not; empty for a success.
        detail: what the behaviour said when it failed, what happened to the objects, what besides the hands touched
            them, and after a failure where they ended.
        score: 1 for a success; otherwise the share of the milestones that were reached before the first missed one,
            which counts by its progress; 0.99 if none was missed.
    """

    success: bool
    reason: str
    detail: str
    score: float

    @property
    def words(self) -> str:
        """The verdict for people, such as "not done: the cup fell (put: timeout of 5 s)"."""
        outcome = "done" if self.success else f"not done: {self.reason}"
        return outcome + (f" ({self.detail})" if self.detail else "")


def judged(record: TaskRecord, milestones: Sequence[Milestone]) -> Verdict:
    """Return the verdict on an episode from its milestones, in the order in which they are due.

    A fall is a failure even after the last milestone. So is an object that left the world, physics that diverged, or a
    robot that runs away or does not come to rest.

    Args:
        record: the episode.
        milestones: at least one.
    """
    reached, reason = 0.0, ""
    for milestone in milestones:
        part = milestone.share(record)
        reached += part
        if part < 1.0:
            reason = milestone.missed
            break
    score = reached / len(milestones)

    def failed(why: str, score: float, *said: str) -> Verdict:
        return Verdict(False, why, "; ".join(filter(None, (*said, *bumps(record)))), score)

    if record.problems:
        return failed(without_time(record.problems[0]), min(score, 0.99), *record.problems)
    if record.fell:
        return failed(FELL, min(score, 0.99), reason or "at the end", record.ending.reason)
    if reason:
        return failed(reason, score, record.ending.reason)
    drift, speed = stillness(record)
    if drift > FARTHEST or speed > FASTEST:
        reason = RAN_AWAY if drift > FARTHEST else "the robot did not come to rest"
        return failed(reason, 0.99, f"{drift:.2f} m told to stand, {speed:.2f} m/s at the end")
    return Verdict(True, "", "; ".join(bumps(record)), 1.0)


def without_time(problem: str) -> str:
    """Return a problem of the objects without its time, so that equal ones count as one reason."""
    return problem.partition(" at ")[0]


def stillness(record: TaskRecord) -> tuple[float, float]:
    """Return how far a settled robot that is told to stand goes away at most [m], and its speed at the end [m/s]."""
    place, straying = record.pelvis[:, :2].tolist(), Straying()
    for told, at in zip(record.gait.tolist(), place, strict=True):
        straying.note(told, at, RECORD_PERIOD)
    last = place[-11:]  # 0.2 s
    return straying.farthest, math.dist(last[0], last[-1]) / (max(len(last) - 1, 1) * RECORD_PERIOD)


def within(value: float, allowed: float) -> float:
    """Return the progress of an error against its tolerance: 1 within it, less beyond it."""
    if not np.isfinite(value):
        return 0.0
    return 1.0 if value <= allowed else 0.9 * allowed / value


def longest(kept: np.ndarray) -> float:
    """Return the longest time for which something held without a break [s].

    Args:
        kept: whether it held, one value for each sample, shape (T,).
    """
    best = run = 0
    for good in kept.tolist():
        run = run + 1 if good else 0
        best = max(best, run)
    return best * RECORD_PERIOD


def at_end(values: np.ndarray) -> float:
    """Return the mean of the last 0.2 s of a quantity, shape (T,)."""
    count = round(0.2 / RECORD_PERIOD)
    return float(np.mean(values[-count:]))
