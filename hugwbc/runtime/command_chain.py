"""The way of every command to any controller: clamped to its gait, possible for the legs, braked between gaits."""

import math

from hugwbc.commands import (
    PAPER_LEG,
    SWING_REACTION,
    Command,
    CommandChange,
    changed_command,
    command_ranges,
    default_command,
    highest_swing,
)
from hugwbc.gait import Gait
from hugwbc.robot import Robot
from hugwbc.runtime.braking import Braking
from hugwbc.runtime.safety_report import SafetyLog
from hugwbc.state import RobotState

# Of a leg of `PAPER_LEG`; those of others are as their lengths, and their frequencies as at an equal Froude number.
SLOW_STEP = 0.3  # [m], longest step below BRISK; the robot falls sideways for as long as a step lasts
BRISK = 2.0  # [Hz], stride frequency that is enough for every commanded speed
SIDEWAYS = 1.2  # [m/s^2], largest centripetal acceleration v omega; without ankle roll the legs cannot hold more


def feasible(command: Command, robot: Robot) -> tuple[Command, tuple[CommandChange, ...]]:
    """Return the nearest command that the legs allow, and what was changed.

    Each value of a command may be within its range, but not all together. While all values but one are at their
    defaults, nothing changes on an H1. Shorter legs need faster steps than the default f at high speed.

    Commands have priority in this order: v_x; then v_y within the ellipse of allowed velocities; omega; f; l. h, p and
    w stay. A standing command comes back as it is, because no leg swings.

    Args:
        command: each value finite and within its range (`Command.clamp`).
        robot: its ranges are the semi-axes of the ellipse; its legs bound l (`highest_swing`) and the length of steps.
    """
    if command.gait is Gait.STANDING:
        return command, ()
    ranges = command_ranges(Gait.WALKING, robot)
    (backward, forward), (_, aside) = ranges["v_x"].finishing, ranges["v_y"].finishing
    v_x = command.v_x
    share = min(abs(v_x / (forward if v_x > 0.0 else backward)), 1.0) if v_x else 0.0
    v_y = _within(command.v_y, aside * math.sqrt(1.0 - share**2))
    speed = math.hypot(v_x, v_y)
    omega = _within(command.omega, SIDEWAYS / speed if speed > 0.0 else math.inf)
    size = robot.leg_length / PAPER_LEG
    own = command_ranges(command.gait, robot)
    brisk = min(BRISK / math.sqrt(size), own["f"].finishing[1])
    f = max(command.f, min(speed / (2.0 * SLOW_STEP * size), brisk))
    reach = max(highest_swing(robot) + command.h, ranges["l"].default)  # the default is allowed at any height
    # In a hop the free leg does not swing, and f is not commanded.
    reaction = math.inf if command.gait.hops else SWING_REACTION / f**2
    l = max(min(command.l, reach, reaction), own["l"].finishing[0])  # noqa: E741  the paper's symbol
    reasons = {
        "v_y": (v_y, f"together with v_x = {v_x:g} m/s"),
        "omega": (omega, f"at {speed:.2g} m/s"),
        "f": (f, f"at {speed:.2g} m/s, whose steps would be too long"),
        "l": (l, f"with h = {command.h:g} m and f = {f:.3g} Hz"),
    }
    changes = tuple(
        CommandChange(name, asked, used, f"is not possible {why}")
        for name, (used, why) in reasons.items()
        if used != (asked := getattr(command, name))
    )
    return changed_command(command, changes), changes


def _within(value: float, bound: float) -> float:
    return min(max(value, -bound), bound)


class CommandChain:
    """The one place where commands are clamped (`Command.clamp`), made feasible and braked (`Braking`).

    Attributes:
        command: the last one, clamped; errors of tracking count against it.
    """

    def __init__(self, log: SafetyLog, robot: Robot) -> None:
        self._log, self._robot = log, robot
        self.reset()

    def reset(self) -> None:
        """Start from a standing robot."""
        self.command, self._braking = default_command(Gait.STANDING, self._robot), Braking(self._robot)
        self._given: Command | None = None
        self._asked: Command | None = None

    def __call__(self, command: Command, state: RobotState, dt: float, *, mid_stance: bool) -> Command:
        """Return the command that the controller is to follow in the next period, and count what was changed.

        Args:
            command: what the source asks for.
            state: the robot now.
            dt: time since the last call [s].
            mid_stance: whether a walk may end now (`hugwbc.stride.MidStance`).
        """
        if not isinstance(command, Command):
            what = f"a command is a {type(command).__name__}: keeping the last good one"
            self._log.count("source_failures", what)
            command = self._given or self.command
        if command is not self._given and command != self._given:  # most ticks repeat the last command
            self._given, (self.command, self._clamped) = command, command.clamp(self._robot)
        self._count("commands_clamped", self._clamped)
        if self.command is not self._asked and self.command != self._asked:
            self._asked, (self._possible, self._guarded) = self.command, feasible(self.command, self._robot)
        self._count("commands_guarded", self._guarded)
        command = self._braking(self._possible, state, dt, mid_stance=mid_stance)
        if self._braking.active:
            self._log.count("braked", "told to change the gait while moving: braking and standing first")
            command, guarded = feasible(command, self._robot)  # the old gait with the new posture
            self._count("commands_guarded", guarded)
        return command

    def _count(self, counter: str, changes: tuple[CommandChange, ...]) -> None:
        for change in changes:
            self._log.count_of(counter, change.name, change)
