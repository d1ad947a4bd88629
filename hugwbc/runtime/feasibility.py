"""Combinations of commands that the robot's legs do not allow, each value being allowed by itself."""

import dataclasses
import math

from hugwbc.commands import Command, CommandChange, changed_command
from hugwbc.gait import Gait


@dataclasses.dataclass(frozen=True)
class FeasibilityLimits:
    """What the guard keeps to. No limit bites while all but one command are at their defaults."""

    reach: float = 0.35
    """Highest swing at h = 0 [m]; a squat takes as much from it as it lowers the pelvis: knee and ankle end."""
    least_reach: float = 0.15
    """Highest swing that is always left [m]."""
    swing_reaction: float = 1.9
    """Largest l f^2 [m Hz^2]: the narrow feet hold no more of a swing's reaction."""
    slow_step: float = 0.3
    """Longest step of a stride below `brisk` [m]: a fall grows as long as a step lasts."""
    brisk: float = 2.0
    """Stride frequency at which every commanded speed can be walked [Hz]."""
    sideways: float = 1.2
    """Largest centripetal acceleration v omega [m/s^2]: the legs have no ankle roll to lean on."""
    fastest: tuple[float, float, float] = (2.0, 0.6, 0.6)
    """Semi-axes of the velocities that go together: forward, backward, to either side [m/s]."""


def feasible(command: Command, limits: FeasibilityLimits | None = None) -> tuple[Command, tuple[CommandChange, ...]]:
    """The nearest command that the legs allow, and a report of what was changed.

    The first of these has its way over the next: v_x, then v_y within the ellipse of speeds that go together; omega;
    f; l. Standing needs no legs to swing and comes back as it is.

    Args:
        command: each value finite and within its range (`Command.clamp`).
        limits: None for the H1's.

    Returns:
        The command, and one line for each value that was changed.
    """
    if command.gait is Gait.STANDING:
        return command, ()
    limits = limits or FeasibilityLimits()
    forward, backward, aside = limits.fastest
    v_x = command.v_x
    share = min(abs(v_x) / (forward if v_x > 0.0 else backward), 1.0)
    v_y = _within(command.v_y, aside * math.sqrt(1.0 - share**2))
    speed = math.hypot(v_x, v_y)
    omega = _within(command.omega, limits.sideways / speed if speed > 0.0 else math.inf)
    f = max(command.f, min(speed / (2.0 * limits.slow_step), limits.brisk))
    reach = max(limits.reach + command.h, limits.least_reach)
    # A hop's free leg does not swing, and its frequency is not commanded.
    reaction = math.inf if command.gait.hops else limits.swing_reaction / f**2
    l = min(command.l, reach, reaction)  # noqa: E741  the paper's symbol
    reasons = {
        "v_y": (v_y, f"beside v_x = {v_x:g} m/s"),
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
