"""A behaviour as the source of commands of a control loop, and behaviours by name: shipped ones, and the user's."""

import enum
import math
import pathlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from hugwbc import extensions
from hugwbc.behaviours.course import Behaviour, Course, Failure, at_rest
from hugwbc.behaviours.fetch_cup import fetch_cup
from hugwbc.behaviours.hands import stature
from hugwbc.behaviours.lag import Lag
from hugwbc.behaviours.stops import SETTLED, Stops
from hugwbc.commands import Command
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.gait import Gait
from hugwbc.numeric import changed
from hugwbc.robot import SIDES, Robot
from hugwbc.scripts.script import SCRIPT_NAMES, Script, load_script
from hugwbc.scripts.view import Action, Grip, View
from hugwbc.targets import HandTargets

ACCELERATION = np.array([0.6, 0.6, 1.2])  # highest change of v_x, v_y [m/s^2] and omega [rad/s^2]
BODY_SPEED = np.array([0.15, 0.3, 0.6])  # highest change of h [m/s], p and w [rad/s]
SLOW = np.array([0.1, 0.1, 0.2])  # [m/s], [m/s], [rad/s]; a slower robot may be told to stand
STEP_OUT = 0.6  # [s] of slow steps before a robot that has walked stands still
FARTHEST = 0.5  # [m] that an H1's pelvis may move while it stands (`Straying`): a deep crouch takes half of it
RAN_AWAY = "the robot moved while told to stand"
LONGEST = 120.0  # [s], after which a behaviour is not played on
_VELOCITIES, _BODY = slice(0, 3), slice(5, 8)
_RUN = "; run a step by `view = yield from STEP(view, ...)`, and give `retry` a `partial(STEP, ...)`"


class Status(enum.Enum):
    """Where a behaviour stands."""

    RUNNING = "running"
    SUCCESS = "success"
    FAILURE = "failure"


class CommandRamp:
    """Soft starts and stops: limits how fast a command changes, whatever a behaviour asks for.

    A robot that walks and is told to stand slows down first, goes on stepping for `STEP_OUT` and then stands: the
    learned policy falls if it is switched to standing at speed. A walk is at rest where the commanded velocity equals
    that by which the robot lags (`View.lag`).
    """

    def __init__(self) -> None:
        """Start from a standing robot."""
        self.command = Command()
        self._slow = math.inf  # time since the commanded speed was last above `SLOW`

    def __call__(self, asked: Command, dt: float, lag: np.ndarray) -> Command:
        """Return the command for this tick, `dt` [s] after the last one, of a robot that lags (`View.lag`)."""
        last = self.command.array()
        wanted = asked.array()
        rest = lag if self.command.gait in (Gait.STANDING, Gait.WALKING) else np.zeros(3)  # in a leap it stops at 0
        if asked.gait is Gait.STANDING and self.command.gait is Gait.WALKING:
            wanted[_VELOCITIES] = lag
        most = np.full(wanted.shape, math.inf)
        most[_VELOCITIES], most[_BODY] = ACCELERATION * dt, BODY_SPEED * dt
        values = last + np.clip(wanted - last, -most, most)
        self._slow = 0.0 if bool(np.any(np.abs(values[_VELOCITIES] - rest) > SLOW)) else self._slow + dt
        gait = asked.gait
        if gait is Gait.STANDING and self.command.gait is not Gait.STANDING:
            if self._slow < STEP_OUT:
                gait = self.command.gait
            else:
                values[_VELOCITIES] = 0.0
        self.command = Command.from_array(values, gait)
        return self.command


class Straying:
    """Watches how far a robot moves after it has been told to stand and has come to rest.

    Attributes:
        farthest: the largest distance of its pelvis from where it had come to rest [m].
    """

    def __init__(self) -> None:
        self.farthest, self._stood, self._rest = 0.0, 0.0, [0.0, 0.0]

    def note(self, told: int, place: list[float], dt: float) -> None:
        """Take the gait that is told, and x and y of the pelvis [m], `dt` [s] after the last ones."""
        self._stood = self._stood + dt if told == Gait.STANDING else 0.0
        self._rest = place if self._stood <= SETTLED else self._rest
        self.farthest = max(self.farthest, math.dist(place, self._rest))


class BehaviourSource:
    """Runs a behaviour in a control loop: a `SeeingSource`. Once it has ended, the robot rests and keeps its hands.

    Attributes:
        status: where the behaviour stands; RUNNING also before the first view.
        reason: why it failed; empty otherwise.
        action: the last action, as the robot gets it.
        view: the last view; None before the first.
    """

    def __init__(self, behaviour: Behaviour) -> None:
        """Take a behaviour, such as a generator function of a view."""
        self._behaviour = behaviour
        self.restart()

    def restart(self) -> None:
        """Begin again at the next view."""
        self.status, self.reason, self.action = Status.RUNNING, "", Action()
        self.view: View | None = None
        self._course: Course | None = None
        self._ramp, self._straying, self._stops, self._lag = CommandRamp(), Straying(), Stops(), Lag()
        self._grips: dict[str, str | None] = {}  # what each gripper was last asked to hold
        self._lost: dict[str, str] = {}  # what a force has torn out of it

    def see(self, view: View) -> None:
        """Take the view of this tick, and decide on the action. Never raises: an error ends the behaviour."""
        dt = 0.0 if self.view is None else max(view.time - self.view.time, 0.0)
        if self.view is not None:
            self._note_grips(self.view.held, view.held)
        self._stops.note(view, self.action.command.gait)
        self._lag.note(view, self.action.command)
        self.view = self.completed(view)
        self._straying.note(self.action.command.gait, view.position[:2].tolist(), dt)
        action = self.act(self.view)
        hands = action.hands
        if hands is not None:  # what is seen is noisy: the arms must not take the targets' differences for a motion
            hands = changed(hands, stamp=view.state.time, sequence=None)
        self.action = changed(action, command=self._ramp(action.command, dt, self.view.lag), hands=hands)

    def completed(self, view: View) -> View:
        """Return a view with the last action, and what the run has shown of the robot's walks."""
        stop = view.stop if self._stops.moved is None else self._stops.moved
        return changed(view, last=self.action, stop=stop, lag=self._lag.velocity, stuck=self._lag.stuck)

    def _note_grips(self, before: Sequence[str | None], now: Sequence[str | None]) -> None:
        """Note which grips a force has broken: those that end although they were asked for."""
        self._grips.update({grip.side: grip.name for grip in self.action.grips})
        for side, had, has in zip(SIDES, before, now, strict=True):
            if has is not None:
                self._lost.pop(side, None)
            elif had is not None and self._grips.get(side):
                self._lost[side] = had

    def act(self, view: View) -> Action:
        """Return the next action of the behaviour, without soft starts and stops; never raises."""
        if self.status is Status.RUNNING:
            try:
                if self._course is None:
                    self._course = self._behaviour(view)
                    action = next(self._course)
                else:
                    action = self._course.send(view)
                _check(action)
                return action
            except StopIteration:
                self.status = Status.SUCCESS
                lost = [f"a force broke the grip of the {side} hand on '{name}'" for side, name in self._lost.items()]
                if self._straying.farthest > FARTHEST * stature(view.robot):
                    lost.append(f"{RAN_AWAY}, by {self._straying.farthest:.2f} m")
                if lost:
                    self.status, self.reason = Status.FAILURE, "; ".join(lost)
            except Failure as failure:
                self.status, self.reason = Status.FAILURE, str(failure)
            except Exception as error:  # a mistake in a behaviour must not stop the loop
                hint = _RUN if any(sign in str(error) for sign in ("'generator' object", "not an iterator")) else ""
                self.status = Status.FAILURE
                self.reason = f"the behaviour raised {extensions.described(error)}{hint}"
        return at_rest(view)

    def command_at(self, t: float) -> Command:
        """Return the command of this tick."""
        return self.action.command

    def hands_at(self, t: float) -> HandTargets | None:
        """Return the hand targets of this tick."""
        return self.action.hands

    @property
    def grips(self) -> tuple[Grip, ...]:
        """Requests to the idealised gripper at this tick."""
        return self.action.grips

    @property
    def doing(self) -> str:
        """What the robot does now; empty before and after."""
        return self.action.doing

    @property
    def ending(self) -> str:
        """How it ended, in words, or its current activity."""
        if self.status is Status.RUNNING:
            at = f"at {self.doing}" if self.doing else "running"
            return "not begun" if self._course is None else f"not done: was still {at}"
        return "done" if self.status is Status.SUCCESS else f"not done: {self.reason}"

    @property
    def done(self) -> bool:
        """Whether the behaviour has ended and the robot stands."""
        return self.status is not Status.RUNNING and self.action.command.gait is Gait.STANDING


def _check(action: object) -> None:
    """Raise `Failure` for anything but an action, and for an action with parts of other kinds or bad numbers."""
    if not isinstance(action, Action):
        raise Failure(f"it yielded a {type(action).__name__} instead of an Action{_RUN}")
    grips = action.grips
    fits = {
        "command is no Command": isinstance(action.command, Command),
        "hands are neither HandTargets nor None": isinstance(action.hands, HandTargets | None),
        "grips are no tuple of Grip": isinstance(grips, tuple | list) and all(isinstance(one, Grip) for one in grips),
    }
    if wrong := [what for what, right in fits.items() if not right]:
        raise Failure(f"it yielded an Action whose {wrong[0]}")
    if not np.isfinite(action.command.array()).all():
        raise Failure(f"it yielded a command that is not finite: {action.command}")


_SHIPPED: dict[str, Behaviour] = {"fetch_cup": fetch_cup}
BEHAVIOUR_NAMES = tuple(_SHIPPED)


def load_behaviour(name: str) -> Behaviour:
    """Return a shipped behaviour, one of `BEHAVIOUR_NAMES`, or `FILE.py:NAME`, a function of a file that is run."""
    if not extensions.names_object(name):
        if name not in _SHIPPED:
            raise UnknownNameError("behaviour", name, (*_SHIPPED, "or FILE.py:NAME"))
        return _SHIPPED[name]
    found: Any = extensions.load_object(name, "behaviour")
    if callable(found):
        return found  # type: ignore[no-any-return]
    raise ConfigError(f"{name} is a {type(found).__name__}; give a function that takes a view and yields actions")


def load_plan(name: str | pathlib.Path, robot: Robot) -> Script | Behaviour:
    """Return a timed script for a robot, by name or a file that ends in .yaml, or a behaviour as `load_behaviour`."""
    if str(name) in BEHAVIOUR_NAMES or extensions.names_object(str(name)):
        return load_behaviour(str(name))
    if str(name) not in SCRIPT_NAMES and pathlib.Path(name).suffix not in (".yaml", ".yml"):
        choice = (*SCRIPT_NAMES, *BEHAVIOUR_NAMES, "a file that ends in .yaml", "or FILE.py:NAME")
        raise UnknownNameError("script", name, choice)
    return load_script(name, robot)
