"""Sources of commands and hand targets for a control loop; what seeing sources know and ask for at a tick."""

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Protocol, runtime_checkable

import numpy as np

from hugwbc import rotations
from hugwbc.commands import Command
from hugwbc.errors import UnknownNameError, UnknownObjectError
from hugwbc.hand_wrench import BREAKING_FORCE
from hugwbc.robot import SIDES, Robot
from hugwbc.state import RobotState
from hugwbc.targets import HandTargets


@dataclasses.dataclass(frozen=True, eq=False)
class SeenObject:
    """The pose of an object as the motion capture gives it.

    Attributes:
        position: of the object's origin in the world [m], shape (3,).
        orientation: object to world, unit quaternion (w, x, y, z), shape (4,).
        age: how old the newest picture of it is [s].
    """

    position: np.ndarray
    orientation: np.ndarray
    age: float = 0.0

    @property
    def yaw(self) -> float:
        """Its heading [rad]."""
        return float(rotations.yaw_of(self.orientation))

    def point(self, point: np.ndarray) -> np.ndarray:
        """Return a point of the object's frame in the world [m], shape (3,)."""
        return self.position + rotations.rotate(self.orientation, np.asarray(point, dtype=float))

    def direction(self, vector: np.ndarray) -> np.ndarray:
        """Return a vector of the object's frame in world axes, shape (3,)."""
        return rotations.rotate(self.orientation, np.asarray(vector, dtype=float))


class SeenObjects(Mapping[str, SeenObject]):
    """The objects of one picture, by name."""

    def __init__(self, names: tuple[str, ...] = (), poses: np.ndarray | None = None, age: float = 0.0) -> None:
        """Keep a picture: positions [m] and quaternions (w, x, y, z), shape (objects, 7), and its age [s]."""
        self._names, self._age = names, age
        self._poses = np.zeros((0, 7)) if poses is None else poses

    def __getitem__(self, name: str) -> SeenObject:
        if name not in self._names:
            raise UnknownObjectError("object", name, self._names)
        row = self._poses[self._names.index(name)]
        return SeenObject(row[:3], row[3:], self._age)

    def __contains__(self, name: object) -> bool:
        return name in self._names

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


@dataclasses.dataclass(frozen=True)
class Grip:
    """A request to the idealised gripper of one hand (`attach` in `Task.idealised`); no hand of an H1 grips like this.

    Attributes:
        side: "left" or "right".
        name: the object to hold; None lets go.
        hook: whether the hand may turn about its origin, as if it hung on a handle; otherwise it is welded on.
        breaking_force: force at which the grip breaks [N].
    """

    side: str
    name: str | None
    hook: bool = False
    breaking_force: float = BREAKING_FORCE

    def __post_init__(self) -> None:
        if self.side not in SIDES:
            raise UnknownNameError("hand", self.side, SIDES)


@dataclasses.dataclass(frozen=True, eq=False)
class Action:
    """What a behaviour asks for at a tick.

    Attributes:
        command: to the controller.
        hands: targets of the hands; None leaves the arms to the controller. Those in the world frame are in that of
            `View.state`.
        grips: requests to the idealised gripper, carried out once.
        doing: what the robot is doing, in words, for tables and the labels of recordings.
        progress: what is awaited, how far it is, and the tolerance; it becomes the reason of a timeout.
    """

    command: Command = dataclasses.field(default_factory=Command)
    hands: HandTargets | None = None
    grips: tuple[Grip, ...] = ()
    doing: str = ""
    progress: str = ""


@dataclasses.dataclass(frozen=True, eq=False)
class View:
    """What a behaviour knows at a tick: estimates and observations, never the simulator's truth.

    Attributes:
        time: since the start of the run [s].
        state: the estimate. Where a motion capture sees the robot, position and heading are corrected by it, so that
            robot and objects are in one world.
        hands: positions of the left and the right hand in that world, from the joints [m], shape (2, 3).
        objects: the objects that are seen, by name.
        hand_force: force on each hand from outside, world frame [N], shape (2, 3); None where nothing tells.
        held: names of the objects that the left and the right idealised gripper hold; None for an open one.
        last: the request of the last tick.
        stop: by how much a stop moves the robot, heading frame [m, m, rad], shape (3,); zeros if it is not known.
        lag: commanded minus walked velocity, as the walks of the run have shown it, heading frame [m/s, m/s, rad/s],
            shape (3,); added to a command, it makes the robot walk as wanted.
        stuck: whether something holds the robot, which has not moved for 3 s although it is told to walk.
        mid_stance: whether the robot is in the moment of its stride in which it should be told to stand
            (`hugwbc.stride`).
        robot: whose ranges and defaults commands have; None for the paper's.
        hand_tip: distance from the hand frames to the ends of the hands [m]; an H1's by default.
        hand_half_width: distance from the hand frames to the sides of the hands [m]; an H1's by default.
    """

    time: float
    state: RobotState
    hands: np.ndarray
    objects: Mapping[str, SeenObject] = dataclasses.field(default_factory=SeenObjects)
    hand_force: np.ndarray | None = None
    held: tuple[str | None, str | None] = (None, None)
    last: Action = dataclasses.field(default_factory=Action)
    stop: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(3))
    lag: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(3))
    stuck: bool = False
    mid_stance: bool = True
    robot: Robot | None = None
    hand_tip: float = 0.04
    hand_half_width: float = 0.03

    @property
    def position(self) -> np.ndarray:
        """Position of the pelvis in the world [m], shape (3,); zeros if nothing tells it."""
        return np.zeros(3) if self.state.position is None else self.state.position


class CommandSource(Protocol):
    """An object that gives commands and hand targets over time, such as a `Script` or a `Constant`."""

    def command_at(self, t: float) -> Command:
        """Return the command at time t [s]."""
        ...

    def hands_at(self, t: float) -> HandTargets | None:
        """Return the hand targets at time t [s]; None leaves the arms to the controller."""
        ...


@runtime_checkable
class SeeingSource(CommandSource, Protocol):
    """A command source that decides by what is estimated and seen, such as a `BehaviourSource`."""

    def restart(self) -> None:
        """Forget the past before a new run."""
        ...

    def see(self, view: View) -> None:
        """Take the view of this tick, before each `command_at`."""
        ...

    @property
    def grips(self) -> tuple[Grip, ...]:
        """Requests to the idealised gripper, carried out after `see`."""
        ...


@dataclasses.dataclass(frozen=True)
class Constant:
    """The same command and hand targets at all times; without targets the controller moves the arms."""

    command: Command
    hands: HandTargets | None = None

    def command_at(self, t: float) -> Command:
        """Return the command."""
        return self.command

    def hands_at(self, t: float) -> HandTargets | None:
        """Return the hand targets."""
        return self.hands
