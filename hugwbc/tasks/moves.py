"""Building blocks of the tasks' behaviours: gliding hands, holding a load, waiting, gripping."""

import numpy as np

from hugwbc.blends import smooth_step
from hugwbc.commands import Command
from hugwbc.robot import SIDES
from hugwbc.scripts.behaviours import Action, Behaviour, Course, Failure, Grip, View, run, standing
from hugwbc.scripts.behaviours.hand_motion import LOWEST, in_frame, points_in, wait
from hugwbc.targets import HandFrame, HandTargets

SPEED = 0.25  # [m/s], mean speed of a gliding hand
SHORTEST = 0.5  # [s], of a glide
HOOKED = 0.5  # [s], in which an idealised gripper has to take hold
LOAD_GAIN = 1.0  # [1/s], at which targets move against the sag of hands that carry a load
LARGEST_SAG = 0.15  # [m]
COMFORTABLE = 1.05  # [m], height at which hands work while the robot stands upright
NO_FORCE = np.zeros((2, 3))
NO_HAND = np.full(3, np.nan)
Directions = tuple[np.ndarray | None, np.ndarray | None]


class Moves(Behaviour):
    """A behaviour with building blocks for a course: `view = yield from self.glide(view, points)`.

    Hands are points in the heading frame, level and at the pelvis, or in the world.

    Attributes:
        doing: what the robot does now, for tables and reasons.
    """

    doing = ""

    @property
    def step(self) -> str:  # noqa: D102
        return self.doing or self.label

    def walk(self, view: View, walk: Behaviour) -> Course:
        """Walk; the hands stay where they are in the heading frame."""
        return run(walk, view)

    def glide(
        self,
        view: View,
        points: np.ndarray,
        *,
        frame: HandFrame = "heading",
        speed: float = SPEED,
        together: bool = False,
        directions: Directions = (None, None),
        forces: np.ndarray = NO_FORCE,
        stiffness: float | None = None,
        posture: Command | None = None,
        settle: float = 0.3,
    ) -> Course:
        """Move both hands along straight lines, softly, while the robot stands; forces change as softly.

        Args:
            view: now.
            points: where the left and the right hand go [m], shape (2, 3); a row of NaN for an arm that rests.
            frame: "heading" or "world".
            speed: mean speed of the hand with the longer way [m/s].
            together: whether the hands hold one object.
            directions: along which the forearms should point.
            forces: of the hands on what they touch, at the end [N], shape (2, 3).
            stiffness: of the hands [N/m]; None for that of the servo.
            posture: standing command with h, p and w; None for that of the last tick.
            settle: time afterwards in which the targets stay [s].
        """
        last = view.last.hands
        start, before = hands_in(view, frame), NO_FORCE if last is None else in_frame(view, last, frame).forces()
        start = np.where(np.isfinite(points), start, np.nan)
        length = float(np.nanmax(np.linalg.norm(points - start, axis=1), initial=0.0))
        duration = max(length / speed, SHORTEST)
        begin, command = view.time, posture or standing(view)
        while view.time - begin < duration + settle:
            blend = smooth_step((view.time - begin) / duration)
            at, force = start + blend * (points - start), before + blend * (forces - before)
            view = yield Action(command, targets(at, frame, together, directions, force, stiffness))
        return view

    def carry(self, view: View, goal: np.ndarray, seconds: float, directions: Directions = (None, None)) -> Course:
        """Hold loaded hands at points of the world for a time [s]: the targets move against the sag of the arms."""
        begin = last = view.time
        shift = np.zeros((2, 3))
        while view.time - begin < seconds:
            shift += LOAD_GAIN * (view.time - last) * (goal - view.hands)
            shift = np.clip(shift, -LARGEST_SAG, LARGEST_SAG)
            last = view.time
            view = yield Action(standing(view), targets(goal + shift, "world", directions=directions))
        return view

    def wait(self, view: View, seconds: float) -> Course:
        """Keep hands and posture for a time [s]."""
        return wait(view, seconds)

    def grip(self, view: View, *grips: Grip) -> Course:
        """Ask idealised grippers to take hold or to let go, and wait until they have.

        Raises:
            Failure: if one does not take hold.
        """
        begin = view.time
        rows = [SIDES.index(grip.side) for grip in grips]
        while view.time - begin < HOOKED:
            view = yield Action(standing(view), view.last.hands, grips)
            if all(view.held[row] == grip.name for row, grip in zip(rows, grips, strict=True)):
                return view
        names = ", ".join(str(grip.name) for grip in grips)
        raise Failure(f"{self.doing}: the gripper did not take hold of {names}: out of its reach")


def targets(
    points: np.ndarray,
    frame: HandFrame,
    together: bool = False,
    directions: Directions = (None, None),
    forces: np.ndarray = NO_FORCE,
    stiffness: float | None = None,
) -> HandTargets:
    """Return hand targets from points and forces, shapes (2, 3); a row of NaN is a hand without one."""
    left, right = (None if np.isnan(point).any() else point for point in points)
    pressing = [
        force if point is not None and force.any() else None for point, force in zip((left, right), forces, strict=True)
    ]
    return HandTargets(
        left,
        right,
        frame,
        *directions,
        together=together,
        left_force=pressing[0],
        right_force=pressing[1],
        stiffness=stiffness,
    )


def hands_in(view: View, frame: HandFrame) -> np.ndarray:
    """Return where the hands are in a frame [m], shape (2, 3): the last targets, or without them the measured hands."""
    measured, last = points_in(view, view.hands, frame), view.last.hands
    if last is None:
        return measured
    points = in_frame(view, last, frame).array()
    return np.where(np.isfinite(points), points, measured)


def up(height: float) -> np.ndarray:
    """Return a vector of a length upwards [m]."""
    return np.array([0.0, 0.0, height])


def crouch(height: float) -> Command:
    """Return the standing command with which hands work comfortably at a height [m]: lower and leaning for low ones."""
    h = float(np.clip(height - COMFORTABLE, LOWEST, 0.0))
    return Command(h=h, p=float(np.clip(-h, 0.0, 0.25)))
