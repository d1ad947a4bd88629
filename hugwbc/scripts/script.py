"""Command scripts: what the robot does over time, the same for every controller.

A script is a list of segments. Within a segment the commands ramp smoothly from the previous segment's values to its
own, and then hold; the gait switches at the segment's start. A file says the same in YAML; the shipped ones
are in `hugwbc/scripts`.

    segments:
      - label: wave
        duration: 3
        gait: standing            # optional, like everything but label and duration
        commands: {h: -0.1}
        ramp: 1
        hands:
          frame: pelvis           # pelvis, heading, steady or world
          right_direction: [1, 0, 0]  # along which the forearm points; left_direction likewise
          left_orientation: level # or [w, x, y, z], of a hand with wrists; right_orientation likewise
          together: true          # both hands hold one object
          whole_body: true        # h, p and w may help
          left: {line: {points: [[0.3, 0.3, 0.1], [0.3, 0.3, 0.3]], leg_time: 1, repeat: true}}
          right: mirror           # mirror image of the left; a hand that is left out rests
      - label: gesture
        duration: 5
        motion: wave.npz          # arm joints from a motion file (see `hugwbc.scripts.motion`), instead of hands

A path is one of `hold`, `line`, `grid`, `circle`, `swing` and `wander`, with the fields of the class of that name in
`hugwbc.scripts.hand_paths`, or `file`, a CSV file (t, x, y, z). Paths of CSV and motion files are relative to the
script. YAML anchors may repeat parts.
"""

import bisect
import dataclasses
import functools
import itertools
import logging
import pathlib
from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PlainValidator,
    TypeAdapter,
    ValidationInfo,
    model_validator,
)

from hugwbc.commands import COMMAND_NAMES, COMMAND_UNITS, VELOCITY_NAMES, Command, command_ranges, default_command
from hugwbc.errors import CommandError, ConfigError, HugwbcError, TargetError, UnknownNameError
from hugwbc.gait import Gait
from hugwbc.numeric import changed, smooth_rate, smooth_step
from hugwbc.robot import SIDES, Robot
from hugwbc.scripts import hand_paths
from hugwbc.scripts.hand_paths import HandPath, Point, Recorded, read_path
from hugwbc.scripts.motion import ArmMotion, check_motion, load_motion
from hugwbc.scripts.sampled import check_pace
from hugwbc.settings import Beside, NotNegative, Positive, refusing, settings
from hugwbc.settings_file import load, named_path, shipped_names
from hugwbc.targets import FARTHEST_HAND, HandFrame, HandTargets, Orientation

_log = logging.getLogger(__name__)

DEFAULT_RAMP = 1.0  # [s]
HIGHEST_HAND = 10.0  # [m] above or below the world's origin: a target beyond it is in another unit
_PACE, _JUMP = (0.005, 5.0), 0.05  # [m/s], [m]; an arm at its joints' speed limits reaches 5 m/s
_PATHS: dict[str, TypeAdapter[Any]] = {
    name: TypeAdapter(dict[str, getattr(hand_paths, name.title())])  # pyright: ignore[reportInvalidTypeForm]
    for name in ("hold", "line", "grid", "circle", "swing", "wander")
}
_KINDS = (*_PATHS, "file")


def _path(value: Any, info: ValidationInfo) -> HandPath | None:  # noqa: ANN401
    """Return a path that is given as one, or declared as {KIND: its fields}."""
    if value is None or isinstance(value, HandPath):
        return value
    if value == "mirror":  # else `_mirror` has replaced it
        raise ConfigError("the other hand has no path to mirror; give it one")
    if not isinstance(value, Mapping) or len(value) != 1:
        raise ConfigError(f"a hand has one path; give one of {', '.join(_KINDS)}, or mirror")
    ((kind, fields),) = value.items()
    if kind == "mirrored":
        return _path(fields, info).mirrored()  # pyright: ignore[reportOptionalMemberAccess]  `_mirror` made it
    if kind == "file":
        return read_path(TypeAdapter(Beside).validate_python(fields, context=info.context))
    if kind not in _PATHS:
        raise UnknownNameError("path", kind, _KINDS, at=(kind,))
    fields = {"point": fields} if kind == "hold" and not isinstance(fields, Mapping) else fields
    return _PATHS[kind].validate_python({kind: fields})[kind]


def _motion(value: Any, info: ValidationInfo) -> ArmMotion | None:  # noqa: ANN401
    """Return the motion of a file, the same object for the same file, so that it can go on from segment to segment."""
    if value is None or isinstance(value, ArmMotion):
        if value is not None and (warning := check_motion(f"motion '{value.name}'", value)):
            _log.warning("%s", warning)
        return value
    path = TypeAdapter(Beside).validate_python(value, context=info.context)
    known = {} if info.context is None else info.context
    if path not in known:
        if (robot := known.get("robot")) is None:
            raise ConfigError(f"whose arms {path} moves is not known; give a robot: load_script(name, robot)")
        known[path] = load_motion(path, robot)
    return known[path]


def _robot(robot: Robot | None, info: ValidationInfo) -> Robot | None:
    """Return a robot, or the one for which a file is read."""
    return robot or (info.context or {}).get("robot")


_Path = Annotated[HandPath | None, PlainValidator(refusing(_path))]


@settings
class HandMotion:
    """Paths of the hands in one frame; None for a hand that rests next to the body. See `HandTargets` for the rest."""

    left: _Path = None
    right: _Path = None
    frame: HandFrame = "pelvis"
    left_direction: Point | None = None
    right_direction: Point | None = None
    together: bool = False
    whole_body: bool = False
    left_orientation: Orientation | None = None
    right_orientation: Orientation | None = None
    orientation_weight: float | None = None

    @model_validator(mode="before")
    @classmethod
    def _mirror(cls, data: Any) -> Any:  # noqa: ANN401
        """Let a hand in a file mirror the other one's path."""
        for side, other in (("left", "right"), ("right", "left")):
            if isinstance(data, Mapping) and data.get(side) == "mirror" and isinstance(data.get(other), Mapping):
                return {**data, side: {"mirrored": data[other]}}
        return data

    def __post_init__(self) -> None:
        if self.left is None and self.right is None:
            raise TargetError("neither hand has a path; give at least one, or no hands at all")
        for side, path in zip(SIDES, (self.left, self.right), strict=True):
            if path is not None:
                _check_path(side, path, self.frame)
                continue
            for name in (f"{side}_direction", f"{side}_orientation"):
                if getattr(self, name) is not None:
                    raise TargetError(f"{name} is given, but the {side} hand has no path; give it one")
        if self.orientation_weight is not None and self.left_orientation is self.right_orientation is None:
            raise TargetError("orientation_weight is given, but no hand has an orientation; give it one")
        start = self.at(0.0)
        HandTargets.of(start.left, start.right, self.frame)

    @model_validator(mode="after")
    @refusing
    def _fits(self, info: ValidationInfo) -> "HandMotion":
        """Refuse targets that the robot for which a file is read cannot follow."""
        if info.context and (robot := info.context.get("robot")) is not None:
            self.at(0.0).check(robot)
        return self

    def at(self, t: float) -> HandTargets:
        """Return the targets at time `t` [s] since the motion's start."""
        left, right = (None if path is None else path.at(t) for path in (self.left, self.right))
        return changed(self._still, left=left, right=right)

    @functools.cached_property
    def _still(self) -> HandTargets:
        """The targets without what moves, checked."""
        fields: dict[str, Any] = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        fields |= {side: fields[side] and (0, 0, 0) for side in SIDES}
        return HandTargets.of(**fields)


def _check_path(side: str, path: HandPath, frame: HandFrame) -> None:
    """Refuse a path that is in other units, leaves the hand's surroundings, or jumps."""
    while isinstance(path, hand_paths.Mirrored):  # it goes as far and as fast
        path = path.path
    times, points, pause = _samples(path)
    if frame == "world":  # the robot may walk there, but not fly
        far, most, what = np.abs(points[:, 2]), HIGHEST_HAND, "above or below the floor"
    else:
        far, most, what = np.linalg.norm(points, axis=1), FARTHEST_HAND, "from the pelvis"
    beyond = np.flatnonzero(~(far <= most))  # a NaN fails the comparison
    if beyond.size:
        raise TargetError(
            f"the {side} hand path goes up to {far[beyond].max():.1f} m {what}, with {len(beyond) / len(far):.0%} of "
            f"its samples beyond {most:g} m, the first at {times[beyond[0]]:.2f} s; give metres: divide millimetres "
            "by 1000, centimetres by 100"
        )
    moved = np.linalg.norm(np.diff(points, axis=0), axis=1)
    going = times - pause * np.arange(len(times))  # a pause must not hide how fast the hand goes between its points
    check_pace(f"the {side} hand path", going, moved, "m", _PACE, _JUMP, exact=not isinstance(path, Recorded))


def _samples(path: HandPath) -> tuple[np.ndarray, np.ndarray, float]:
    """Return times [s] and points [m] that show how far and how fast a path goes, and its pause at each point [s]."""
    if isinstance(path, Recorded):
        return *path.samples, 0.0
    if isinstance(path, hand_paths.Line | hand_paths.Grid):
        return np.arange(len(path.points)) * (path.leg_time + path.dwell), np.array(path.points), path.dwell
    if isinstance(path, hand_paths.Wander):  # from corner to opposite corner of its box, as far and as fast as it goes
        corners = [0.5 * np.array(signs) * path.size for signs in itertools.product((-1.0, 1.0), repeat=3)]
        points = np.array([path.centre + sign * corner for corner in corners for sign in (1.0, -1.0)])
        return np.arange(len(points)) * path.leg_time, points, 0.0
    period = getattr(path, "period", 60.0)
    times = np.linspace(0.0, period, round(min(max(period / 0.02, 8), 600)) + 1)
    return times, np.stack([path.at(float(t)) for t in times]), 0.0


@settings
class Segment:
    """One segment of a script.

    Attributes:
        label: description for people.
        duration: length of the segment [s].
        gait: gait from the segment's start.
        commands: values by name, reached after `ramp`; all other commands go to their defaults.
        hands: paths of the hands; None leaves the arms to the controller. Paths equal to the previous segment's
            continue; others start.
        ramp: time from the previous segment's values to this segment's, for commands and hands [s]; `DEFAULT_RAMP`, or
            the duration where that is shorter, if left out.
        motion: motion of the arm joints, instead of hands. The previous segment's own object continues, another one
            starts; at its end the arms rest.
        robot: whose ranges and defaults the commands have; None for the one that a file is loaded for, or the paper's.
    """

    label: str
    duration: Positive
    gait: Annotated[Gait, BeforeValidator(refusing(Gait.parse))] = Gait.STANDING
    commands: Annotated[Mapping[str, float], AfterValidator(MappingProxyType)] = Field(
        default_factory=dict, validate_default=True
    )
    hands: HandMotion | None = None
    ramp: NotNegative = Field(default_factory=lambda given: min(DEFAULT_RAMP, given.get("duration", DEFAULT_RAMP)))
    motion: Annotated[ArmMotion | None, PlainValidator(refusing(_motion))] = None
    robot: Annotated[Robot | None, AfterValidator(_robot)] = Field(default=None, validate_default=True, repr=False)

    def __post_init__(self) -> None:
        try:
            self.command().validate(self.robot)
        except HugwbcError as error:
            raise CommandError(f"segment '{self.label}': {error}", at=("commands", *error.at)) from None
        if self.ramp > self.duration:
            message = f"segment '{self.label}' ramps for {self.ramp} s; give up to its duration of {self.duration:g} s"
            raise ConfigError(message, at=("ramp",))
        if self.hands is not None and self.motion is not None:
            raise TargetError(f"segment '{self.label}' has both hands and a motion of the arms; give one of them")
        if self.motion and self.robot and self.motion.robot.arm_names != self.robot.arm_names:
            raise TargetError(
                f"segment '{self.label}' has commands of {self.robot.name}, but its motion '{self.motion.name}' moves "
                f"the arms of {self.motion.robot.name}; load the motion for {self.robot.name}"
            )

    def command(self) -> Command:
        """Return the command at the end of the ramp."""
        return Command.from_mapping(self.commands, self.gait, self.robot)

    def blend(self, elapsed: float) -> float:
        """Return the share of the ramp that is done after `elapsed` [s], in [0, 1]."""
        return 1.0 if self.ramp == 0.0 else smooth_step(elapsed / self.ramp)

    def blend_rate(self, elapsed: float) -> float:
        """Return the rate of `blend` after `elapsed` [s], in 1/s."""
        return 0.0 if self.ramp == 0.0 else smooth_rate(elapsed / self.ramp) / self.ramp


@settings
class Script:
    """A sequence of segments. The constructor checks that no ramp leaves the range of its gait.

    Attributes:
        name: name for tables and files.
        segments: at least one segment.
        about: description for people.
    """

    name: str
    segments: Annotated[tuple[Segment, ...], Field(min_length=1)]
    about: str = ""

    def __post_init__(self) -> None:
        for index, (before, after) in enumerate(itertools.pairwise(self.segments), start=1):
            _check_transition(before, after, at=("segments", index))

    @functools.cached_property
    def _ends(self) -> list[float]:
        return np.cumsum([segment.duration for segment in self.segments]).tolist()

    @functools.cached_property
    def _hand_starts(self) -> list[float]:
        """Start time of each segment's hand motion, which is that of the first segment that shares it [s]."""
        starts: list[float] = []
        begin = 0.0
        for index, segment in enumerate(self.segments):
            before = self.segments[index - 1]
            goes_on = index > 0 and segment.hands == before.hands and segment.motion is before.motion
            starts.append(starts[-1] if goes_on else begin)
            begin = self._ends[index]
        return starts

    @functools.cached_property
    def _values(self) -> list[np.ndarray]:
        """Command values before the script and at the end of each segment's ramp."""
        first = self.segments[0]
        return [default_command(first.gait, first.robot).array(), *(s.command().array() for s in self.segments)]

    @property
    def duration(self) -> float:
        """Total length of all segments [s]."""
        return self._ends[-1]

    def _locate(self, t: float) -> tuple[int, float]:
        """Return the segment's index at time `t` and the time since its start [s]; times outside move to the ends."""
        index = min(bisect.bisect_right(self._ends, t), len(self.segments) - 1)
        start = self._ends[index - 1] if index else 0.0
        return index, min(max(t - start, 0.0), self.segments[index].duration)

    def command_at(self, t: float) -> Command:
        """Return the command at time `t` [s]; a script starts at the default command, and its end holds for ever."""
        index, elapsed = self._locate(t)
        segment = self.segments[index]
        before, after = self._values[index], self._values[index + 1]
        values = before + segment.blend(elapsed) * (after - before)
        # Rounding may carry the values past the end of the ramp, and so out of a range.
        values = np.clip(values, np.minimum(before, after), np.maximum(before, after))
        return Command.from_array(values, segment.gait)

    def hands_at(self, t: float) -> HandTargets | None:
        """Return the targets of hands or arm joints at time `t` [s]; None where the controller moves the arms."""
        index, elapsed = self._locate(t)
        segment = self.segments[index]
        if segment.motion is not None:
            return self._joints_at(t, index, segment.motion, elapsed)
        if segment.hands is None:
            return None
        targets = segment.hands.at(t - self._hand_starts[index])
        before = self.segments[index - 1].hands if index else None
        if before is None or before == segment.hands:
            return targets
        start, blend = before.at(t - self._hand_starts[index - 1]), segment.blend(elapsed)
        left = _blended(start.left, targets.left, blend)
        right = _blended(start.right, targets.right, blend)
        return dataclasses.replace(targets, left=left, right=right)

    def _joints_at(self, t: float, index: int, motion: ArmMotion, elapsed: float) -> HandTargets:
        q, dq = motion.at(t - self._hand_starts[index])
        before = self.segments[index - 1].motion if index else None
        if before is not None and before is not motion:
            start, start_dq = before.at(t - self._hand_starts[index - 1])
            blend, rate = self.segments[index].blend(elapsed), self.segments[index].blend_rate(elapsed)
            q, dq = start + blend * (q - start), start_dq + blend * (dq - start_dq) + rate * (q - start)
        return HandTargets(None, None, joints=q, joint_velocity=dq)


def _blended(start: np.ndarray | None, end: np.ndarray | None, blend: float) -> np.ndarray | None:
    """Interpolate between two targets of a hand; without one of them there is nothing to blend."""
    return end if start is None or end is None else start + blend * (end - start)


def _check_transition(before: Segment, after: Segment, at: tuple[str, int]) -> None:
    """Refuse a segment that cannot follow another.

    Ranges are boxes and ramps are convex combinations: a ramp with a valid start in the new gait is valid throughout.
    A command with the same range in both gaits needs no check: the segment before has kept it within that range.
    """
    start = before.command()
    ranges, allowed = (command_ranges(segment.gait, segment.robot) for segment in (after, before))
    for name in COMMAND_NAMES:
        low, high = ranges[name].finishing
        value = getattr(start, name)
        if ranges[name] != allowed[name] and not low <= value <= high:
            unit = COMMAND_UNITS[name]
            raise CommandError(
                f"segment '{after.label}' ({after.gait.label}) starts from {name} = {value:g} {unit} of segment "
                f"'{before.label}', but {after.gait.label} allows {low:g} to {high:g} {unit}; "
                f"put a {before.gait.label} segment between them that brings {name} into that range",
                at=at,
            )
    if before.hands is not None and after.hands is not None and before.hands.frame != after.hands.frame:
        raise TargetError(
            f"segment '{after.label}' changes the hand frame from {before.hands.frame} to {after.hands.frame}; "
            "put a segment without hands between them",
            at=at,
        )


def while_walking(script: Script, v_x: float) -> Script:
    """Return the script with a walk added: where the robot stands or walks on the spot, it walks ahead instead.

    Args:
        script: the script; its hands, heights, pitches and waist angles stay.
        v_x: forward velocity of these segments [m/s].
    """
    segments = []
    for segment in script.segments:
        commands = dict(segment.commands)
        walks = segment.gait is Gait.WALKING and not any(commands.get(name) for name in VELOCITY_NAMES)
        if walks or segment.gait is Gait.STANDING:
            commands["v_x"] = v_x
        gait = Gait.WALKING if segment.gait is Gait.STANDING else segment.gait
        segments.append(dataclasses.replace(segment, gait=gait, commands=commands))
    return Script(f"{script.name} while walking", tuple(segments), script.about)


FOLDER = pathlib.Path(__file__).parent
SCRIPT_NAMES = shipped_names(FOLDER)


def load_script(name: str | pathlib.Path, robot: Robot | None = None) -> Script:
    """Load a shipped script, one of `SCRIPT_NAMES`, or a script from a path that ends in .yaml or .yml.

    Args:
        name: the name or the path.
        robot: whose arms the script's motion files move, and whose ranges and defaults its commands have; None for a
            script without such files, and the paper's ranges.
    """
    path = named_path("script", name, FOLDER)
    return load(Script, path, robot, name=path.stem)
