"""What an episode of a protocol consists of, as plain numbers: commands over time, forces, conditions.

Plans are frozen, equal by value, picklable, and `dataclasses.asdict` of one is JSON.
"""

import bisect
import dataclasses
import math

from hugwbc.commands import Command
from hugwbc.errors import ConfigError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.navigation import Navigator, Tour
from hugwbc.runtime.loop import CommandSource, Constant
from hugwbc.sim.forces import Force
from hugwbc.targets import HandTargets


@dataclasses.dataclass(frozen=True)
class Knot:
    """A point of a schedule.

    Attributes:
        time: when the command sets out for this one [s]; the gait changes at once.
        command: reached after `ramp`, and held.
        ramp: time in which the eight numbers go there linearly [s].
    """

    time: float
    command: Command
    ramp: float = 0.0


@dataclasses.dataclass(frozen=True)
class Schedule:
    """Commands that step or go linearly from knot to knot; a command source without hands.

    Attributes:
        knots: in the order of time, the first at 0 s; no ramp lasts into the next knot.
    """

    knots: tuple[Knot, ...]

    def __post_init__(self) -> None:
        if not self.knots or self.knots[0].time != 0.0 or self.knots[0].ramp != 0.0:
            raise ConfigError("a schedule needs at least one knot, the first at 0 s without a ramp")
        for knot, after in zip(self.knots, [*self.knots[1:], None], strict=True):
            if not (0.0 <= knot.ramp < math.inf) or (after and not knot.time + knot.ramp <= after.time < math.inf):
                raise ConfigError(
                    f"the knot at {knot.time} s ramps for {knot.ramp} s; give 0 s or more, ending before the next knot"
                )

    def command_at(self, t: float) -> Command:
        """The command at time t [s]; before the start the first, after the end the last."""
        index = max(bisect.bisect_right([knot.time for knot in self.knots], t + 1e-9) - 1, 0)
        knot, elapsed = self.knots[index], max(t - self.knots[index].time, 0.0)
        if elapsed >= knot.ramp:
            return knot.command
        before, after = self.knots[index - 1].command.array(), knot.command.array()
        return Command.from_array(before + elapsed / knot.ramp * (after - before), knot.command.gait)

    def hands_at(self, t: float) -> HandTargets | None:
        """None: the arms are the controller's, or the conditions' intervention's."""
        return None


@dataclasses.dataclass(frozen=True)
class EpisodePlan:
    """One episode.

    Attributes:
        commands: one for the whole episode, a schedule, or a tour, whose commands depend on where the robot is.
        forces: that act on the robot.
        conditions: of this episode; None for those of the protocol's settings.
        draw: number that, with the settings' seed, determines ground, sensors' noise and arms; None for the episode's
            place in the list.
        timed: whether the time that the controller takes matters: such an episode runs by itself.
        label: what the episode is for, to the protocol that judges it.
    """

    commands: Command | Schedule | Tour
    forces: tuple[Force, ...] = ()
    conditions: Conditions | None = None
    draw: int | None = None
    timed: bool = False
    label: str = ""

    @property
    def source(self) -> CommandSource:
        """The commands over time, for one rollout."""
        if isinstance(self.commands, Tour):
            return Navigator(self.commands)
        return Constant(self.commands) if isinstance(self.commands, Command) else self.commands

    @property
    def command(self) -> Command:
        """The command at the start, which is that of the whole episode without a schedule."""
        return self.source.command_at(0.0)
