"""The eight command values that controllers track, their ranges per gait and robot, validation and sampling."""

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence

import numpy as np

from hugwbc.errors import CommandError, UnknownNameError
from hugwbc.gait import COMMAND_NAMES, Gait
from hugwbc.numeric import changed, number
from hugwbc.robot import Robot

COMMAND_UNITS = {"v_x": "m/s", "v_y": "m/s", "omega": "rad/s", "f": "Hz", "l": "m", "h": "m", "p": "rad", "w": "rad"}
VELOCITY_NAMES = ("v_x", "v_y", "omega")
MEASURED_NAMES = (*VELOCITY_NAMES, "h", "p", "w")
"""The commands that are measured at all times, in the order of the columns of a record; f and l take whole steps."""
COMMAND_SIGNS = np.array([-1.0 if name in ("v_y", "omega", "w") else 1.0 for name in COMMAND_NAMES])  # in a mirror
# [m Hz^2], largest l f^2: the reaction of a swing grows with it, and the narrow feet cannot hold more.
SWING_REACTION = 1.9


@dataclasses.dataclass(frozen=True)
class CommandRange:
    """The default value of one command, its range at the start of training, and its range at the end."""

    default: float
    initial: tuple[float, float]
    finishing: tuple[float, float]


# The paper's table of command ranges, for every gait except hopping, and the leg that it belongs to [m].
PAPER_LEG = 0.8
_PAPER = {
    "v_x": CommandRange(0.0, (-0.6, 0.6), (-0.6, 2.0)),
    "v_y": CommandRange(0.0, (-0.6, 0.6), (-0.6, 0.6)),
    "omega": CommandRange(0.0, (-0.6, 0.6), (-1.0, 1.0)),
    "f": CommandRange(2.0, (1.5, 3.5), (1.5, 3.5)),
    "l": CommandRange(0.15, (0.1, 0.35), (0.1, 0.35)),
    "h": CommandRange(0.0, (-0.3, 0.0), (-0.3, 0.0)),
    "p": CommandRange(0.0, (0.0, 0.4), (0.0, 0.4)),
    "w": CommandRange(0.0, (-1.0, 1.0), (-1.0, 1.0)),
}
# How ranges grow with a leg's length: heights with it, and velocities with its root, at the same Froude number.
_GROWTH = {"v_x": 0.5, "v_y": 0.5, "l": 1.0, "h": 1.0}


@functools.lru_cache(maxsize=64)  # an evaluation may draw robots at random
def command_ranges(gait: Gait, robot: Robot | None = None) -> Mapping[str, CommandRange]:
    """Return the ranges of the eight commands in a gait, by name.

    A gait that does not travel has zero velocities only. In hops, the paper commands velocities and height alone.

    Args:
        gait: the gait.
        robot: whose ranges; the paper's are scaled by its leg, where its table has none. None for the paper's.
    """
    general = _PAPER if robot is None else {name: _of(robot, name) for name in COMMAND_NAMES}
    if not gait.travels:
        return general | {name: CommandRange(0.0, (0.0, 0.0), (0.0, 0.0)) for name in VELOCITY_NAMES}
    if not gait.hops:
        return general
    hopping = {name: general[name].default for name in ("f", "l", "p", "w")}
    aside = general["v_y"].finishing
    ahead = _within(aside, general["v_x"].finishing)
    return (
        general
        | {name: CommandRange(0.0, limits, limits) for name, limits in (("v_x", ahead), ("v_y", aside))}
        | {"omega": CommandRange(0.0, *2 * (general["omega"].initial,))}
        | {name: CommandRange(default, (default, default), (default, default)) for name, default in hopping.items()}
    )


def highest_swing(robot: Robot) -> float:
    """Return the highest l that a robot's legs allow at h = 0 [m]: the paper's, scaled. A squat takes -h from it."""
    return _scaled(robot, "l")["finishing"][1]


def _of(robot: Robot, name: str) -> CommandRange:
    ranges = {**_scaled(robot, name), **robot.commands.get(name, {})}
    low, high = ranges["finishing"]
    if name == "w":  # the waist's own range is the most
        low, high = _within((low, high), (float(robot.lower[robot.waist]), float(robot.upper[robot.waist])))
    default = min(max(_size(robot, name, _PAPER[name].default), low), high)
    return CommandRange(default, _within(ranges["initial"], (low, high)), (low, high))


def _within(part: tuple[float, float], limits: tuple[float, float]) -> tuple[float, float]:
    """Return a range with its ends moved into another one."""
    low, high = np.clip(part, *limits).tolist()
    return low, high


def _scaled(robot: Robot, name: str) -> dict[str, tuple[float, float]]:
    """Return the paper's ranges of a command in proportion to a robot's leg."""
    ends = {"initial": _PAPER[name].initial, "finishing": _PAPER[name].finishing}
    return {kind: (_size(robot, name, low), _size(robot, name, high)) for kind, (low, high) in ends.items()}


def _size(robot: Robot, name: str, value: float) -> float:
    return round((robot.leg_length / PAPER_LEG) ** _GROWTH.get(name, 0.0) * value, 2)


@dataclasses.dataclass(frozen=True)
class Command:
    """A request to a controller: eight numbers and a gait.

    Attributes:
        v_x, v_y: velocity of the pelvis in the heading frame (yaw only) [m/s].
        omega: yaw rate about gravity [rad/s].
        f: stride frequency, from touch-down to touch-down of one foot [Hz].
        l: highest sole clearance of a swing [m]; the default is the H1's, `default_command` has other robots'.
        h: pelvis height above the ground below it, minus the nominal one (0.98 m of an H1) [m].
        p: pelvis pitch, forward positive [rad].
        w: waist yaw, the angle of the torso joint [rad].
        gait: one of the gaits; its name and its number are understood as well.

    Raises:
        CommandError: if a value is no number; NaN and infinity are for `validate` and `clamp`.
        UnknownNameError: if there is no such gait.
    """

    v_x: float = 0.0
    v_y: float = 0.0
    omega: float = 0.0
    f: float = 2.0
    l: float = 0.15  # noqa: E741  the paper's symbol
    h: float = 0.0
    p: float = 0.0
    w: float = 0.0
    gait: Gait = Gait.STANDING

    def __post_init__(self) -> None:
        fields = vars(self)
        for name in COMMAND_NAMES:
            value = fields[name]
            if type(value) is not float:
                if (converted := number(value)) is None:
                    raise CommandError(f"command {name} is {value!r:.60}; give a number", at=(name,))
                object.__setattr__(self, name, converted)
        if type(self.gait) is not Gait:
            object.__setattr__(self, "gait", Gait.parse(self.gait))

    def array(self) -> np.ndarray:
        """Return the eight numbers in the order of `COMMAND_NAMES`, shape (8,)."""
        return np.array([self.v_x, self.v_y, self.omega, self.f, self.l, self.h, self.p, self.w])

    @classmethod
    def from_array(cls, values: np.ndarray, gait: Gait) -> "Command":
        """Build a command from eight numbers in the order of `COMMAND_NAMES`."""
        return cls(**dict(zip(COMMAND_NAMES, map(float, values), strict=True)), gait=gait)

    @classmethod
    def from_mapping(cls, values: Mapping[str, float], gait: Gait, robot: Robot | None = None) -> "Command":
        """Build the default command of a gait, for a robot, with some values replaced."""
        for name in values:
            if name not in COMMAND_NAMES:
                raise UnknownNameError("command", name, COMMAND_NAMES, at=(name,))
        return dataclasses.replace(default_command(gait, robot), **values)

    def validate(self, robot: Robot | None = None) -> "Command":
        """Return this command; raise a `CommandError` if a value is outside the gait's finishing range."""
        for name, limits in command_ranges(self.gait, robot).items():
            value = getattr(self, name)
            low, high = limits.finishing
            unit = COMMAND_UNITS[name]
            if not math.isfinite(value):
                message = f"command {name} is {value}; give a finite number from {low} to {high} {unit}"
                raise CommandError(message, at=(name,))
            if not low <= value <= high:
                raise CommandError(
                    f"command {name} = {value:g} {unit} is out of range for the {self.gait.label} gait; "
                    f"valid: {low:g} to {high:g} {unit}; choose a value in that range",
                    at=(name,),
                )
        return self

    def clamp(self, robot: Robot | None = None) -> tuple["Command", tuple["CommandChange", ...]]:
        """Return the nearest valid command and what was changed; NaN becomes the default.

        Control loops call this instead of `validate`, because nothing may raise inside a loop. The ranges are those of
        the robot, or the paper's.
        """
        changes, fields = [], vars(self)
        for name, limits in command_ranges(self.gait, robot).items():
            value = fields[name]
            low, high = limits.finishing
            if not low <= value <= high:  # nor is NaN
                valid = limits.default if math.isnan(value) else min(max(value, low), high)
                changes.append(CommandChange(name, value, valid, f"is outside {low:g} to {high:g}"))
        return changed_command(self, changes), tuple(changes)


@dataclasses.dataclass(frozen=True)
class CommandChange:
    """A command value that was replaced; `str` makes the sentence for people."""

    name: str  # one of `COMMAND_NAMES`
    asked: float  # the value as commanded
    used: float  # the value in its place
    why: str  # a clause that continues "name = asked", such as "is outside -0.6 to 2"

    def __str__(self) -> str:
        """Return the change as a clause, with the value used to three digits."""
        return f"{self.name} = {self.asked:g} {self.why}: using {self.used:.3g}"


def changed_command(command: Command, changes: Sequence[CommandChange]) -> Command:
    """Return the command with the changes applied; the same object if there are none."""
    return changed(command, **{change.name: change.used for change in changes}) if changes else command


def default_command(gait: Gait, robot: Robot | None = None) -> Command:
    """Return the command of a gait with every value at its default, for a robot or the paper's."""
    return Command(**{name: limits.default for name, limits in command_ranges(gait, robot).items()}, gait=gait)


def sample_all(gait: Gait, rng: np.random.Generator, size: int, robot: Robot | None = None) -> np.ndarray:
    """Draw all eight values independently from their finishing ranges; shape (size, 8)."""
    low, high = np.array([limits.finishing for limits in command_ranges(gait, robot).values()]).T
    return rng.uniform(low, high, (size, len(COMMAND_NAMES)))
