"""What a behaviour is, and how behaviours are put together.

A behaviour is a generator function. It gets what is known now, a `View`, yields an `Action` for every tick, receives
the next view, and returns the last one. Where it cannot continue, it raises `Failure` with a reason. It must not block.

    def fetch(view: View) -> Course:
        view = yield from walk_to(view, before="desk")
        view = yield from squeeze(view, "box")
        return (yield from lift(view, "box", 0.1))
"""

import copy
import dataclasses
import functools
import inspect
import math
import warnings
import weakref
from collections.abc import Callable, Generator, Sequence
from typing import Annotated, Concatenate, Literal, ParamSpec, TypeAlias

from pydantic import Field

from hugwbc import rotations
from hugwbc.commands import Command, default_command
from hugwbc.gait import Gait
from hugwbc.reference import plain_signature
from hugwbc.scripts.view import Action, SeenObject, View
from hugwbc.settings import settings
from hugwbc.targets import FARTHEST, HandTargets

Course: TypeAlias = Generator[Action, View, View]
"""A behaviour that runs."""
Behaviour: TypeAlias = Callable[[View], Course]
"""A behaviour whose arguments are all given."""

# What the arguments of steps may be.
Seconds = Annotated[float, Field(gt=0, le=3600)]
Hold = Annotated[float, Field(ge=0, le=60)]  # [s]
Metres = Annotated[float, Field(ge=-FARTHEST, le=FARTHEST)]
Way = Annotated[float, Field(gt=0, le=FARTHEST)]  # [m]
Place = tuple[Metres, Metres]  # x and y
Point = tuple[Metres, Metres, Metres]
Angle = Annotated[float, Field(ge=-2 * math.pi, le=2 * math.pi)]  # [rad], so that one in degrees is refused
Tolerance = Annotated[float, Field(ge=0.001, le=1)]  # [m]
HandSpeed = Annotated[float, Field(ge=0.001, le=1)]  # [m/s]
WalkSpeed = Annotated[float, Field(ge=0.05, le=0.6)]  # [m/s]
Name = Annotated[str, Field(min_length=1)]
Hand = Literal["left", "right"]

_P = ParamSpec("_P")
_UNCHECKED = (View, Course, Behaviour, Callable[[View], bool], inspect.Parameter.empty)


class Failure(Exception):  # noqa: N818  an outcome, not an error of the program
    """A failed behaviour; its text is the reason.

    Attributes:
        named: whether the reason already says which step failed.
    """

    def __init__(self, reason: str, *, named: bool = False) -> None:
        """Keep the reason."""
        super().__init__(reason)
        self.named = named


def step(function: Callable[Concatenate[View, _P], Course]) -> Callable[Concatenate[View, _P], Course]:
    """Make a generator function a step: check its arguments by their types, name its failures, end it at its `timeout`.

    The name in reasons and tables is that of the function. An argument `timeout` [s], if it has one, limits its time.
    """
    name = function.__name__.replace("_", " ")
    try:
        signature = inspect.signature(function, eval_str=True)  # of a file with postponed annotations, too
    except NameError:
        signature = inspect.signature(function)
    checked = [one for one in signature.parameters.values() if one.annotation not in _UNCHECKED]
    kinds, given = {}, {}
    for one in checked:
        kind, default = one.annotation, one.default
        if one.kind is one.VAR_POSITIONAL:
            kind, default = tuple[kind, ...], ()
        if one.kind is one.VAR_KEYWORD:
            kind, default = dict[str, kind], {}
        kinds[one.name], given[one.name] = kind, default
    # Each call gets its own copy: a dataclass refuses a list or an array as a default.
    defaults = {
        key: dataclasses.field(default_factory=functools.partial(copy.deepcopy, value))
        for key, value in given.items()
        if value is not inspect.Parameter.empty
    }
    model = settings(kw_only=True)(type(function.__name__, (), {"__annotations__": kinds, **defaults}))

    @functools.wraps(function)
    def begin(view: View, *args: _P.args, **kwargs: _P.kwargs) -> Course:
        try:
            bound = signature.bind(view, *args, **kwargs)
        except TypeError as error:
            names = ", ".join(signature.parameters)
            raise TypeError(f"{function.__name__}: {error}; its arguments are {names}") from None
        values = model(**{one.name: bound.arguments[one.name] for one in checked if one.name in bound.arguments})
        bound.arguments |= {one.name: getattr(values, one.name) for one in checked}
        start = functools.partial(function, *bound.args, **bound.kwargs)  # pyright: ignore[reportCallIssue]
        begun: list[bool] = []
        course = _watched(name, view, start, getattr(values, "timeout", math.inf), begun)
        weakref.finalize(course, _miss, begun, function.__name__).atexit = False
        return course

    begin.__signature__ = plain_signature(function)  # pyright: ignore[reportAttributeAccessIssue]
    return begin


def _miss(begun: Sequence[bool], name: str) -> None:
    """Warn of a step that was made and deleted without having run."""
    if not begun:
        words = f"a step was made but never run; write `view = yield from {name}(view, ...)`"
        warnings.warn(words, RuntimeWarning, stacklevel=3)


def _watched(name: str, view: View, start: Callable[[], Course], timeout: float, begun: list[bool]) -> Course:
    begun.append(True)
    begin, at, progress, course = view.time, "", "", None
    try:
        course = start()
        action = next(course)
        while True:
            if action.progress or action.doing != at:
                at, progress = action.doing, action.progress
            view = yield action if action.doing else dataclasses.replace(action, doing=name)
            if view.time - begin > timeout:
                last = progress or (f"still at {at}" if at else "nothing happened")
                raise Failure(f"timeout of {timeout:g} s: {last}")
            action = course.send(view)
    except StopIteration:
        return view
    except Failure as failure:
        raise failure if failure.named else Failure(f"{name}: {failure}", named=True) from None
    finally:
        if course is not None:
            course.close()


def doing(what: str, course: Course) -> Course:
    """Say in words what the robot is doing while a course runs, for tables and the labels of recordings."""
    try:
        action = next(course)
        while True:
            view = yield dataclasses.replace(action, doing=what)
            action = course.send(view)
    except StopIteration as end:
        return end.value


def parallel(view: View, legs: Course, hands: Course) -> Course:
    """Walk and work with the hands at the same time: the command of `legs`, the hand targets and grips of `hands`.

    It is done when both are; a failure of one ends the other.
    """
    actions = [_advance(legs, None), _advance(hands, None)]
    while any(actions):
        walk, work = (at_rest(view) if action is None else action for action in actions)
        names = " and ".join(action.doing for action in actions if action is not None)
        view = yield Action(walk.command, work.hands, work.grips, names, work.progress or walk.progress)
        actions = [
            None if last is None else _advance(course, view)
            for last, course in zip(actions, (legs, hands), strict=True)
        ]
    return view


def _advance(course: Course, view: View | None) -> Action | None:
    """Return the next action of a course, the first one without a view; None if it has ended."""
    try:
        return next(course) if view is None else course.send(view)
    except StopIteration:
        return None


@step
def retry(view: View, behaviour: Behaviour, times: Annotated[int, Field(ge=1)] = 3) -> Course:
    """Try a behaviour until it succeeds, at most `times` times."""
    for attempt in range(1, times + 1):
        course = behaviour(view)
        try:
            action = _advance(course, None)
            while action is not None:
                view = yield action
                action = _advance(course, view)
            return view
        except Failure as failure:
            if attempt == times:
                raise Failure(f"{failure} (tried {times} times)", named=failure.named) from None
        view = yield at_rest(view)  # one tick for each try: those that fail at once must not keep the loop waiting
    return view


@step
def wait(view: View, seconds: Annotated[float, Field(ge=0, le=3600)]) -> Course:
    """Keep the last hand targets and the posture for a time [s]."""
    begin = view.time
    while view.time - begin < seconds:
        view = yield Action(standing(view), view.last.hands, progress=f"waits for {seconds:g} s")
    return view


@step
def wait_until(
    view: View, condition: Callable[[View], bool], what: str, *, hold: Hold = 0.0, timeout: Seconds = 10.0
) -> Course:
    """Stand still until a condition holds.

    Args:
        view: now.
        condition: a question about the view.
        what: the condition in words, for the reason of a timeout.
        hold: time for which it has to hold without a break [s].
        timeout: after which it fails [s].
    """
    since: float | None = None
    while True:
        since = None if not condition(view) else view.time if since is None else since
        if since is not None and view.time - since >= hold - 1e-9:  # sums of ticks are rounded
            return view
        held = 0.0 if since is None else view.time - since
        view = yield dataclasses.replace(at_rest(view), progress=f"{what}: {held:.1f} of {hold:g} s")


def seen(view: View, name: str) -> SeenObject:
    """Return an object that is seen; raise `Failure` if it is not."""
    if name not in view.objects:
        raise Failure(f"object '{name}' is not seen; there are: {', '.join(view.objects) or 'none'}")
    return view.objects[name]


def standing(view: View) -> Command:
    """Return a standing command with h, p and w of the last one."""
    last = view.last.command
    return Command.from_mapping({"h": last.h, "p": last.p, "w": last.w}, Gait.STANDING, view.robot)


def upright(view: View) -> Command:
    """Return the standing command with the defaults of the robot."""
    return default_command(Gait.STANDING, view.robot)


def kept(view: View) -> HandTargets | None:
    """Return the last hand targets in the frame that goes with the robot; None while the controller moves the arms."""
    hands = view.last.hands
    if hands is None or hands.frame != "world":
        return hands
    turn = rotations.rotation_z(view.state.yaw)
    return hands.turned(turn, (hands.array() - view.position) @ turn, "heading")


def at_rest(view: View) -> Action:
    """Return the action of a robot that stands and keeps its hands where they are."""
    return Action(standing(view), kept(view))
