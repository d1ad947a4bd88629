"""The record of what the stages of a control period changed, and the log from which it is made."""

import dataclasses
from collections.abc import Callable
from typing import Any, TypeVar

from hugwbc.commands import CommandChange
from hugwbc.errors import ConfigError
from hugwbc.extensions import described

T = TypeVar("T")
# Counters of mistakes in somebody else's code.
_MISTAKES = ("failures", "source_failures", "bad_outputs", "hands_refused", "upper_body_rejected")
_TOLD = (*_MISTAKES, "bad_states", "lowered")  # which whoever stands beside the robot must know at once


@dataclasses.dataclass(frozen=True)
class SafetyReport:
    """Counts of what the stages of a control period changed since the start of a run, in periods unless noted.

    Attributes:
        ticks: control periods.
        commands_clamped: periods in which a command value was out of range or NaN, by command name.
        commands_guarded: changes of a command value that the other values did not allow, by command name.
        hands_refused: hand targets that are not finite, or that the arms cannot follow (`HandTargets.check`).
        hands_held: periods without an arm posture for the hand targets, in which the arms held: the inverse kinematics
            failed, or the state did not tell where the targets are.
        upper_body_rejected: arm targets that were not a finite number for each joint: the last good ones stayed.
        upper_body_limited: external arm targets outside the joint limits, clamped to them.
        wrench_limited: wrenches on the hands beyond their ranges, limited to them (`HandWrench.limited`).
        bad_states: states that no controller can use: not finite, fallen, or too fast (`StateCheck.fault`).
        bad_outputs: joint commands of the controller with NaN or infinity, or of a wrong size.
        failures: exceptions of the controller, and return values that are not joint commands or its plans.
        source_failures: exceptions of the sources of commands and arm targets, and what is not theirs to return.
        held: ticks on which the last good joint command was repeated.
        damped: ticks on which the joints were damped.
        positions_limited: joint commands with a position target that was clamped.
        torques_limited: joint commands with a feed-forward torque that was clamped.
        speeds_limited: joint commands with a velocity target that was clamped.
        gains_limited: joint commands with a stiffness that was clamped to 0 or `gain_limits`, and likewise dampings.
        overruns: calls of the controller that took longer than its period.
        readings_refused: states in which the reading of a sensor was replaced, and readings of the IMU that were left
            out of a mean, by sensor.
        braked: ticks on which a robot braked or stood before it changed its gait (`hugwbc.runtime.braking`).
        lowered: ticks on which the robot knelt down, or was damped afterwards, with its state lost or a motor dead.
        messages: the first message of each kind of event.
    """

    ticks: int = 0
    commands_clamped: dict[str, int] = dataclasses.field(default_factory=dict)
    commands_guarded: dict[str, int] = dataclasses.field(default_factory=dict)
    hands_refused: int = 0
    hands_held: int = 0
    upper_body_rejected: int = 0
    upper_body_limited: int = 0
    wrench_limited: int = 0
    bad_states: int = 0
    bad_outputs: int = 0
    failures: int = 0
    source_failures: int = 0
    held: int = 0
    damped: int = 0
    positions_limited: int = 0
    torques_limited: int = 0
    speeds_limited: int = 0
    gains_limited: int = 0
    overruns: int = 0
    readings_refused: dict[str, int] = dataclasses.field(default_factory=dict)
    braked: int = 0
    lowered: int = 0
    messages: tuple[str, ...] = ()

    @property
    def mistakes(self) -> int:
        """How often the code of a controller or a source raised, or gave what is unusable."""
        return sum(getattr(self, counter) for counter in _MISTAKES)


class SafetyLog:
    """Where the stages of a control period count what they change.

    Attributes:
        strict: whether mistakes of controller and sources raise a `ConfigError` instead; for simulations only.
        tell: called with the first message of each kind of mistake, of unusable states, and of kneeling down.
    """

    strict = False

    def __init__(self) -> None:
        self.tell: Callable[[str], object] = lambda message: None
        self.reset()

    def reset(self) -> None:
        """Forget all counts."""
        self._counts: dict[str, int] = {}
        self._named: dict[str, dict[str, int]] = {}
        self._first: dict[str, str | CommandChange] = {}  # event of each kind, in order

    def count(self, counter: str, message: str = "") -> None:
        """Count an event in a field of the report, and keep the first message of its kind."""
        if self.strict and counter in _MISTAKES:
            raise ConfigError(message)
        self._counts[counter] = self._counts.get(counter, 0) + 1
        if message and counter not in self._first:
            self._first[counter] = message
            if counter in _TOLD:
                self.tell(message)

    def count_of(self, counter: str, name: str, event: str | CommandChange) -> None:
        """Count an event by the name of what it is about, in a field of the report that has names."""
        counts = self._named.setdefault(counter, {})
        counts[name] = counts.get(name, 0) + 1
        self._first.setdefault(f"{counter} {name}", event)

    def ask(self, counter: str, who: str, question: Callable[[], T]) -> T | None:
        """Return the answer of somebody else's code; count an exception, and return None."""
        try:
            return question()
        except Exception as error:  # the last line of defence of a running robot
            self.count(counter, "" if counter in self._first else f"{who} raised {described(error)}")
            return None

    def report(self) -> SafetyReport:
        """Return the counts since the last reset."""
        named: dict[str, Any] = {counter: dict(counts) for counter, counts in self._named.items()}
        events = self._first.values()
        messages = tuple(f"command {event}" if isinstance(event, CommandChange) else event for event in events)
        return SafetyReport(**self._counts, **named, messages=messages)
