"""The base of all behaviours: steps that end by what happens, not by the clock."""

import abc
import enum
import math
import re
from collections.abc import Generator, Mapping

from hugwbc.errors import ConfigError
from hugwbc.scripts.behaviours.view import Action, SeenObject, View, at_rest

LONGEST_TIME = 3600.0  # [s], of a timeout or a wait: what never ends cannot fail with a reason

Course = Generator[Action, View, View]
"""How a behaviour runs: it yields an action for every view that it is sent, and returns the last view."""


class Status(enum.Enum):
    """Where a behaviour stands."""

    RUNNING = "running"
    SUCCESS = "success"
    FAILURE = "failure"


class Failure(Exception):  # noqa: N818  an outcome, not an error of the program
    """The end of a behaviour that did not do what it should; its text is the reason.

    Attributes:
        label: of the behaviour inside another one that failed, whose reason names it already; None otherwise.
    """

    def __init__(self, reason: str, label: str | None = None) -> None:
        """Keep the reason."""
        super().__init__(reason)
        self.label = label


class Behaviour(abc.ABC):
    """Something that a robot does until it is done, has failed or has taken too long.

    A subclass writes `course` as a generator: it yields an `Action` for every tick, receives the next `View`, returns
    the last view when it is done, and raises `Failure` with a reason where it cannot go on. The generator is the only
    place that keeps state, so that a behaviour can be begun again at any time. It never waits: whoever calls `update`
    gets an action at once.

    Attributes:
        status: RUNNING up to the end.
        reason: why it failed; empty otherwise.
        progress: what it waits for and how far it is, for the reason of a timeout; `course` keeps it true.
        timeout: time after which it fails [s]; infinite for behaviours made of others, which end because those do.
    """

    status: Status = Status.RUNNING
    reason: str = ""
    progress: str = ""
    timeout: float = math.inf

    @abc.abstractmethod
    def course(self, view: View) -> Course:
        """Run: yield an action for every view, the first for `view`; return the last view.

        Raises:
            Failure: with the reason.
        """

    @property
    def label(self) -> str:
        """What it is called in reasons, as in YAML: `WalkTo` is walk_to."""
        return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", type(self).__name__).lower()

    @property
    def step(self) -> str:
        """What the robot does now, for tables and the labels of recordings; a sequence says its current step."""
        return self.label

    def begin(self, view: View) -> None:
        """Start, or start again."""
        self.status, self.reason, self.progress = Status.RUNNING, "", ""
        self.view = view
        self._began = view.time
        self._course: Course | None = None

    def update(self, view: View) -> Action:
        """Return the action for this tick; the robot rests once the behaviour has ended."""
        self.view = view
        if self.status is not Status.RUNNING:
            return at_rest(view)
        if view.time - self._began > self.timeout:
            self._end(f"{self.label}: timeout of {self.timeout:g} s: {self.progress or 'nothing happened'}")
            return at_rest(view)
        try:
            if self._course is None:
                self._course = self.course(view)
                return next(self._course)
            return self._course.send(view)
        except StopIteration:
            self._end()
        except Failure as failure:
            self._end(f"{self.label}: {failure}" if failure.label is None else str(failure))
        return at_rest(view)

    def _end(self, reason: str | None = None) -> None:
        self.status = Status.SUCCESS if reason is None else Status.FAILURE
        self.reason = reason or ""
        if self._course is not None:
            self._course.close()


def run(behaviour: Behaviour, view: View) -> Course:
    """Let a behaviour take over inside the course of another one, by `yield from`; no tick is lost between the two.

    Returns:
        The last view.

    Raises:
        Failure: if the behaviour fails, with its reason.
    """
    behaviour.begin(view)
    while True:
        action = behaviour.update(view)
        if behaviour.status is Status.SUCCESS:
            return view
        if behaviour.status is Status.FAILURE:
            raise Failure(behaviour.reason, behaviour.label)
        view = yield action


def seen(view: View, name: str) -> SeenObject:
    """Return an object that is seen.

    Raises:
        Failure: if there is none of that name.
    """
    objects: Mapping[str, SeenObject] = view.objects
    if name not in objects:
        known = ", ".join(objects) or "none"
        raise Failure(f"object '{name}' is not seen; there are: {known}")
    return objects[name]


def check_time(name: str, value: float) -> None:
    """Refuse a time that is not above 0."""
    if not 0.0 < value <= LONGEST_TIME:
        raise ConfigError(f"{name} is {value}; give a finite number of seconds above 0, up to {LONGEST_TIME:g}")


def check_hold(hold: float, timeout: float) -> None:
    """Refuse a time for which something is held that is below 0 or never over before the timeout [s]."""
    if not 0.0 <= hold < timeout:
        raise ConfigError(f"hold is {hold}; give a number of seconds from 0, below the timeout of {timeout:g} s")


def check_within(name: str, value: float, least: float, most: float, unit: str = "m") -> None:
    """Refuse a number outside of a range, and NaN."""
    if not least <= value <= most:
        raise ConfigError(f"{name} is {value} {unit}; give {least:g} to {most:g} {unit}")
