"""Take a box of known width between both hands, lift it, bring it to the chest, put it down, let go.

`hold.squeeze` finds the width of an object by touch; here the hands go where the box must be.
"""

import dataclasses
import math

import numpy as np

from hugwbc import rotations
from hugwbc.behaviours.course import Course, Failure, Name, doing, kept, seen, upright
from hugwbc.behaviours.hands import LEVEL, Directions, glide, hands_in, squat, stature
from hugwbc.behaviours.hold import TOE_IN, from_hands
from hugwbc.behaviours.reach import grip
from hugwbc.behaviours.walk import walk_to
from hugwbc.commands import Command
from hugwbc.robot import SIDES
from hugwbc.scripts.view import Action, Grip, SeenObject, View
from hugwbc.settings import NotNegative, Positive, settings
from hugwbc.targets import HandFrame

DISTANCE = 0.41  # [m], from the pelvis to the middle of a box in front of it
CHEST = np.array([0.36, 0.0, 0.27])  # [m], where a box is carried, in the heading frame
_BESIDE = 0.07  # [m], between a hand and the box before the grasp
_STANDING = 0.98  # [m], height of an H1's pelvis
_RISEN = 0.03  # [m], of a box that is lifted
_LOST = 0.25  # [m], from the middle of a box to the middle of the hands that have lost it
_HUNG = 0.015  # [m], between a hand and the box that hangs from it
_STRONG = 300.0  # [N], of a hook: both hold one rigid box, and press on each other
_SHORT, _NEARER = 0.08, 0.12  # [m], by which the hands may be short of the box, and the robot come nearer for it
_RESTS, _SLOWEST_RISE = 0.5, 4.0  # [s], rest of the pelvis before a walk, and time after which the robot walks anyway
_MOVES = 0.01  # [m], largest motion of a pelvis at rest in that time
_LET_GO = 0.10  # [m], how far the hands open


@settings
class BoxGrip:
    """How two hands hold a box.

    The tips of the hands, ahead of their frames (`Robot.hand_tip`), carry most of a box: it hangs from them, and tilts
    if they are not above its middle.

    Defaults and tolerances are lengths and forces of an H1. Tasks that are made for an H1 fit them to other robots;
    elsewhere, also in a task whose scene names another robot, use `hugwbc.behaviours.similar.similar`.

    Attributes:
        width: of the box along its y axis [m].
        at: where on the box the hands press, in its axes from its middle: x and z [m].
        force: of each hand [N]; 60 N is about what shoulder yaw can give, and a box of 3 kg slips with less
            (docs/log/tasks.md).
        gap: between a hand that holds the box and the box [m]; negative where its target is inside.
        hooks: whether the box hangs from the idealised grippers.
    """

    width: Positive
    at: tuple[float, float] = (-0.025, 0.0)
    force: NotNegative = 60.0
    gap: float = -0.01
    hooks: bool = False

    @classmethod
    def hung(cls, width: float, at: tuple[float, float]) -> "BoxGrip":
        """Return how a box hangs from the idealised grippers: a hand that touched it would press on its own hook."""
        return cls(width, at=at, force=0.0, gap=_HUNG, hooks=True)

    def take(
        self,
        view: View,
        name: Name,
        *,
        distance: float = DISTANCE,
        posture: Command | None = None,
        height: float = 0.10,
        speed: float = 0.08,
        goal: np.ndarray = CHEST,
    ) -> Course:
        """Walk to the box, grasp it, lift it, and bring it to the chest.

        A robot moves back as it crouches. If its hands then end far from the box, it stands up and comes nearer;
        otherwise it stays, since the knees of a walking robot knock at what the box stands on.

        Args:
            view: now.
            name: of the box.
            distance: from the pelvis to the middle of the box [m].
            posture: standing command of the grasp; None for one that suits the height of the box.
            height: by which the box is lifted before it comes to the chest [m].
            speed: of the lift [m/s].
            goal: where it is held, in the heading frame [m], shape (3,). The box leans with the forearms: an H1's are
                level, and so is the box, at a height of 0.17 m; higher, it may land on its side when it is put down.
        """
        posture = posture or squat(float(seen(view, name).position[2]) + self.at[1], view.robot)
        nearest = distance - _NEARER
        while True:
            view = yield from doing("walk to the box", self._spread(view, name))
            view = yield from doing("walk to the box", walk_to(view, before=name, distance=distance))
            view = yield from doing(f"reach for '{name}'", self._reach(view, name, posture))
            short = self._short(view, name)
            if short < _SHORT or distance <= nearest:
                break
            distance = max(distance - short, nearest)
        view = yield from doing(f"grasp '{name}'", self.grasp(view, name, posture))
        view = yield from doing(f"lift '{name}'", self.lift(view, name, height, speed))
        return (yield from doing("bring the box to the chest", self.bring(view, name, goal)))

    def grasp(self, view: View, name: Name, posture: Command) -> Course:
        """Squeeze the box between the hands, which are beside it."""
        box = seen(view, name)
        view = yield from self._reach(view, name, posture, max(self.gap, 0.01), speed=0.1)
        view = yield from self._glide(view, self._on(view, box, self.gap), box.yaw, posture, settle=0.7)
        if self.hooks:
            view = yield from grip(view, *(Grip(side, name, hook=True, breaking_force=_STRONG) for side in SIDES))
        return view

    def lift(self, view: View, name: Name, height: float, speed: float) -> Course:
        """Lift the box straight up by a height [m] at a speed [m/s]; fail if it does not rise."""
        last, command = view.last.hands, view.last.command
        before = seen(view, name).position[2]
        assert last is not None
        points = hands_in(view, "world")
        points[:, 2] = np.maximum(points[:, 2], view.hands[:, 2])  # a low box may be held above its targets
        view = yield from glide(
            view,
            points + up(height),
            frame="world",
            speed=speed,
            together=True,
            directions=(last.left_direction, last.right_direction),
            forces=last.wrench.force,
            posture=dataclasses.replace(upright(view), h=min(command.h + height, 0.0), p=command.p),
        )
        rise = float(seen(view, name).position[2] - before)
        if rise < _RISEN:
            raise Failure(
                f"lift: the box rose by {100 * rise:.1f} of {100 * height:.0f} cm: it slipped out of the hands"
            )
        return view

    def bring(self, view: View, name: Name, goal: np.ndarray) -> Course:
        """Bring the box to a point of the heading frame [m] and stand upright; from then on it moves with the robot."""
        points = self._sides(view, self.gap) - [self.at[0], 0.0, self.at[1]] + goal
        view = yield from self._glide(view, points, 0.0, upright(view), "heading", speed=0.12, settle=0.0)
        view = yield from _come_up(view)
        _check_held(view, name)
        return view

    def put(self, view: View, name: Name, goal: np.ndarray, yaw: float, posture: Command | None = None) -> Course:
        """Put the box down: its middle to a point of the world [m], its heading to a yaw [rad]."""
        posture = posture or squat(float(goal[2]) + self.at[1], view.robot)
        ahead = rotations.rotation_z(yaw)
        _check_held(view, name)
        for height, speed in ((0.05, 0.12), (-0.005, 0.05)):
            box = seen(view, name)
            # Hands that have slipped on the box stay there relative to it: the box goes to the goal, not the hands.
            slipped = (hands_in(view, "world").mean(axis=0) - box.position) @ rotations.rotation_z(box.yaw)
            points = goal + up(height) + (self._sides(view, self.gap) * [0.0, 1.0, 0.0] + slipped) @ ahead.T
            view = yield from self._glide(view, points, yaw, posture, speed=speed, settle=0.8)
        return view

    def let_go(self, view: View) -> Course:
        """Open the hands sideways, then draw them back and up while the robot stands up."""
        if self.hooks:
            view = yield from grip(view, *(Grip(side, None) for side in SIDES))
        points = hands_in(view, "heading")
        view = yield from glide(view, points, speed=0.1, settle=0.2)
        out = np.array([[0.0, _LET_GO, 0.0], [0.0, -_LET_GO, 0.0]])
        view = yield from glide(view, points + out, speed=0.1, settle=0.2)
        return (yield from glide(view, points + out + up(0.05) - [0.08, 0.0, 0.0], posture=upright(view)))

    def _sides(self, view: View, gap: float) -> np.ndarray:
        """Return where the hands are beside the box, in its axes, with a gap between hand and box [m], shape (2, 3)."""
        y = self.width / 2 + view.hand_half_width + gap
        x, z = self.at
        return np.array([[x, y, z], [x, -y, z]])

    def _on(self, view: View, box: SeenObject, gap: float) -> np.ndarray:
        """Return where the hands are beside the box, in the world [m], shape (2, 3)."""
        return box.position + self._sides(view, gap) @ rotations.rotation_z(box.yaw).T

    def _spread(self, view: View, name: str) -> Course:
        """Stand upright, and hold the hands apart and high enough to walk up to the box."""
        height = float(seen(view, name).position[2]) + self.at[1] - _STANDING * stature(view.robot)
        points = self._sides(view, _BESIDE + 0.03) * [0.0, 1.0, 0.0] + [0.25, 0.0, max(height, 0.02)]
        return glide(view, points, posture=upright(view))

    def _reach(self, view: View, name: str, posture: Command, gap: float = _BESIDE, *, speed: float = 0.2) -> Course:
        """Crouch, and put the hands beside the box, with a gap between hand and box [m]."""
        box = seen(view, name)
        points, way = self._on(view, box, gap), _inwards(box.yaw)
        return glide(view, points, frame="world", speed=speed, directions=way, posture=posture, settle=0.6)

    def _short(self, view: View, name: str) -> float:
        """Return how far the hands are behind and above their points beside the box [m]."""
        box = seen(view, name)
        left = (self._on(view, box, _BESIDE) - view.hands).mean(axis=0) @ rotations.rotation_z(box.yaw)
        return math.hypot(max(left[0], 0.0), min(left[2], 0.0))

    def _glide(
        self,
        view: View,
        points: np.ndarray,
        yaw: float,
        posture: Command,
        frame: HandFrame = "world",
        *,
        speed: float = 0.25,
        settle: float,
    ) -> Course:
        """Glide with the box between the hands, whose forearms follow its heading, a yaw in the frame [rad]."""
        left = rotations.rotation_z(yaw)[:, 1]
        return glide(
            view,
            points,
            frame=frame,
            speed=speed,
            together=True,
            directions=_inwards(yaw),
            forces=self.force * np.array([left, -left]),
            posture=posture,
            settle=settle,
        )


def _come_up(view: View) -> Course:
    """Wait until the pelvis rests: a loaded robot may rise later than it is told, and must be up before it walks."""
    begin = since = view.time
    height = view.position[2]
    while view.time - since < _RESTS and view.time - begin < _SLOWEST_RISE:
        view = yield Action(view.last.command, kept(view))
        if abs(view.position[2] - height) > _MOVES:
            since, height = view.time, view.position[2]
    return view


def _check_held(view: View, name: str) -> None:
    """Fail if the hands have lost the box."""
    away = float(np.linalg.norm(from_hands(view, name)))
    if away > _LOST:
        raise Failure(f"'{name}' is {100 * away:.0f} cm from the hands: it slipped out of them")


def up(height: float) -> np.ndarray:
    """Return a vector of a length upwards [m]."""
    return np.array([0.0, 0.0, height])


def carried_at(height: float) -> np.ndarray:
    """Return where the hands carry a box, in the heading frame [m]: with level forearms, or higher if they must.

    Args:
        height: least height of the hands above the ground [m].
    """
    return CHEST * [1.0, 1.0, 0.0] + up(float(np.clip(height, LEVEL, _STANDING + CHEST[2])) - _STANDING)


def _inwards(yaw: float) -> Directions:
    """Return the directions of both forearms at a box with a heading [rad]."""
    ahead, left = rotations.rotation_z(yaw).T[:2]
    return ahead - TOE_IN * left, ahead + TOE_IN * left
