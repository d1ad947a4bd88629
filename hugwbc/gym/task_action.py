"""Actions of the task environments: numbers from -1 to 1, and their meaning for robot and hands."""

import dataclasses

import numpy as np

from hugwbc.behaviours.hands import points_in, points_of
from hugwbc.commands import VELOCITY_NAMES, Command, command_ranges, default_command
from hugwbc.gait import Gait
from hugwbc.robot import SIDES, Robot
from hugwbc.scripts.view import Action, View
from hugwbc.tasks.demonstration import ACTION_NAMES


@dataclasses.dataclass(frozen=True)
class Entry:
    """One number of an action."""

    name: str  # what it is
    # low and high: the values that -1 and 1 stand for; a switch has none and is on above 0
    low: float = 0.0
    high: float = 0.0
    unit: str = ""  # of these values; empty for a switch

    @property
    def is_switch(self) -> bool:
        """Whether it is on above 0, and off otherwise."""
        return not self.unit


def _hand(side: str) -> tuple[Entry, ...]:
    """Return the entries of one hand; the box of its targets is mirrored for the right one."""
    low, high = (-0.2, 0.6) if side == "left" else (-0.6, 0.2)
    return (
        Entry(f"{side}_hand"),
        Entry(f"{side}_x", 0.0, 0.7, "m"),
        Entry(f"{side}_y", low, high, "m"),
        Entry(f"{side}_z", -0.5, 0.6, "m"),
    )


_BODY = (
    Entry("walk"),
    Entry("v_x", -0.6, 0.6, "m/s"),
    Entry("v_y", -0.3, 0.3, "m/s"),
    Entry("omega", -0.6, 0.6, "rad/s"),
    Entry("h", -0.3, 0.0, "m"),
    Entry("p", 0.0, 0.4, "rad"),
    Entry("w", -1.0, 1.0, "rad"),
)


def _within(entry: Entry, low: float, high: float) -> Entry:
    """Return the entry within low and high; what is symmetric about 0 stays so where both signs are allowed."""
    if entry.low == -entry.high and low < 0.0 < high:
        high = min(-low, high)
        low = -high
    low, high = np.clip((entry.low, entry.high), low, high).tolist()
    return dataclasses.replace(entry, low=low, high=high)


GRIPS = {"squeeze": (Entry("squeeze", -60.0, 60.0, "N"),), "attach": tuple(Entry(f"{side}_grip") for side in SIDES)}
"""How a task's hands grip: by a force between both, or by the idealised gripper of each; and the entries for it."""


@dataclasses.dataclass(frozen=True, eq=False)
class Wish:
    """What an action asks for."""

    command: Command = dataclasses.field(default_factory=Command)  # to the controller
    # whether the left and the right hand have targets, shape (2,), bool; the controller moves the arms where neither
    # has one
    used: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(2, dtype=bool))
    # targets of both hands in the heading frame, level and at the pelvis [m], shape (2, 3)
    points: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((2, 3)))
    squeeze: float = 0.0  # force between two used hands [N]
    # whether the left and the right idealised gripper should hold, shape (2,), bool
    grips: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(2, dtype=bool))

    @classmethod
    def of(cls, action: Action, view: View) -> "Wish":
        """Return a behaviour's action as a wish, as far as a learner's actions can express it.

        Args:
            action: of a behaviour that was shown the view; joint targets and directions of the forearms are left out.
            view: what is known now. A gripper keeps its object unless it is told to let go.
        """
        hands = None if action.hands is None or action.hands.joints is not None else action.hands
        grips = np.array([name is not None for name in view.held])
        for grip in action.grips:
            grips[SIDES.index(grip.side)] = grip.name is not None
        if hands is None:
            return cls(action.command, grips=grips)
        points = np.nan_to_num(points_in(view, points_of(view, hands), "heading"))
        force = hands.wrench.force if hands.together else np.zeros((1, 3))
        return cls(action.command, hands.given, points, float(np.linalg.norm(force[0])), grips)


class ActionLayout:
    """The numbers of an action, in order, and both directions between them and a `Wish`.

    The numbers of the command are within the robot's ranges; what a command has besides is at its default.

    Attributes:
        entries: what each number is.
        names: their names.
        rest: the action of a robot that stands with free arms.
    """

    def __init__(self, grip: str | None, robot: Robot) -> None:
        """Set the order for a robot whose hands grip in one of the ways of `GRIPS`, or not at all."""
        self._robot, ranges = robot, command_ranges(Gait.WALKING, robot)
        body = (_within(entry, *ranges[entry.name].finishing) if entry.name in ranges else entry for entry in _BODY)
        self.entries = (*body, *_hand("left"), *_hand("right"), *(GRIPS[grip] if grip else ()))
        self.names = tuple(entry.name for entry in self.entries)
        self._switch = np.array([entry.is_switch for entry in self.entries])
        low, high = np.array([(entry.low, entry.high) for entry in self.entries]).T
        self._middle, self._half = 0.5 * (low + high), np.where(self._switch, 1.0, 0.5 * (high - low))
        self.rest = self.encode(Wish())

    def decode(self, action: np.ndarray) -> Wish:
        """Return the wish of an action of finite numbers from -1 to 1, shape (len(names),)."""
        value = dict(zip(self.names, (self._middle + self._half * action).tolist(), strict=True))
        walks = value["walk"] > 0.0
        numbers = {name: value[name] for name in ("h", "p", "w")}
        if walks:
            numbers |= {name: value[name] for name in VELOCITY_NAMES}
        return Wish(
            command=Command.from_mapping(numbers, Gait.WALKING if walks else Gait.STANDING, self._robot),
            used=np.array([value[f"{side}_hand"] > 0.0 for side in SIDES]),
            points=np.array([[value[f"{side}_{axis}"] for axis in "xyz"] for side in SIDES]),
            squeeze=max(value.get("squeeze", 0.0), 0.0),
            grips=np.array([value.get(f"{side}_grip", -1.0) > 0.0 for side in SIDES]),
        )

    def encode(self, wish: Wish) -> np.ndarray:
        """Return the action of a wish, clipped to the ranges of the actions, shape (len(names),)."""
        command = wish.command
        value = {name: getattr(command, name) for name in (*VELOCITY_NAMES, "h", "p", "w")} | {"squeeze": wish.squeeze}
        on = {"walk": command.gait is not Gait.STANDING}
        for index, side in enumerate(SIDES):
            value |= {f"{side}_{axis}": wish.points[index, k] for k, axis in enumerate("xyz")}
            on |= {f"{side}_hand": wish.used[index], f"{side}_grip": wish.grips[index]}
        numbers = [(1.0 if on[name] else -1.0) if name in on else value[name] for name in self.names]
        half = np.where(self._half > 0.0, self._half, 1.0)  # a robot's range may be a single value
        return np.clip((np.array(numbers) - self._middle) / half, -1.0, 1.0).astype(np.float32)


class RecordedLayout:
    """The numbers of recorded actions, in order and in their units (docs/demonstrations.md).

    Attributes:
        names: their names.
        rest: the action of a robot that stands with free arms.
    """

    def __init__(self, robot: Robot) -> None:
        """Rest in the default command of a robot."""
        self.names, stand = ACTION_NAMES, default_command(Gait.STANDING, robot)
        self.rest = np.array([getattr(stand, name, 0.0) for name in ACTION_NAMES], dtype=np.float32)

    def decode(self, action: np.ndarray) -> np.ndarray:
        """Return an action as a request of its own."""
        return action.copy()
