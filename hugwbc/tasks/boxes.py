"""Handle a box between both hands by friction: grasp, lift, bring to the chest, put down, let go."""

import numpy as np

from hugwbc import rotations
from hugwbc.commands import Command
from hugwbc.scripts.behaviours import Course, Failure, View, WalkTo, seen
from hugwbc.scripts.behaviours.hand_motion import HALF_WIDTH, LEVEL, LOWEST
from hugwbc.scripts.behaviours.view import SeenObject
from hugwbc.targets import HandFrame
from hugwbc.tasks.moves import SPEED, Moves, hands_in, up

BESIDE = 0.07  # [m], between a hand and the box before the grasp
SQUEEZE = 60.0  # [N]: about what shoulder yaw can give; a box of 3 kg slips with less (docs/log/tasks.md)
INTO = 0.01  # [m], how far the targets of squeezing hands are inside the box
DISTANCE = 0.41  # [m], from the pelvis to the middle of a box in front of it
CHEST = np.array([0.36, 0.0, 0.27])  # [m], where a box is carried, in the heading frame
STANDING = 0.98  # [m], height of the pelvis
# Slope with which the forearms point inwards, so that their tips press. Where the rear edges of the box take a share of
# the force, the tips slip, which carry most of the weight.
TOE_IN = 0.3
RISEN = 0.03  # [m], of a box that is lifted
_LET_GO = 0.10  # [m], how far the hands open


class BoxMoves(Moves):
    """Moves with a box whose width is known.

    Attributes:
        width: of the box along its y axis [m].
        at: where on the box the hands press, in its axes from its middle: x and z [m].
        squeeze: force of each hand [N].
        gap: between a hand that holds the box and the box [m]; negative where its target is inside.
    """

    def __init__(
        self, width: float, at: tuple[float, float] = (-0.025, 0.0), squeeze: float = SQUEEZE, gap: float = -INTO
    ) -> None:
        """Take the width [m], where and how hard to press, and the gap of a hand that holds it.

        The tips of the hands, 3 cm ahead of their frames, carry most of a box: it hangs from them, and tilts if they
        are not above its middle.
        """
        self.width, self.at, self.squeeze, self.gap = width, at, squeeze, gap

    def sides(self, gap: float) -> np.ndarray:
        """Return where the hands are beside the box, in its axes, with a gap between hand and box [m], shape (2, 3)."""
        y = self.width / 2 + HALF_WIDTH + gap
        x, z = self.at
        return np.array([[x, y, z], [x, -y, z]])

    def wide(self, view: View, name: str) -> Course:
        """Hold the hands apart and high enough to come near with."""
        height = float(seen(view, name).position[2]) + self.at[1] - 0.98
        points = self.sides(BESIDE + 0.03) * [0.0, 1.0, 0.0] + [0.25, 0.0, max(height, 0.02)]
        return (yield from self.glide(view, points))

    def take(
        self,
        view: View,
        name: str,
        *,
        distance: float = DISTANCE,
        posture: Command | None = None,
        height: float = 0.10,
        speed: float = 0.08,
        goal: np.ndarray = CHEST,
    ) -> Course:
        """Walk to the box, grasp it, lift it, and bring it to the chest.

        Args:
            view: now.
            name: of the box.
            distance: from the pelvis to the middle of the box [m].
            posture: standing command of the grasp; None for one by the height of the box.
            height: by which the box is lifted before it comes to the chest [m].
            speed: of the lift [m/s].
            goal: where it is held, in the heading frame [m], shape (3,).

        Raises:
            Failure: if the box stays where it is.
        """
        self.doing = "walk to the box"
        view = yield from self.wide(view, name)
        view = yield from self.walk(view, WalkTo(before=name, distance=distance))
        view = yield from self.grasp(view, name, posture)
        view = yield from self.raised(view, name, height, speed)
        return (yield from self.to_chest(view, goal))

    def grasp(self, view: View, name: str, posture: Command | None = None) -> Course:
        """Crouch, put the hands beside the box, and squeeze it."""
        self.doing = f"grasp '{name}'"
        box = seen(view, name)
        posture = posture or squat(float(box.position[2]) + self.at[1])
        view = yield from self.beside(view, box, posture, max(self.gap, 0.01))
        points = box.position + self.sides(self.gap) @ rotations.rotation_z(box.yaw).T
        return (yield from self._glide_with_box(view, points, box.yaw, posture, settle=0.7))

    def beside(self, view: View, box: SeenObject, posture: Command, gap: float) -> Course:
        """Put the hands to both sides of the box, in the end with a gap between each hand and the box [m]."""
        ahead = rotations.rotation_z(box.yaw)
        way = inwards(box.yaw)
        for apart, speed in ((BESIDE, 0.2), (gap, 0.1)):
            points = box.position + self.sides(apart) @ ahead.T
            view = yield from self.glide(
                view, points, frame="world", speed=speed, directions=way, posture=posture, settle=0.6
            )
        return view

    def raised(self, view: View, name: str, height: float, speed: float) -> Course:
        """Lift the box straight up by a height [m] at a speed [m/s].

        Raises:
            Failure: if it stays where it is.
        """
        self.doing = f"lift '{name}'"
        last, command = view.last.hands, view.last.command
        before = seen(view, name).position[2]
        assert last is not None
        view = yield from self.glide(
            view,
            hands_in(view, "world") + up(height),
            frame="world",
            speed=speed,
            together=True,
            directions=(last.left_direction, last.right_direction),
            forces=last.forces(),
            posture=Command(h=min(command.h + height, 0.0), p=command.p),
        )
        rise = float(seen(view, name).position[2] - before)
        if rise < RISEN:
            raise Failure(
                f"lift: the box rose by {100 * rise:.1f} of {100 * height:.0f} cm: it slipped out of the hands"
            )
        return view

    def to_chest(self, view: View, goal: np.ndarray) -> Course:
        """Bring the box to the chest and stand upright; from then on it moves with the robot."""
        self.doing = "bring the box to the chest"
        points = self.sides(self.gap) - [self.at[0], 0.0, self.at[1]] + goal
        return (yield from self._glide_with_box(view, points, 0.0, Command(), "heading", speed=0.12, settle=0.5))

    def put(self, view: View, name: str, goal: np.ndarray, yaw: float, above: float = 0.05) -> Course:
        """Put the box down: its middle to a point of the world [m], its heading to a yaw [rad]."""
        self.doing = f"put '{name}' down"
        posture = squat(float(goal[2]) + self.at[1])
        ahead = rotations.rotation_z(yaw)
        for height, speed in ((above, 0.12), (-0.005, 0.05)):
            box = seen(view, name)
            # Where the hands have slipped on the box, they stay so: the box goes to the goal, and not the hands.
            slipped = (hands_in(view, "world").mean(axis=0) - box.position) @ rotations.rotation_z(box.yaw)
            points = goal + up(height) + (self.sides(self.gap) * [0.0, 1.0, 0.0] + slipped) @ ahead.T
            view = yield from self._glide_with_box(view, points, yaw, posture, speed=speed, settle=0.8)
        return view

    def _glide_with_box(
        self,
        view: View,
        points: np.ndarray,
        yaw: float,
        posture: Command,
        frame: HandFrame = "world",
        *,
        speed: float = SPEED,
        settle: float,
    ) -> Course:
        """Glide with the box between the hands, whose forearms follow its heading, a yaw in the frame [rad]."""
        left = rotations.rotation_z(yaw)[:, 1]
        return self.glide(
            view,
            points,
            frame=frame,
            speed=speed,
            together=True,
            directions=inwards(yaw),
            forces=self.squeeze * np.array([-left, left]),
            posture=posture,
            settle=settle,
        )

    def let_go(self, view: View) -> Course:
        """Open the hands sideways, and raise them."""
        self.doing = "let go"
        points = hands_in(view, "heading")
        view = yield from self.glide(view, points, speed=0.1, settle=0.2)
        out = np.array([[0.0, _LET_GO, 0.0], [0.0, -_LET_GO, 0.0]])
        view = yield from self.glide(view, points + out, speed=0.1, settle=0.2)
        return (yield from self.glide(view, points + out + up(0.05) - [0.08, 0.0, 0.0], posture=Command()))


def squat(height: float) -> Command:
    """Return the standing command with which the forearms are level while the hands are at a height [m]."""
    return Command(h=float(np.clip(height - LEVEL, LOWEST, 0.0)))


def inwards(yaw: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the directions of both forearms at a box with a heading [rad]."""
    ahead, left = rotations.rotation_z(yaw).T[:2]
    return ahead - TOE_IN * left, ahead + TOE_IN * left


def carried_at(height: float) -> np.ndarray:
    """Return where the hands carry a box, in the heading frame [m]: with level forearms, or higher if they must.

    Args:
        height: over the ground that they need [m].
    """
    return CHEST * [1.0, 1.0, 0.0] + up(float(np.clip(height, LEVEL, STANDING + CHEST[2])) - STANDING)
