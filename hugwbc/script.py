"""Command scripts: what the robot is asked to do over time, the same for every controller.

A script is a list of segments of plain numbers. Within a segment the commands ramp smoothly from the previous
segment's values to its own, and then hold; the gait switches at once, at the segment's start.
"""

import bisect
import dataclasses
import functools
import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from hugwbc.commands import COMMAND_NAMES, COMMAND_UNITS, Command, command_ranges, default_command
from hugwbc.errors import CommandError, ConfigError, TargetError, UnknownNameError
from hugwbc.gait import Gait
from hugwbc.targets import HAND_FRAMES, HandFrame, HandTargets, position

DEFAULT_RAMP = 1.0  # [s]
Point = tuple[float, float, float]


def smooth_step(u: float) -> float:
    """Minimum-jerk blend from 0 at u <= 0 to 1 at u >= 1: velocity and acceleration vanish at both ends."""
    u = min(max(u, 0.0), 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)


@dataclasses.dataclass(frozen=True)
class HandPath:
    """A hand that swings about a point: position = centre + amplitude * sin(2 pi (t / period + phase)), by axis.

    Attributes:
        centre: [m].
        amplitude: along x, y and z [m].
        phase: of each axis, in periods; (0, 0.25, 0) makes an ellipse of x and y.
        period: [s].
    """

    centre: Point
    amplitude: Point = (0.0, 0.0, 0.0)
    phase: Point = (0.0, 0.0, 0.0)
    period: float = 4.0

    def __post_init__(self) -> None:
        for name in ("centre", "amplitude", "phase"):
            position(f"hand path's {name}", getattr(self, name))
        if not (math.isfinite(self.period) and self.period > 0.0):
            raise TargetError(f"hand path's period is {self.period}; give a finite number of seconds above 0")

    def at(self, t: float) -> np.ndarray:
        """Position at time `t` [s], shape (3,) [m]."""
        angle = 2.0 * math.pi * (t / self.period + np.asarray(self.phase))
        return np.asarray(self.centre) + np.asarray(self.amplitude) * np.sin(angle)

    def mirrored(self) -> "HandPath":
        """The path of the other hand in a mirror: y changes sign."""
        (cx, cy, cz), (ax, ay, az) = self.centre, self.amplitude
        return dataclasses.replace(self, centre=(cx, -cy, cz), amplitude=(ax, -ay, az))


@dataclasses.dataclass(frozen=True)
class HandMotion:
    """Paths of both hands, in one frame (see `HandTargets`)."""

    left: HandPath
    right: HandPath
    frame: HandFrame = "pelvis"

    def __post_init__(self) -> None:
        if self.frame not in HAND_FRAMES:
            raise UnknownNameError("hand frame", self.frame, HAND_FRAMES)

    def at(self, t: float) -> HandTargets:
        """Targets at time `t` [s]."""
        return HandTargets(self.left.at(t), self.right.at(t), self.frame)


@dataclasses.dataclass(frozen=True)
class Segment:
    """A stretch of a script.

    Attributes:
        label: what happens, for people.
        duration: [s].
        gait: from the segment's start.
        commands: values by name, reached after `ramp`; commands that are not named go to their default.
        hands: None leaves the arms to the controller.
        ramp: time from the previous segment's values to this one's [s]; for the hands as well.
    """

    label: str
    duration: float
    gait: Gait = Gait.STANDING
    commands: Mapping[str, float] = dataclasses.field(default_factory=dict)
    hands: HandMotion | None = None
    ramp: float = DEFAULT_RAMP

    def __post_init__(self) -> None:
        if not (math.isfinite(self.duration) and self.duration > 0.0):
            raise ConfigError(f"segment '{self.label}' lasts {self.duration} s; give a finite duration above 0 s")
        if not 0.0 <= self.ramp <= self.duration:
            raise ConfigError(
                f"segment '{self.label}' ramps for {self.ramp} s; give 0 s up to its duration of {self.duration:g} s"
            )
        object.__setattr__(self, "commands", MappingProxyType(dict(self.commands)))
        self.command()

    def command(self) -> Command:
        """The command at the end of the ramp.

        Raises:
            UnknownNameError: if a name in `commands` is no command.
            CommandError: if a value is not finite or not in the gait's range.
        """
        try:
            return Command.from_mapping(self.commands, self.gait).validate()
        except CommandError as error:
            raise CommandError(f"segment '{self.label}': {error}") from None

    def blend(self, elapsed: float) -> float:
        """How much of the way from the previous segment's values has been covered after `elapsed` [s], in [0, 1]."""
        return 1.0 if self.ramp == 0.0 else smooth_step(elapsed / self.ramp)


@dataclasses.dataclass(frozen=True)
class Script:
    """Segments one after the other, checked when it is made: no ramp leaves the range of its gait.

    Attributes:
        name: for tables and files.
        segments: at least one.
    """

    name: str
    segments: tuple[Segment, ...]

    def __post_init__(self) -> None:
        if not self.segments:
            raise ConfigError(f"script '{self.name}' is empty; give it at least one segment")
        for before, after in zip(self.segments, self.segments[1:], strict=False):
            _check_transition(before, after)

    @functools.cached_property
    def _ends(self) -> list[float]:
        return np.cumsum([segment.duration for segment in self.segments]).tolist()

    @functools.cached_property
    def _values(self) -> list[np.ndarray]:
        """Command values before the script and at the end of each segment's ramp."""
        return [default_command(self.segments[0].gait).array(), *(s.command().array() for s in self.segments)]

    @property
    def duration(self) -> float:
        """Of all segments [s]."""
        return self._ends[-1]

    def _locate(self, t: float) -> tuple[int, float]:
        """Index of the segment at time `t` and the time since its start [s]; times outside are moved to the ends."""
        index = min(bisect.bisect_right(self._ends, t), len(self.segments) - 1)
        start = self._ends[index - 1] if index else 0.0
        return index, min(max(t - start, 0.0), self.segments[index].duration)

    def segment_at(self, t: float) -> Segment:
        """The segment at time `t` [s]; before the start the first, after the end the last."""
        return self.segments[self._locate(t)[0]]

    def command_at(self, t: float) -> Command:
        """The command at time `t` [s]; the script starts from the default command, and its end holds for ever."""
        index, elapsed = self._locate(t)
        segment = self.segments[index]
        before, after = self._values[index], self._values[index + 1]
        return Command.from_array(before + segment.blend(elapsed) * (after - before), segment.gait)

    def hands_at(self, t: float) -> HandTargets | None:
        """The hand targets at time `t` [s], or None where the arms are the controller's."""
        index, elapsed = self._locate(t)
        segment = self.segments[index]
        if segment.hands is None:
            return None
        targets = segment.hands.at(t)
        before = self.segments[index - 1].hands if index else None
        if before is None:
            return targets
        start, blend = before.at(t), segment.blend(elapsed)
        left = start.left + blend * (targets.left - start.left)
        right = start.right + blend * (targets.right - start.right)
        return HandTargets(left, right, targets.frame)


def _check_transition(before: Segment, after: Segment) -> None:
    """Ranges are boxes and ramps are convex: if the start of a ramp is valid in the new gait, all of it is."""
    start = before.command()
    for name in COMMAND_NAMES:
        low, high = command_ranges(after.gait)[name].finishing
        value = getattr(start, name)
        if not low <= value <= high:
            unit = COMMAND_UNITS[name]
            raise CommandError(
                f"segment '{after.label}' ({after.gait.label}) starts from {name} = {value:g} {unit} of segment "
                f"'{before.label}', but {after.gait.label} allows {low:g} to {high:g} {unit}; "
                f"put a {before.gait.label} segment between them that brings {name} into that range"
            )
    if before.hands is not None and after.hands is not None and before.hands.frame != after.hands.frame:
        raise TargetError(
            f"segment '{after.label}' changes the hand frame from {before.hands.frame} to {after.hands.frame}; "
            "put a segment without hands between them"
        )


_LEFT_PATH = HandPath(centre=(0.30, 0.28, 0.16), amplitude=(0.05, 0.04, 0.06), phase=(0.0, 0.25, 0.25))
# Half a period apart: while the left hand goes up, the right one goes down.
_RIGHT_PATH = dataclasses.replace(_LEFT_PATH.mirrored(), phase=(0.5, 0.75, 0.75))
_MOVING_HANDS = HandMotion(left=_LEFT_PATH, right=_RIGHT_PATH)

_SCRIPTS = {
    "loco_manipulation": (
        Segment("stand", 2.0),
        Segment("reach", 3.0, hands=_MOVING_HANDS),
        Segment("walk", 4.0, Gait.WALKING, {"v_x": 0.5}, _MOVING_HANDS),
        Segment("turn", 3.0, Gait.WALKING, {"omega": 0.4}, _MOVING_HANDS),
        Segment("stop", 1.0, Gait.WALKING, {}, _MOVING_HANDS),
        Segment("settle", 1.0, Gait.STANDING, {}, _MOVING_HANDS),
        Segment("squat", 3.5, Gait.STANDING, {"h": -0.2, "p": 0.3, "w": 0.5}, _MOVING_HANDS, ramp=1.5),
        Segment("stand up", 1.5, Gait.STANDING, {}, _MOVING_HANDS, ramp=1.5),
        Segment("hand back", 1.0),
    ),
    "stand": (Segment("stand", 5.0),),
    "walk": (
        Segment("stand", 1.0),
        Segment("walk", 6.0, Gait.WALKING, {"v_x": 0.5}),
        Segment("stop", 1.5, Gait.WALKING),
        Segment("stand still", 1.5),
    ),
    "squat": (
        Segment("stand", 1.0),
        Segment("squat", 3.5, Gait.STANDING, {"h": -0.2, "p": 0.3, "w": 0.5}, ramp=1.5),
        Segment("stand up", 2.5, ramp=1.5),
    ),
}
SCRIPT_NAMES = tuple(_SCRIPTS)


def load_script(name: str) -> Script:
    """The shipped script of that name.

    Raises:
        UnknownNameError: if there is none.
    """
    if name not in _SCRIPTS:
        raise UnknownNameError("script", name, SCRIPT_NAMES)
    return Script(name, _SCRIPTS[name])
