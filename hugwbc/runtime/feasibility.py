"""Combinations of commands that the legs do not allow although each value is within its range."""

import dataclasses
import math

from hugwbc.commands import Command, CommandChange, changed_command
from hugwbc.gait import Gait


@dataclasses.dataclass(frozen=True)
class FeasibilityLimits:
    """Limits of the guard. None of them acts while all commands but one are at their defaults."""

    reach: float = 0.35
    """Highest swing at h = 0 [m]. A squat reduces it by as much as it lowers the pelvis, by the ranges of knee and
    ankle."""
    least_reach: float = 0.15
    """Highest swing that is allowed at any height [m]."""
    swing_reaction: float = 1.9
    """Largest l f^2 [m Hz^2]. The reaction of a swing grows with it, and the narrow feet cannot hold more."""
    slow_step: float = 0.3
    """Longest step at stride frequencies below `brisk` [m]. The robot falls sideways for as long as a step lasts."""
    brisk: float = 2.0
    """Stride frequency that is enough for every commanded speed [Hz]."""
    sideways: float = 1.2
    """Largest centripetal acceleration v omega [m/s^2]. Without ankle roll the legs cannot hold more."""
    fastest: tuple[float, float, float] = (2.0, 0.6, 0.6)
    """Semi-axes of the ellipse of allowed velocities: forward, backward, to either side [m/s]."""


def feasible(command: Command, limits: FeasibilityLimits | None = None) -> tuple[Command, tuple[CommandChange, ...]]:
    """Return the nearest command that the legs allow, and what was changed.

    Commands have priority in this order: v_x; then v_y within the ellipse of allowed velocities; omega; f; l. A
    standing command comes back as it is, because no leg swings.

    Args:
        command: each value finite and within its range (`Command.clamp`).
        limits: None for the H1's.

    Returns:
        The command, and one record for each value that was changed.
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
    # The free leg of a hop does not swing, and its frequency is not commanded.
    reaction = math.inf if command.gait.hops else limits.swing_reaction / f**2
    l = min(command.l, reach, reaction)  # noqa: E741  the paper's symbol
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
