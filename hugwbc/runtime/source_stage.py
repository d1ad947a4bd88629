"""The first stage of a control period: what the source of commands and hand targets asks for."""

import warnings

import numpy as np

from hugwbc.commands import Command, default_command
from hugwbc.errors import ConfigError
from hugwbc.gait import Gait
from hugwbc.numeric import changed
from hugwbc.robot import Robot
from hugwbc.runtime.safety_report import SafetyLog
from hugwbc.runtime.sight import Sight
from hugwbc.scripts.view import CommandSource, SeeingSource, View
from hugwbc.state import RobotState
from hugwbc.targets import HandTargets
from hugwbc.upper_ik.source import STALE_TIME


class SourceStage:
    """A source that is asked once a period; one that looks at robot and objects is shown them first.

    Where it raises or gives something else, its last command and hand targets count for `STALE_TIME`; then the robot
    stands, and the arms go back to the controller.

    Attributes:
        placed: the robot as the source saw it in this period.
    """

    placed: RobotState

    def __init__(
        self,
        source: CommandSource,
        sight: Sight,
        log: SafetyLog,
        robot: Robot,
        *,
        moves_hands: bool,
        stop: np.ndarray,
    ) -> None:
        """Connect a source to a robot.

        Args:
            source: what is asked.
            sight: what it sees.
            log: counts its failures.
            robot: whose stand is the fallback.
            moves_hands: whether anything moves the hands; if not, hand targets are ignored with a warning.
            stop: by how much a stop moves the robot, as the controller knows it [m, m, rad], shape (3,) (`View.stop`).

        Raises:
            ConfigError: if the source lacks a member.
        """
        self._stop = stop
        self._source, self._sight, self._log, self._moves_hands = source, sight, log, moves_hands
        self._stand = default_command(Gait.STANDING, robot)
        asked = (getattr(source, name, None) for name in ("command_at", "hands_at"))
        if isinstance(source, type) or not all(map(callable, asked)):
            raise ConfigError(
                f"the source is {repr(source)[:100]}; give a Command, a script (load_script), a BehaviourSource, or an "
                "object with command_at(t) and hands_at(t)"
            )
        self._seeing = source if isinstance(source, SeeingSource) else None
        if self._seeing is None and hasattr(source, "see"):
            lacking = ", ".join(name for name in ("restart", "grips") if not hasattr(source, name))
            raise ConfigError(f"a source with see has restart and grips as well (SeeingSource); this lacks {lacking}")
        self._warned = False
        self.reset()

    def reset(self) -> None:
        """Start a run."""
        self._last: tuple[Command, HandTargets | None] = (self._stand, None)
        self._unheard = 0.0  # [s] since the last good answer
        self._view: View | None = None
        self._usable: RobotState | None = None  # the last usable state
        if self._seeing is not None:
            self._seeing.restart()
            self._sight.reset()

    def look(self, t: float, state: RobotState) -> View:
        """Return what is seen at time t of the run [s]; each time has one view.

        A state that cannot be used is not shown: what a source learns from it would never be right again.
        """
        if self._view is None or self._view.time != t:
            self._usable = state if state.is_usable or self._usable is None else self._usable
            self._view = changed(self._sight.look(t, self._usable), stop=self._stop)
        return self._view

    def ask(
        self, t: float, state: RobotState, dt: float, *, mid_stance: bool = True
    ) -> tuple[Command, HandTargets | None]:
        """Return command and hand targets for the period [s] that begins at time t of the run [s].

        Args:
            t: time of the run [s].
            state: the estimate.
            dt: the period [s].
            mid_stance: whether a walk may end now (`View.mid_stance`).
        """
        self.placed = state
        asked = self._log.ask("source_failures", "the source", lambda: self._ask(t, mid_stance))
        self._unheard = 0.0 if asked is not None else self._unheard + dt
        if asked is not None or self._unheard > STALE_TIME:
            self._last = asked or (self._stand, None)
        return self._last

    def _ask(self, t: float, mid_stance: bool) -> tuple[Command, HandTargets | None]:
        if self._seeing is not None:
            view = changed(self.look(t, self.placed), mid_stance=mid_stance)
            self.placed = view.state
            self._seeing.see(view)
            self._sight.grip(self._seeing.grips)
        command = self._source.command_at(t)
        hands = self._source.hands_at(t)
        if not isinstance(command, Command) or not isinstance(hands, HandTargets | None):
            given = f"a {type(command).__name__} and a {type(hands).__name__}"
            raise TypeError(f"it gave {given} instead of a Command, and HandTargets or None")
        if hands is not None and not self._moves_hands:
            if not self._warned:
                self._warned = True
                warnings.warn("hand targets are ignored: nothing moves the arms; give an UpperBodySource", stacklevel=2)
            hands = None
        return command, hands
