"""Sources of commands and hand targets for a control loop: the interface, and the simplest one."""

import dataclasses
from typing import Protocol, runtime_checkable

from hugwbc.commands import Command
from hugwbc.scripts.view import Grip, View
from hugwbc.targets import HandTargets


class CommandSource(Protocol):
    """An object that gives commands and hand targets over time, such as a `Script` or a `Constant`."""

    def command_at(self, t: float) -> Command:
        """Return the command at time t [s]."""
        ...

    def hands_at(self, t: float) -> HandTargets | None:
        """Return the hand targets at time t [s]; None leaves the arms to the controller."""
        ...


@runtime_checkable
class SeeingSource(CommandSource, Protocol):
    """A command source that decides by what is estimated and seen, such as a `BehaviourSource`."""

    def restart(self) -> None:
        """Forget the past before a new run."""
        ...

    def see(self, view: View) -> None:
        """Take the view of this tick, before each `command_at`."""
        ...

    @property
    def grips(self) -> tuple[Grip, ...]:
        """Requests to the idealised gripper, carried out after `see`."""
        ...


@dataclasses.dataclass(frozen=True)
class Constant:
    """The same command and hand targets at all times; without targets the controller moves the arms."""

    command: Command
    hands: HandTargets | None = None

    def command_at(self, t: float) -> Command:
        """Return the command."""
        return self.command

    def hands_at(self, t: float) -> HandTargets | None:
        """Return the hand targets."""
        return self.hands
