"""The largest load that is survived often enough: doubling, then bisection, with as few trials as the answer needs."""

import math

from hugwbc.errors import ConfigError

FIRST_TRIALS = 8  # of a load, before the first look at the outcome; then twice as many, and so on
_FAR_TRIALS = 64  # at most, of most loads that are not beside the answer
DOUBT = 0.001  # probability of outcomes as extreme as the one seen, below which a load is decided early


class SurvivalSearch:
    """Finds the largest load at which at least a share `survival` of `trials` trials is survived.

    Ask for `load` and `numbers`, run the trials, tell `record`, until `done`. Loads double from `first` until one is
    too much, and are bisected from there: survival is taken to fall with the load. To make that nearly so for few
    trials, use the same random numbers for a trial's number at every load.

    Looks at the outcome come after 8, 16, 32, ... trials. A load is decided early if the rest cannot change the answer,
    or if the outcome has a probability below `DOUBT` at a survival of just the share (exact binomial test).

    Attributes:
        tolerated: largest load that was survived often enough; 0 if none was.
        refused: smallest load that was not; None if there is none up to `limit`.
    """

    def __init__(
        self, *, trials: int, survival: float = 0.98, first: float, limit: float, resolution: float = 0.05
    ) -> None:
        """Set up.

        Args:
            trials: of a load.
            survival: share of them to survive.
            first: load to begin with.
            limit: largest load.
            resolution: relative width of the bracket at which the search ends.

        Raises:
            ConfigError: if a value is out of range.
        """
        if trials < 1 or not 0.0 < survival <= 1.0:
            raise ConfigError(f"{trials} trials and a survival of {survival}; give 1 or more, and a share up to 1")
        if not 0.0 < first <= limit < math.inf or not 0.0 < resolution < 1.0:
            raise ConfigError(
                f"loads from {first} to {limit} with a resolution of {resolution}; give 0 < first <= limit, finite, "
                "and a resolution between 0 and 1"
            )
        self.tolerated = 0.0
        self.refused: float | None = None
        self._trials = trials
        self._risk = 1.0 - survival
        self._first, self._limit, self._resolution = first, limit, resolution
        self._count = self._failed = 0

    @property
    def most_loads(self) -> int:
        """How many loads are tried at most."""
        doublings = math.ceil(math.log2(self._limit / self._first))
        # Below `first`, bisection goes on until the bracket is narrower than `first` times the resolution.
        return 1 + doublings + math.ceil(math.log2(1.0 / self._resolution))

    @property
    def likely_trials(self) -> int:
        """About how many trials it takes: all of them at two loads beside the answer, few at the others."""
        loads = self.most_loads
        return min(loads, 2) * self._trials + max(loads - 2, 0) * min(self._trials, _FAR_TRIALS)

    @property
    def done(self) -> bool:
        """Whether the answer is known."""
        if self.refused is None:
            return self.tolerated >= self._limit
        return self.refused - self.tolerated <= self._resolution * max(self.tolerated, self._first)

    @property
    def load(self) -> float:
        """To try next."""
        if self.refused is not None:
            return 0.5 * (self.tolerated + self.refused)
        return min(2.0 * self.tolerated or self._first, self._limit)

    @property
    def numbers(self) -> range:
        """Numbers of the trials to run next, at `load`."""
        return range(self._count, min(max(FIRST_TRIALS, 2 * self._count), self._trials))

    def record(self, survived: list[bool]) -> None:
        """Take the outcome of the trials that were asked for, in their order."""
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
    """Probability of at most k successes in n trials of probability p in (0, 1)."""

    def log_mass(i: int) -> float:
        ways = math.lgamma(n + 1) - math.lgamma(i + 1) - math.lgamma(n - i + 1)
        return ways + i * math.log(p) + (n - i) * math.log1p(-p)

    return math.fsum(math.exp(log_mass(i)) for i in range(k + 1))
