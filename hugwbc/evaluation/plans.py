"""Plans of episodes as plain numbers: commands over time, forces, conditions. They are frozen and picklable."""

import bisect
import dataclasses
import math
from collections.abc import Mapping

from hugwbc.commands import Command
from hugwbc.errors import ConfigError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.scripts.view import CommandSource, Constant
from hugwbc.sim.forces import Force
from hugwbc.targets import HandTargets

_STAND = Command()


@dataclasses.dataclass(frozen=True)
class Knot:
    """A point of a schedule."""

    time: float  # time at which the command starts to change to this one [s]; the gait changes at once
    command: Command  # command that is reached after `ramp` and then held
    ramp: float = 0.0  # duration of the linear change of the eight numbers [s]


@dataclasses.dataclass(frozen=True)
class Schedule:
    """A command source that steps or ramps linearly from knot to knot, without hand targets."""

    knots: tuple[Knot, ...]  # knots ordered by time, the first at 0 s; a ramp ends by the next knot

    def __post_init__(self) -> None:
        if not self.knots or self.knots[0].time != 0.0 or self.knots[0].ramp != 0.0:
            raise ConfigError("a schedule needs at least one knot, the first at 0 s without a ramp")
        for knot, after in zip(self.knots, [*self.knots[1:], None], strict=True):
            if not (0.0 <= knot.ramp < math.inf) or (after and not knot.time + knot.ramp <= after.time < math.inf):
                raise ConfigError(
                    f"the knot at {knot.time} s ramps for {knot.ramp} s; give 0 s or more, ending before the next knot"
                )

    def command_at(self, t: float) -> Command:
        """Return the command at time t [s]: the first one before the start, the last one after the end."""
        # The tolerance makes a control step at a knot's time take the knot in spite of rounding.
        index = max(bisect.bisect_right([knot.time for knot in self.knots], t + 1e-9) - 1, 0)
        knot, elapsed = self.knots[index], max(t - self.knots[index].time, 0.0)
        if elapsed >= knot.ramp:
            return knot.command
        before, after = self.knots[index - 1].command.array(), knot.command.array()
        return Command.from_array(before + elapsed / knot.ramp * (after - before), knot.command.gait)

    def hands_at(self, t: float) -> HandTargets | None:
        """Return None: the arms belong to the controller or to the intervention of the conditions."""
        return None


@dataclasses.dataclass(frozen=True)
class Plan:
    """The plan of one episode.

    Attributes:
        draw: number that, together with the settings' seed, determines ground, sensor noise and arm motion. Plans with
            the same draw meet the same randomness.
        commands: one command for the whole episode, or a schedule.
        tags: what the episode is for; columns of its row.
        forces: external forces on the robot.
        conditions: conditions of this episode; None for those of the settings.
    """

    draw: int
    commands: Command | Schedule = _STAND
    tags: Mapping[str, str | float] = dataclasses.field(default_factory=dict)
    forces: tuple[Force, ...] = ()
    conditions: Conditions | None = None

    @property
    def source(self) -> CommandSource:
        """A new command source for one rollout."""
        return Constant(self.commands) if isinstance(self.commands, Command) else self.commands

    @property
    def command(self) -> Command:
        """The command at the start; without a schedule, that of the whole episode."""
        return self.source.command_at(0.0)
