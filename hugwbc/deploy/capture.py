"""Topics of motion capture and idealised grippers, as text, in addition to the maker's.

Both are JSON in the type `std_msgs/String`, which ROS 2 reads as well. Poses are position [m] and quaternion
(w, x, y, z) in the world. `tick` is the robot's clock, as in its state message.

    rt/hugwbc/objects   {"tick": 1234, "robot": [7 numbers], "objects": {"parcel": [7 numbers]}, "held": [null, "tray"]}
    rt/hugwbc/grips     {"grips": [{"side": "left", "name": "tray", "hook": false, "breaking_force": 150.0}]}

`held` is what the left and the right hand hold. A grip whose name is null lets go.
"""

import dataclasses
import json
import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from hugwbc.deploy.messages import TICK
from hugwbc.errors import CaptureError
from hugwbc.hand_wrench import BREAKING_FORCE
from hugwbc.robot import SIDES
from hugwbc.scripts.view import Grip
from hugwbc.sim.scenes.objects import Picture
from hugwbc.streams import read_object

OBJECTS, GRIPS = "rt/hugwbc/objects", "rt/hugwbc/grips"
LONGEST = 32768  # characters of a text
STRONGEST = 1e4  # [N]
FARTHEST = 100.0  # [m]; the height of a pelvis in millimetres is beyond it
_RESTART = 1.0  # [s]; a capture that is older than the last one by so much is of a restarted robot
_POSE = 7
_MOST = 100  # objects in a text


@dataclasses.dataclass(frozen=True, eq=False)
class Capture:
    """One frame of motion capture, with the objects in the hands."""

    time: float  # when it was taken, on the robot's clock [s]
    robot: np.ndarray  # position [m] and quaternion (w, x, y, z) of the pelvis, shape (7,)
    names: tuple[str, ...]  # names of the objects
    poses: np.ndarray  # position [m] and quaternion (w, x, y, z) of each object, shape (n, 7)
    held: tuple[str | None, str | None]  # names of what the left and the right hand hold; None for nothing

    def text(self) -> str:
        """Return the frame as text."""
        objects = {name: pose.tolist() for name, pose in zip(self.names, self.poses, strict=True)}
        content = {"tick": round(self.time / TICK), "robot": self.robot.tolist(), "objects": objects, "held": self.held}
        return json.dumps(content)

    @classmethod
    def of(cls, text: str) -> "Capture":
        """Read a text; one of another form raises a `CaptureError`."""
        content = _content(text, {"tick", "robot", "objects", "held"})
        objects, held, tick = content["objects"], content["held"], content["tick"]
        if type(tick) is not int or not 0 <= tick < 2**53:
            raise CaptureError(f"'tick' is {tick!r:.40}; give the robot's clock in milliseconds")
        if not isinstance(objects, dict) or not all(map(_is_name, objects)):
            raise CaptureError("'objects' is not a mapping of printable names to poses")
        if not isinstance(held, list) or len(held) != len(SIDES) or not all(_is_name(name) for name in held):
            raise CaptureError("'held' is not two printable names, each of an object or null")
        if len(objects) > _MOST:
            raise CaptureError(f"there are {len(objects)} objects; at most {_MOST} are followed")
        poses = np.array([_pose(name, pose) for name, pose in objects.items()]).reshape(-1, _POSE)
        return cls(tick * TICK, _pose("robot", content["robot"]), tuple(objects), poses, (held[0], held[1]))


class CapturedWorld:
    """View of robot, objects and grippers for a behaviour, from the last capture."""

    def __init__(self, tell: Callable[[str], None] = lambda problem: None) -> None:
        """Begin without a capture; what goes wrong with the captures is told."""
        self._tell = tell
        self.grips: tuple[Grip, ...] = ()  # last gripper requests, to be published
        self._last: Capture | None = None
        self._now = 0.0

    def take(self, capture: Capture) -> None:
        """Take a capture; drop one that is late, that is, older than the last one by less than `_RESTART`."""
        if self._last is None or not 0.0 < self._last.time - capture.time < _RESTART:
            self._last = capture

    def advance(self, now: float) -> None:
        """Note the time on the robot's clock [s]."""
        self._now = now

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the objects."""
        return () if self._last is None else self._last.names

    def picture(self) -> Picture | None:
        """Return the last picture; None before the first."""
        if self._last is None:
            return None
        return Picture(self._last.time, max(self._now - self._last.time, 0.0), self._last.poses, self._last.robot)

    def held(self, side: str) -> str | None:
        """Return what a hand holds; None for nothing."""
        return None if self._last is None else self._last.held[SIDES.index(side)]

    def grip(self, grips: tuple[Grip, ...]) -> None:
        """Note the gripper requests."""
        self.grips = grips

    def note(self, problem: str) -> None:
        """Tell what has gone wrong."""
        self._tell(problem)


def text_of_grips(grips: Iterable[Grip]) -> str:
    """Return the text that asks for grips."""
    return json.dumps({"grips": [dataclasses.asdict(grip) for grip in grips]})


def grips_of(text: str) -> tuple[Grip, ...]:
    """Read the grips that a text asks for; one of another form raises a `CaptureError`."""
    grips = _content(text, {"grips"})["grips"]
    if not isinstance(grips, list):
        raise CaptureError("'grips' is not a list")
    return tuple(_grip(grip) for grip in grips)


def _grip(content: object) -> Grip:
    known = {field.name for field in dataclasses.fields(Grip)}
    if not isinstance(content, dict) or set(content) - known or not {"side", "name"} <= set(content):
        raise CaptureError("a grip is a mapping with side and name and, as wanted, hook and breaking_force")
    hook, force = content.get("hook", False), content.get("breaking_force", BREAKING_FORCE)
    if content["side"] not in SIDES or not _is_name(content["name"]) or type(hook) is not bool:
        raise CaptureError(
            "a grip has a side (left or right), a name (a printable text or null) and a hook (true or false)"
        )
    if type(force) not in (int, float) or not 0.0 < force < STRONGEST:
        raise CaptureError(f"the breaking force of a grip is {force!r:.40}; give one above 0 and below {STRONGEST:g} N")
    return Grip(content["side"], content["name"], hook, float(force))


def _content(text: str, keys: set[str]) -> dict[str, Any]:
    try:
        content = read_object(text, LONGEST)
    except ValueError as error:
        raise CaptureError(f"the text is refused: {error}") from error
    if set(content) != keys:
        raise CaptureError(f"the text is not a mapping with {', '.join(sorted(keys))}")
    return content


def _pose(name: str, content: object) -> np.ndarray:
    numbers = content if isinstance(content, list) and len(content) == _POSE else [math.nan]
    right = all(type(x) in (int, float) and abs(x) < FARTHEST for x in numbers)  # a NaN is not below it
    pose = np.array(numbers, dtype=float) if right else np.zeros(_POSE)
    length = float(np.linalg.norm(pose[3:]))
    if not abs(length - 1.0) < 0.01:
        raise CaptureError(f"the pose of '{name}' is not a position within {FARTHEST:g} m and a unit quaternion")
    pose[3:] /= length
    return pose


def _is_name(value: object) -> bool:
    return value is None or (isinstance(value, str) and value.isprintable())
