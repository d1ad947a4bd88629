"""What the behaviours of the tasks are made of: gliding hands, waiting, squeezing by the positions of the hands."""

import numpy as np

from hugwbc import rotations
from hugwbc.blends import smooth_step
from hugwbc.commands import Command
from hugwbc.scripts.behaviours import Action, Behaviour, Course, Failure, Grip, View, standing
from hugwbc.targets import HandFrame, HandTargets

SPEED = 0.25  # [m/s], mean speed of a gliding hand
SHORTEST = 0.5  # [s], of a glide
HOOKED = 0.5  # [s], in which an idealised gripper has to take hold


class Moves(Behaviour):
    """A behaviour with pieces to build a course of: `view = yield from self.glide(view, points)`.

    Hands are points in the heading frame, level and at the pelvis, or in the world.

    Attributes:
        doing: what the robot does now, for tables and reasons.
    """

    doing = ""

    @property
    def step(self) -> str:  # noqa: D102
        return self.doing or self.label

    def glide(
        self,
        view: View,
        points: np.ndarray,
        *,
        frame: HandFrame = "heading",
        speed: float = SPEED,
        seconds: float | None = None,
        together: bool = False,
        whole_body: bool = False,
        directions: tuple[np.ndarray | None, np.ndarray | None] = (None, None),
        posture: Command | None = None,
        settle: float = 0.3,
    ) -> Course:
        """Move both hands along straight lines, softly, while the robot stands.

        Args:
            view: now.
            points: where the left and the right hand go [m], shape (2, 3); a row of NaN for an arm that rests.
            frame: "heading" or "world".
            speed: mean speed of the hand with the longer way [m/s].
            seconds: duration instead of a speed [s].
            together: whether the hands hold one object.
            whole_body: whether h, p and w may help.
            directions: along which the forearms should point.
            posture: standing command with h, p and w; None for that of the last tick.
            settle: time afterwards in which the targets stay [s].
        """
        start = hands_in(view, frame)
        start = np.where(np.isfinite(points), start, np.nan)
        length = float(np.nanmax(np.linalg.norm(points - start, axis=1)))
        duration = max(length / speed, SHORTEST) if seconds is None else seconds
        begin, command = view.time, posture or standing(view)
        while True:
            blend = smooth_step((view.time - begin) / duration)
            at = start + blend * (points - start)
            if view.time - begin >= duration + settle:
                return view
            view = yield Action(command, targets(at, frame, together, whole_body, directions))

    def wait(self, view: View, seconds: float) -> Course:
        """Keep hands and posture for a time [s]."""
        begin = view.time
        while view.time - begin < seconds:
            view = yield Action(standing(view), view.last.hands)
        return view

    def grip(self, view: View, *grips: Grip) -> Course:
        """Ask idealised grippers to take hold or to let go, and wait until they have.

        Raises:
            Failure: if one does not take hold.
        """
        begin = view.time
        while view.time - begin < HOOKED:
            rows = [("left", "right").index(grip.side) for grip in grips]
            if view.time > begin and all(view.held[row] == grip.name for row, grip in zip(rows, grips, strict=True)):
                return view
            view = yield Action(standing(view), view.last.hands, grips)
        names = ", ".join(str(grip.name) for grip in grips)
        raise Failure(f"the gripper did not take hold of {names}: out of its reach")


def targets(
    points: np.ndarray,
    frame: HandFrame,
    together: bool = False,
    whole_body: bool = False,
    directions: tuple[np.ndarray | None, np.ndarray | None] = (None, None),
) -> HandTargets:
    """Return hand targets from points, shape (2, 3); a row of NaN is a hand without one."""
    left, right = (None if np.isnan(point).any() else point for point in points)
    return HandTargets(left, right, frame, *directions, together=together, whole_body=whole_body)


def hands_in(view: View, frame: HandFrame) -> np.ndarray:
    """Return where the hands are in a frame [m], shape (2, 3): the last targets, or without them the measured hands."""
    measured = view.hands if frame == "world" else in_heading(view, view.hands)
    last = view.last.hands
    if last is None:
        return measured
    points = last.array()
    if last.frame != frame:
        points = in_heading(view, points) if frame == "heading" else in_world(view, points)
    return np.where(np.isfinite(points), points, measured)


def in_heading(view: View, points: np.ndarray) -> np.ndarray:
    """Return points of the world in the level frame at the pelvis [m], shape (..., 3)."""
    return (points - view.position) @ rotations.rotation_z(view.state.yaw)


def in_world(view: View, points: np.ndarray) -> np.ndarray:
    """Return points of the level frame at the pelvis in the world [m], shape (..., 3)."""
    return view.position + points @ rotations.rotation_z(view.state.yaw).T
