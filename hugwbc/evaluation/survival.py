"""Search for the largest load that is survived often enough, with as few trials as the answer needs."""

import math

FIRST_TRIALS = 8  # of a load before the first look at the outcome; the number then doubles
DOUBT = 0.001  # a load is decided early if an outcome as extreme as the one seen is less probable than this


class SurvivalSearch:
    """Search for the largest load at which at least a share `survival` of `trials` trials is survived.

    Use it in a loop: read `load` and `numbers`, run these trials, pass the outcome to `record`, until `done`. The load
    doubles from `first` until it is too large and is bisected from there, which assumes that survival falls with the
    load. Using the same random numbers for the same trial number at every load makes this nearly true for few trials.

    The outcome is examined after 8, 16, 32, ... trials. A load is decided early if the remaining trials cannot change
    the answer, or if the outcome so far has a probability below `DOUBT` at a survival of exactly the required share
    (exact binomial test).

    Attributes:
        tolerated: largest load that was survived often enough; 0 if none was.
        refused: smallest load that was not survived often enough; None if there is none up to `limit`.
    """

    def __init__(
        self, *, trials: int, survival: float = 0.98, first: float, limit: float, resolution: float = 0.05
    ) -> None:
        """Start the search.

        Args:
            trials: number of trials of a load.
            survival: share of them that has to be survived.
            first: first load to try.
            limit: largest load to try.
            resolution: relative width of the bracket at which the search ends.
        """
        self.tolerated = 0.0
        self.refused: float | None = None
        self._trials = trials
        self._risk = 1.0 - survival
        self._first, self._limit, self._resolution = first, limit, resolution
        self._count = self._failed = 0

    @property
    def done(self) -> bool:
        """Whether the answer is known."""
        if self.refused is None:
            return self.tolerated >= self._limit
        return self.refused - self.tolerated <= self._resolution * max(self.tolerated, self._first)

    @property
    def load(self) -> float:
        """The load to try next."""
        if self.refused is not None:
            return 0.5 * (self.tolerated + self.refused)
        return min(2.0 * self.tolerated or self._first, self._limit)

    @property
    def numbers(self) -> range:
        """The numbers of the trials to run next at `load`."""
        return range(self._count, min(max(FIRST_TRIALS, 2 * self._count), self._trials))

    def record(self, survived: list[bool]) -> None:
        """Take the outcome of the trials of `numbers`, in their order."""
        self._count += len(survived)
        self._failed += len(survived) - sum(survived)
        verdict = self._verdict()
        if verdict is None:
            return
        if verdict:
            self.tolerated = self.load
        else:
            self.refused = self.load
        self._count = self._failed = 0

    def _verdict(self) -> bool | None:
        """Return whether the load is tolerated; None if it takes more trials to tell."""
        allowed = math.floor(self._risk * self._trials + 1e-9)
        if self._failed > allowed:
            return False
        if self._failed + self._trials - self._count <= allowed:
            return True
        if self._risk > 0.0:
            if 1.0 - _binomial_cdf(self._failed - 1, self._count, self._risk) < DOUBT:
                return False
            if _binomial_cdf(self._failed, self._count, self._risk) < DOUBT:
                return True
        return None


def _binomial_cdf(k: int, n: int, p: float) -> float:
    """Return the probability of at most k successes in n trials of probability p in (0, 1)."""

    def log_mass(i: int) -> float:
        ways = math.lgamma(n + 1) - math.lgamma(i + 1) - math.lgamma(n - i + 1)
        return ways + i * math.log(p) + (n - i) * math.log1p(-p)

    return math.fsum(math.exp(log_mass(i)) for i in range(k + 1))
