"""Behaviours made of others: one after another, hands while walking, again after a failure, until something happens."""

from collections.abc import Sequence as SequenceOf

from hugwbc.errors import ConfigError
from hugwbc.scripts.behaviours.behaviour import Behaviour, Course, Failure, Status, check_hold, check_time, run
from hugwbc.scripts.behaviours.conditions import Condition, Elapsed
from hugwbc.scripts.behaviours.view import Action, View, at_rest

MOST_TIMES = 100  # of a retry


class Composite(Behaviour):
    """A behaviour made of others; `current` is the one that runs."""

    current: Behaviour | None = None

    @property
    def step(self) -> str:  # noqa: D102
        return self.label if self.current is None else self.current.step

    def run(self, child: Behaviour, view: View) -> Course:
        """Run a child as `behaviour.run` does."""
        self.current = child
        return run(child, view)


class Sequence(Composite):
    """Behaviours one after another; the first failure ends it."""

    def __init__(self, *steps: Behaviour, name: str = "sequence", about: str = "") -> None:
        """Take at least one behaviour.

        Args:
            steps: the behaviours.
            name: for files and tables.
            about: a description for people.
        """
        if not steps:
            raise ConfigError("a sequence is empty; give it at least one step")
        self.steps, self.name, self.about = steps, name, about

    @property
    def label(self) -> str:  # noqa: D102
        return self.name

    def course(self, view: View) -> Course:  # noqa: D102
        for child in self.steps:
            view = yield from self.run(child, view)
        return view


class Parallel(Composite):
    """Walking and the work of the hands at the same time.

    The command is that of `legs`, the targets of the hands and the grips are those of `hands`. It is done when both
    are; a failure of one ends the other.
    """

    def __init__(self, legs: Behaviour, hands: Behaviour) -> None:
        """Take one behaviour for the legs, such as `WalkTo`, and one for the hands, such as `Reach`."""
        self.legs, self.hands = legs, hands

    @property
    def step(self) -> str:  # noqa: D102
        return f"{self.legs.step} and {self.hands.step}"

    def course(self, view: View) -> Course:  # noqa: D102
        for child in (self.legs, self.hands):
            child.begin(view)
        while True:
            legs, hands = self.legs.update(view), self.hands.update(view)
            for child in (self.legs, self.hands):
                if child.status is Status.FAILURE:
                    raise Failure(child.reason, child.label)
            if self.legs.status is self.hands.status is Status.SUCCESS:
                return view
            view = yield Action(legs.command, hands.hands, hands.grips)


class Retry(Composite):
    """A behaviour that is tried again after a failure, up to a number of times in all.

    `between` runs after each failure but the last, such as a step back; a failure of it ends the retries.
    """

    def __init__(self, do: Behaviour, times: int = 3, between: Behaviour | None = None) -> None:
        """Take the behaviour and how often it may be tried."""
        if not 1 <= times <= MOST_TIMES:
            raise ConfigError(f"times is {times}; give 1 or more, up to {MOST_TIMES}")
        self.behaviour, self.times, self.between = do, times, between

    def course(self, view: View) -> Course:  # noqa: D102
        for attempt in range(1, self.times + 1):
            try:
                return (yield from self.run(self.behaviour, view))
            except Failure as failure:
                if attempt == self.times:
                    times = "once" if attempt == 1 else f"{attempt} times"
                    raise Failure(f"{failure} (tried {times})", failure.label) from None
            # A tick for each try: those that fail at once must not keep the control loop waiting.
            view = yield at_rest(self.view)
            if self.between is not None:
                view = yield from self.run(self.between, view)
        raise AssertionError("unreachable")


class OnFailure(Composite):
    """A behaviour, and what to do if it fails.

    `then` runs after the failure: with `recovers`, its success is that of the whole; otherwise it only tidies up, such
    as putting a box down, and the whole fails with the first reason.
    """

    def __init__(self, do: Behaviour, then: Behaviour, *, recovers: bool = True) -> None:
        """Take both behaviours."""
        self.behaviour, self.then, self.recovers = do, then, recovers

    def course(self, view: View) -> Course:  # noqa: D102
        try:
            return (yield from self.run(self.behaviour, view))
        except Failure as failure:
            first = failure
        view = yield from self.run(self.then, self.view)
        if not self.recovers:
            raise first
        return view


class WaitUntil(Behaviour):
    """Nothing but waiting until a condition holds for a while: the robot stands and keeps its hands where they are."""

    def __init__(self, condition: Condition, timeout: float = 10.0, hold: float = 0.0) -> None:
        """Wait for a condition that holds for `hold` [s] without a break."""
        check_time("timeout", timeout)
        check_hold(hold, timeout)
        if isinstance(condition, Elapsed) and condition.seconds + hold >= timeout:
            wait = f"seconds {condition.seconds:g} and a hold of {hold:g}"
            raise ConfigError(f"elapsed with {wait} cannot come before the timeout of {timeout:g} s; give a longer one")
        self.condition, self.timeout, self.hold = condition, timeout, hold

    def course(self, view: View) -> Course:  # noqa: D102
        since: float | None = None
        begin = view
        while True:
            met, self.progress = self.condition(view, begin)
            since = None if not met else view.time if since is None else since
            if since is not None and view.time - since >= self.hold - 1e-9:  # sums of ticks are rounded
                return view
            view = yield at_rest(view)


def in_order(steps: SequenceOf[Behaviour], name: str = "sequence") -> Behaviour:
    """Return the steps one after another; a single step is itself."""
    return steps[0] if len(steps) == 1 else Sequence(*steps, name=name)
