"""Steps of the hands: reach, move on, press, wipe, and use the idealised gripper."""

import dataclasses
from typing import Annotated

import numpy as np
from pydantic import Field

from hugwbc.behaviours.course import (
    Course,
    Failure,
    Hand,
    HandSpeed,
    Hold,
    Name,
    Point,
    Seconds,
    Tolerance,
    doing,
    seen,
    standing,
    step,
    upright,
)
from hugwbc.behaviours.hands import (
    ARRIVED,
    HAND_SPEED,
    Pressing,
    check_frame,
    check_near,
    crouch,
    frame_of,
    glide,
    hands_in,
    last_targets,
    move,
    one_hand,
    sent_orientation,
    sent_point,
    sent_vector,
    targets,
)
from hugwbc.errors import ConfigError
from hugwbc.hand_wrench import STRONGEST
from hugwbc.robot import SIDES
from hugwbc.scripts.view import Action, Grip, View
from hugwbc.targets import HandTargets, Orientation, direction

Depth = Annotated[float, Field(gt=0, le=0.5)]  # [m]
Force = Annotated[float, Field(gt=0, le=STRONGEST)]  # [N]


@step
def reach(
    view: View,
    left: Point | None = None,
    right: Point | None = None,
    *,
    frame: Name = "heading",
    left_direction: Point | None = None,
    right_direction: Point | None = None,
    left_orientation: Orientation | None = None,
    right_orientation: Orientation | None = None,
    together: bool = False,
    whole_body: bool = False,
    speed: HandSpeed = HAND_SPEED,
    tolerance: Tolerance = ARRIVED,
    timeout: Seconds = 10.0,
) -> Course:
    """Bring one hand or both to points of a frame or of an object, which may move meanwhile.

    Args:
        view: now.
        left: target of the left hand [m]; None for a hand that keeps its target, direction and orientation.
        right: of the right hand, likewise.
        frame: "pelvis", "heading", "steady", "world", or the name of an object.
        left_direction: along which the left forearm should point, in that frame.
        right_direction: along which the right one should.
        left_orientation: axes of the left hand in that frame, as a quaternion (w, x, y, z), or "level".
        right_orientation: those of the right hand.
        together: whether both hands hold one object.
        whole_body: whether h, p and w may help.
        speed: highest speed of a hand [m/s].
        tolerance: distance at which a hand has arrived [m].
        timeout: after which it fails [s].
    """
    check_frame(view, frame)
    sent = frame_of(frame)
    checked = HandTargets.of(
        left,
        right,
        sent,
        left_direction=left_direction,
        right_direction=right_direction,
        together=together,
        left_orientation=left_orientation,
        right_orientation=right_orientation,
    )
    stays = last_targets(view, sent)  # what a hand without a point keeps
    turns = {"": sent_point, "_direction": sent_vector, "_orientation": sent_orientation}

    def aim(now: View) -> HandTargets:
        hands: dict[str, np.ndarray | None] = {}
        for side, point in zip(SIDES, (left, right), strict=True):
            for part, turn in turns.items():
                name = side + part
                hands[name] = getattr(stays, name) if point is None else turn(now, frame, getattr(checked, name))
        return HandTargets(**hands, frame=sent, together=together, whole_body=whole_body)  # type: ignore[arg-type]

    check_near(view, aim(view))
    return move(view, aim, speed=speed, tolerance=tolerance)


@step
def press(
    view: View,
    object: Name,
    hand: Hand = "right",
    *,
    at: Point = (0.0, 0.0, 0.0),
    axis: Point = (1.0, 0.0, 0.0),
    travel: Depth | None = None,
    force: Force | None = None,
    depth: Depth = 0.1,
    approach: Depth = 0.08,
    hold: Hold = 0.2,
    speed: HandSpeed = 0.06,
    timeout: Seconds = 25.0,
) -> Course:
    """Press something with the end of a forearm: go before it, push on along an axis, come back; the other arm rests.

    It ends when the object has been seen to give way by `travel`, or has been pressed with `force` where forces on the
    hands are known, or at the end of `depth` if neither is given.

    Args:
        view: now.
        object: its name.
        hand: "left" or "right".
        at: where, in the object's frame [m].
        axis: in which direction, in the object's frame.
        travel: way of the object after which it counts as pressed [m].
        force: on the hand at which it counts as pressed [N].
        depth: how far the target goes beyond the point [m].
        approach: distance before the point from which it goes slowly [m].
        hold: how long it stays pressed [s].
        speed: of the slow way [m/s].
        timeout: after which it fails [s].
    """
    row, thing = SIDES.index(hand), seen(view, object)  # as it is at rest: it moves when it is pressed
    ahead = thing.direction(direction("axis", axis))
    point = thing.position + sum(part * thing.direction(unit) for part, unit in zip(at, np.eye(3), strict=True))
    way = (ahead, None) if row == 0 else (None, ahead)
    posture = crouch(float(point[2]) + 0.05, view.robot)

    def before(gap: float) -> np.ndarray:
        """Return the points of hands whose forearm ends this far before the point."""
        return one_hand(row, point - (view.hand_tip + gap) * ahead)

    check_near(view, targets(before(approach), "world"))
    # From below or from the side the hand would meet the object's edge: first it goes to the line of the push.
    for gap in (2 * approach, approach):
        course = glide(view, before(gap), frame="world", directions=way, posture=posture, settle=0.4)
        view = yield from doing(f"reach for '{object}'", course)
    begin = last = view.time
    start, pressed, held = seen(view, object).position, False, 0.0
    while not pressed or held < hold:
        gone = float((seen(view, object).position - start) @ ahead)
        felt = 0.0 if view.hand_force is None else -float(view.hand_force[row] @ ahead)
        deep = (view.time - begin) * speed - approach
        asked = [value > wanted for value, wanted in ((gone, travel), (felt, force)) if wanted is not None]
        pressed = any(asked) if asked else deep >= depth
        held = held + view.time - last if pressed else 0.0
        last = view.time
        progress = f"'{object}' has given way by {1000 * gone:.0f} mm under {felt:.0f} N"
        if asked and not pressed and deep > depth + 0.5 * speed:
            wanted = [f"{1000 * travel:.0f} mm"] if travel is not None else []
            wanted += [f"{force:.0f} N"] if force is not None else []
            raise Failure(f"{progress} instead of {' or '.join(wanted)}")
        points = one_hand(row, point + (min(deep, depth) - view.hand_tip) * ahead)
        action = Action(standing(view), targets(points, "world", directions=way), progress=progress)
        view = yield action
    away = one_hand(row, point - (view.hand_tip + approach + 0.06) * ahead)
    for posture, back in ((None, 0.15), (upright(view), 0.25)):
        course = glide(view, away, frame="world", directions=way, speed=back, posture=posture)
        view = yield from doing("draw the hand back", course)
    return view


@step
def wipe(view: View, path: np.ndarray, hand: Hand = "right", *, force: Force = 15.0, speed: HandSpeed = 0.08) -> Course:
    """Lead a forearm along a path on a level surface, with a force against it; the other hand stays.

    Args:
        view: now; the hand is at the first point, and presses.
        path: points of the hand on the surface in the world [m], shape (n, 3).
        hand: "left" or "right".
        force: against the surface [N].
        speed: along the path [m/s].
    """
    if path.ndim != 2 or path.shape[1] != 3 or not len(path) or not np.isfinite(path).all():
        raise ConfigError(f"path has shape {path.shape}; give finite points x, y, z, shape (n, 3)")
    row, others, begin = SIDES.index(hand), hands_in(view, "world"), view.time
    free = {f"{hand}_direction": None, f"{hand}_orientation": None}
    stays = dataclasses.replace(last_targets(view, "world"), together=False, whole_body=False, **free)
    along = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))))
    pressing = Pressing(view, row, normal=np.array([0.0, 0.0, 1.0]), force=force)
    while (way := (view.time - begin) * speed) < along[-1] + 0.05:
        point = np.array([np.interp(way, along, path[:, axis]) for axis in range(3)])
        press = one_hand(row, np.array([0.0, 0.0, pressing.asked(view)]), np.zeros((2, 3)))
        left, right = one_hand(row, point, others)
        hands = dataclasses.replace(
            stays, left=left, right=right, wrench=dataclasses.replace(stays.wrench, force=press)
        )
        progress = f"{100 * way:.0f} of {100 * along[-1]:.0f} cm are wiped"
        view = yield Action(standing(view), hands, progress=progress)
    return view


@step
def grip(view: View, *grips: Grip, timeout: Seconds = 0.5) -> Course:
    """Ask idealised grippers to take hold or to let go, and wait until they have.

    Args:
        view: now.
        grips: requests, at most one for a hand, which has to be within 3 cm of the object.
        timeout: after which it fails [s].
    """
    while True:
        open_ = [grip for grip in grips if view.held[SIDES.index(grip.side)] != grip.name]
        progress = "".join(f"the {grip.side} hand is not within 3 cm of '{grip.name}'" for grip in open_[:1])
        view = yield Action(standing(view), view.last.hands, grips, progress=progress)
        if all(view.held[SIDES.index(grip.side)] == grip.name for grip in grips):
            return view
