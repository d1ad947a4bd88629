"""Steps with an object in the hands: take it by friction, lift it, carry it, set it down, let go."""

import dataclasses
import functools
import math
from typing import Annotated

import numpy as np
from pydantic import Field

from hugwbc import rotations
from hugwbc.behaviours.course import (
    Course,
    Failure,
    HandSpeed,
    Hold,
    Name,
    Place,
    Point,
    Seconds,
    seen,
    standing,
    step,
    wait,
)
from hugwbc.behaviours.hands import (
    hands_in,
    held_targets,
    in_frame,
    levelled,
    move,
    points_of,
    shifted,
)
from hugwbc.errors import ConfigError
from hugwbc.hand_wrench import FREE, HandWrench
from hugwbc.robot import SIDES
from hugwbc.scripts.view import Action, Grip, View
from hugwbc.targets import HandTargets

STIFFNESS = 1000.0  # [N/m], about that of a hand in front of the body
TOUCH = 3.0  # [N], a smaller force on a hand may be noise
# Slope with which the forearms point inwards, so that their ends press. Forearms that point outwards take a box by its
# rear edges, and it tips over forwards as soon as it is lifted.
TOE_IN = 0.3
_LAG = 0.012  # [m], distance of a hand from its target at which it has met something
_BESIDE = 0.04  # [m], distance of a hand from its place beside an object that it reaches
_SHORT = 0.02  # [m], by which the hands of arms stretched to both sides of an object stay behind their targets
_ROOM = 0.06  # [m], between hands and object before they close
_SHIFTED = 0.08  # [m], by which an object has moved that does not stand where it was put
_LOST = 0.12  # [m], by which an object has moved in the hands that have lost it

Width = Annotated[float, Field(gt=0, le=1)]  # [m]
Squeezing = Annotated[float, Field(gt=0, le=150)]  # [N]


@step
def squeeze(
    view: View,
    object: Name,
    *,
    force: Squeezing = 60.0,
    width: Width = 0.4,
    at: Point = (0.0, 0.0, 0.03),
    whole_body: bool = False,
    speed: HandSpeed = 0.1,
    timeout: Seconds = 20.0,
) -> Course:
    """Take an object between both hands, which press on it from two sides.

    The hands open before the robot, go to both sides of the object, and close until each of them meets it. Then their
    targets lie inside the object and carry the wanted force.

    Args:
        view: now.
        object: its name.
        force: of each hand [N]; twice the weight or more, or the object slips.
        width: the most that the object may measure between the hands [m].
        at: where the ends of the forearms press, in the object's frame [m]; above its centre of mass it hangs between
            them.
        whole_body: whether h, p and w may help.
        speed: with which the hands close [m/s].
        timeout: after which it fails [s].
    """
    place = functools.partial(_place, name=object, at=at)
    aim = functools.partial(_beside, name=object, at=at, whole_body=whole_body)
    open_half = width / 2 + view.hand_half_width + _ROOM
    middle, ahead, _ = place(view)
    # First up and apart where the hands are, so that they do not meet the object or the table on their way.
    away = min(float((hands_in(view, "world") - middle).mean(axis=0) @ ahead), -0.15)
    spread = aim(view, half=open_half, away=away)
    view = yield from move(view, lambda _: spread, tolerance=0.1, level=True)
    view = yield from move(view, lambda v: aim(v, half=open_half), tolerance=_BESIDE, level=True)
    half, met, time = np.full(2, open_half), np.zeros(2, dtype=bool), view.time
    before: np.ndarray | None = None  # how far the hands were outside their targets before they closed [m]
    while not met.all():
        half = np.where(met, half, half - speed * (view.time - time))
        time = view.time
        hands = aim(view, half=half)
        _, _, aside = place(view)
        away = view.hands - hands.array()
        lag = away @ aside * [1.0, -1.0]
        before = np.where(lag > _LAG, lag, 0.0) if before is None else before
        felt = np.zeros(2) if view.hand_force is None else view.hand_force @ aside * [1.0, -1.0]
        late, short = lag - before > _LAG, np.linalg.norm(away - np.outer(away @ aside, aside), axis=1)
        if (late & ~met & (short > 1.5 * _BESIDE)).any():
            worst = int(np.argmax(short))
            raise Failure(
                f"'{object}' is out of reach: the {SIDES[worst]} hand is {100 * short[worst]:.0f} cm short of it"
            )
        met = met | late | (felt > TOUCH)
        if half.min() < 0.0:
            raise Failure(f"the {SIDES[int(np.argmin(half))]} hand met nothing at '{object}'")
        progress = f"the hands are {100 * half.sum():.0f} cm apart and have met {met.sum()} of 2 sides"
        view = yield Action(levelled(view, hands), hands, progress=progress)
    middle, _, aside = place(view)
    touch = np.abs((view.hands - middle) @ aside)
    begin, depth = view.time, force / STIFFNESS
    while (share := min((view.time - begin) / 0.6, 1.0)) < 1.0:
        hands = aim(view, half=touch - share * depth, force=share * force)
        view = yield Action(levelled(view, hands), hands)
    # From now on the object goes with the hands: what is seen of it must not move them any more.
    hands = aim(view, half=touch - depth, force=force)
    view = yield Action(levelled(view, hands), hands)
    return (yield from wait(view, 0.4))


def _place(view: View, name: str, at: Point) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the middle of the grip in the world, and its horizontal axes: ahead of the robot, and to its left."""
    thing = seen(view, name)
    quarter = 0.5 * math.pi
    turn = float(rotations.wrap_angle(thing.yaw - view.state.yaw))
    yaw = thing.yaw - quarter * round(turn / quarter)  # of the side that faces the robot
    axes = rotations.rotation_z(yaw)
    return thing.point(np.array(at)), axes[:, 0], axes[:, 1]


def _beside(
    view: View,
    *,
    name: str,
    at: Point,
    whole_body: bool,
    half: float | np.ndarray,
    away: float = 0.0,
    force: float = 0.0,
) -> HandTargets:
    """Return targets at a distance of each hand from the middle of the grip [m], and ahead of it, with a force [N]."""
    middle, ahead, aside = _place(view, name, at)
    left, right = np.broadcast_to(half, 2)
    point = middle + (away + _SHORT - view.hand_tip) * ahead
    return HandTargets(
        point + left * aside,
        point - right * aside,
        "world",
        ahead - TOE_IN * aside,
        ahead + TOE_IN * aside,
        together=force > 0.0,
        whole_body=whole_body,
        wrench=HandWrench(force * np.array([aside, -aside])) if force else FREE,
    )


@step
def lift(
    view: View, object: Name, height: Width = 0.1, *, speed: HandSpeed = 0.15, hold: Hold = 0.3, timeout: Seconds = 10.0
) -> Course:
    """Raise the hands, and fail if the object does not come with them.

    Args:
        view: now.
        object: what the hands hold.
        height: by how much [m].
        speed: highest speed of the hands [m/s].
        hold: how long it has to stay up before it counts [s].
        timeout: after which it fails [s].
    """
    before = seen(view, object).position
    goal = shifted(in_frame(view, held_targets(view), "world"), np.array([0.0, 0.0, height]))
    view = yield from move(view, lambda _: goal, speed=speed, tolerance=math.inf, level=goal.together)
    view = yield from wait(view, hold)
    rise = float(seen(view, object).position[2] - before[2])
    if rise < 0.5 * height:
        raise Failure(f"'{object}' has risen by {100 * rise:.1f} of {100 * height:g} cm: it slipped")
    return view


@step
def carry(view: View, object: Name, walk: Course) -> Course:
    """Walk with an object in the hands, and fail if they lose it.

    Args:
        view: now.
        object: what the hands hold.
        walk: such as `walk_to(view, before="shelf", speed=0.3)`.
    """
    held_targets(view)
    before = from_hands(view, object)
    try:
        action = next(walk)
        while True:
            view = yield dataclasses.replace(action, doing="carry")
            way = float(np.linalg.norm(from_hands(view, object) - before))
            if way > _LOST:
                raise Failure(f"'{object}' was lost: it has moved by {100 * way:.0f} cm in the hands")
            action = walk.send(view)
    except StopIteration:
        return view
    finally:
        walk.close()


def from_hands(view: View, name: str) -> np.ndarray:
    """Return where an object is from the middle of the hands, in the heading frame [m], shape (3,)."""
    way = seen(view, name).position - view.hands.mean(axis=0)
    return way @ rotations.rotation_z(view.state.yaw)


@step
def place(
    view: View,
    object: Name,
    *,
    on: Name | None = None,
    at: Place | None = None,
    lower: Annotated[float, Field(gt=0, le=1.5)] = 0.4,
    speed: HandSpeed = 0.1,
    timeout: Seconds = 20.0,
) -> Course:
    """Set an object down: bring it over a point, if there is one, lower it until something carries it, let go.

    It gives the arms back. At rest they hold the hands 0.3 m ahead, over what was set down: open them with `reach`.

    Args:
        view: now.
        object: what the hands hold.
        on: name of the object whose frame `at` is in; None for the world.
        at: x and y over which the object's origin goes first [m]; None to lower it where it is.
        lower: how far it may be lowered at most [m].
        speed: with which it is lowered [m/s].
        timeout: after which it fails [s].
    """
    if on is not None and at is None:
        raise ConfigError(f"place on '{on}' needs at, x and y in its frame [m]")
    hands = in_frame(view, held_targets(view), "world")
    if at is not None:
        goal = np.array([*at, 0.0])
        if on is not None:
            goal = seen(view, on).point(goal)
        way = goal - seen(view, object).position
        way[2] = 0.0
        over = shifted(hands, way)
        view = yield from move(view, lambda _: over, speed=0.2, tolerance=0.1, level=over.together)
        hands = over
    view = yield from wait(view, 0.3)
    top, begin = seen(view, object).position[2], view.time
    while True:
        down = speed * (view.time - begin)
        sunk = float(top - seen(view, object).position[2])
        # What is seen is late by about a tenth of a second.
        if down - sunk > 0.1 * speed + 0.02:
            break
        if down > lower:
            raise Failure(f"'{object}' stands on nothing after {100 * sunk:.0f} cm")
        below = shifted(hands, np.array([0.0, 0.0, -down]))
        command = levelled(view, below) if hands.together else standing(view)
        progress = f"'{object}' was lowered by {100 * sunk:.0f} of at most {100 * lower:.0f} cm and stands on nothing"
        view = yield Action(command, below, progress=progress)
    stood = seen(view, object).position
    view = yield from release(view)
    moved = float(np.linalg.norm(seen(view, object).position - stood))
    if moved > _SHIFTED:
        raise Failure(f"'{object}' moved by {100 * moved:.0f} cm when the hands let go")
    return view


@step
def release(
    view: View,
    *,
    apart: Annotated[float, Field(gt=0, le=0.5)] = 0.08,
    back: Width = 0.2,
    rest: bool = True,
    timeout: Seconds = 10.0,
) -> Course:
    """Let go: open the grippers, take the hands off and back, and give the arms to the controller.

    Two hands go apart; a single one goes away from the middle of what its gripper held.

    Args:
        view: now.
        apart: by how much a hand goes away from the other one, or from the object [m].
        back: by how much they then come back to the robot [m].
        rest: whether the controller gets the arms afterwards.
        timeout: after which it fails [s].
    """
    grips = tuple(Grip(SIDES[row], None) for row, name in enumerate(view.held) if name is not None)
    last = view.last.hands
    if last is None or last.joints is not None or not last.given.any():
        view = yield Action(standing(view), last, grips)
        return view
    hands = in_frame(view, last, "world")
    points = points_of(view, hands)
    if hands.given.all():
        aside = points[0] - points[1]
        aside[2] = 0.0
        aside = aside / max(float(np.linalg.norm(aside)), 1e-6)
        # From where the hands are, not from inside the object where their targets were.
        points = view.hands + apart * np.array([aside, -aside])
    else:
        for row, name in enumerate(view.held):
            if name is not None:  # a hand on top of a cup rises, one at a handle goes back
                away = view.hands[row] - seen(view, name).position
                points[row] = view.hands[row] + apart * away / max(float(np.linalg.norm(away)), 1e-6)
    left, right = (points[row] if given else None for row, given in enumerate(hands.given))
    opened = HandTargets(left, right, "world", hands.left_direction, hands.right_direction, whole_body=hands.whole_body)
    view = yield Action(standing(view), view.last.hands, grips)
    view = yield from move(view, lambda _: opened, speed=0.2, tolerance=math.inf)
    home = shifted(opened, -back * rotations.rotation_z(view.state.yaw)[:, 0])
    view = yield from move(view, lambda _: home, tolerance=math.inf)
    if rest:
        view = yield Action(standing(view), None)
    return view
