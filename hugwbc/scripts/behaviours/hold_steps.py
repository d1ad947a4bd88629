"""What the hands do with an object: take it by friction or the idealised gripper, lift, carry, place, let go."""

import math
from typing import Any

import numpy as np

from hugwbc import rotations
from hugwbc.errors import ConfigError
from hugwbc.robot import SIDES
from hugwbc.scripts.behaviours.behaviour import Behaviour, Course, Failure, Status, check_hold, check_time, run, seen
from hugwbc.scripts.behaviours.conditions import TOUCH, check_place, rows_of
from hugwbc.scripts.behaviours.hand_motion import (
    HALF_WIDTH,
    STIFFNESS,
    TIP,
    Point,
    check_above,
    check_speed,
    held_targets,
    in_frame,
    levelled,
    move,
    now,
    points_of,
    shifted,
    wait,
)
from hugwbc.scripts.behaviours.view import BREAKING_FORCE, Action, Grip, View, standing
from hugwbc.scripts.behaviours.walk_steps import WalkTo
from hugwbc.targets import HandTargets, position

_LAG = 0.012  # [m], distance of a hand from its target at which it has met something
_SHORT = 0.02  # [m], by which the arms, stretched to both sides of an object, stay behind their targets
_ROOM = 0.06  # [m], between hands and object before they close
_SHIFTED = 0.08  # [m], by which an object has moved that does not stand where it was put
_LOST = 0.12  # [m], by which an object has moved in the hands that have lost it
_STRONGEST = 150.0  # [N]
# Slope with which the forearms point inwards, so that their ends press. Forearms that point outwards take a box by its
# rear edges, and it tips over forwards as soon as it is lifted.
_TOE_IN = 0.3


class Squeeze(Behaviour):
    """Takes an object between both hands, which press on it from two sides with a force.

    The hands open before the robot, go to both sides of the object, and close until each of them meets it. Then their
    targets lie inside the object and carry the wanted force.
    """

    def __init__(
        self,
        object: str,
        *,
        force: float = 60.0,
        width: float = 0.4,
        at: Point = (0.0, 0.0, 0.03),
        whole_body: bool = False,
        speed: float = 0.1,
        timeout: float = 20.0,
    ) -> None:
        """Set what to take.

        Args:
            object: its name.
            force: of each hand [N]; twice the weight or more, or the object slips.
            width: the most that the object may measure between the hands [m].
            at: where the ends of the forearms press, in the object's frame [m]; above its centre of mass it hangs
                between them.
            whole_body: whether h, p and w may help.
            speed: with which the hands close [m/s].
            timeout: after which it fails [s].
        """
        check_time("timeout", timeout)
        check_above("force", force, _STRONGEST, "N")
        check_above("width", width, 1.0)
        check_speed(speed)
        self.object, self.force, self.width, self.at = object, force, width, position("at", at)
        self.whole_body, self.speed, self.timeout = whole_body, speed, timeout

    def course(self, view: View) -> Course:  # noqa: D102
        open_half = self.width / 2 + HALF_WIDTH + _ROOM
        middle, ahead, _ = self._place(view)
        start = now(view)
        # First up and apart where the hands are, so that they do not meet the object or the table on their way.
        away = min(float((start - middle).mean(axis=0) @ ahead), -0.15)
        view = yield from move(self, view, lambda _: self._targets(view, open_half, away), tolerance=0.1, level=True)
        view = yield from move(self, view, lambda v: self._targets(v, open_half), tolerance=0.04, level=True)
        return (yield from self._close(view, open_half))

    def _place(self, view: View) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the middle of the grip in the world, and its horizontal axes: ahead of the robot, and to its left."""
        thing = seen(view, self.object)
        quarter = 0.5 * math.pi
        turn = float(rotations.wrap_angle(thing.yaw - view.state.yaw))
        yaw = thing.yaw - quarter * round(turn / quarter)  # of the side that faces the robot
        axes = rotations.rotation_z(yaw)
        return thing.point(self.at), axes[:, 0], axes[:, 1]

    def _targets(self, view: View, half: float | np.ndarray, away: float = 0.0, force: float = 0.0) -> HandTargets:
        """Return targets at a distance of each hand from the middle [m], and ahead of it, with a force [N]."""
        middle, ahead, aside = self._place(view)
        left, right = np.broadcast_to(half, 2)
        point = middle + (away + _SHORT - TIP) * ahead
        return HandTargets(
            point + left * aside,
            point - right * aside,
            "world",
            ahead - _TOE_IN * aside,
            ahead + _TOE_IN * aside,
            together=force > 0.0,
            whole_body=self.whole_body,
            left_force=-force * aside if force else None,
            right_force=force * aside if force else None,
        )

    def _close(self, view: View, open_half: float) -> Course:
        """Bring the hands together until both have met something, and press."""
        half, met, time = np.full(2, open_half), np.zeros(2, dtype=bool), view.time
        while not met.all():
            half = np.where(met, half, half - self.speed * (view.time - time))
            time = view.time
            hands = self._targets(view, half)
            _, _, aside = self._place(view)
            lag = (view.hands - hands.array()) @ aside * [1.0, -1.0]
            felt = np.zeros(2) if view.hand_force is None else view.hand_force @ aside * [1.0, -1.0]
            met = met | (lag > _LAG) | (felt > TOUCH)
            self.progress = f"the hands are {100 * half.sum():.0f} cm apart and have met {met.sum()} of 2 sides"
            if half.min() < 0.0:
                raise Failure(f"the {SIDES[int(np.argmin(half))]} hand met nothing at '{self.object}'")
            view = yield Action(levelled(view, hands), hands)
        middle, _, aside = self._place(view)
        touch = np.abs((view.hands - middle) @ aside)
        begin, depth = view.time, self.force / STIFFNESS
        while (share := min((view.time - begin) / 0.6, 1.0)) < 1.0:
            hands = self._targets(view, touch - share * depth, force=share * self.force)
            view = yield Action(levelled(view, hands), hands)
        # From now on the object goes with the hands: what is seen of it must not move them any more.
        hands = self._targets(view, touch - depth, force=self.force)
        view = yield Action(levelled(view, hands), hands)
        return (yield from wait(view, 0.4))


class Grasp(Squeeze):
    """Another name of `Squeeze`: a robot without fingers takes an object between its hands."""


class Attach(Behaviour):
    """Takes an object with the idealised gripper of one hand, which has to be within 3 cm of it."""

    def __init__(
        self,
        object: str,
        hand: str = "right",
        *,
        hook: bool = False,
        breaking_force: float = BREAKING_FORCE,
        timeout: float = 2.0,
    ) -> None:
        """Set what to take.

        Args:
            object: its name.
            hand: "left", "right" or "both".
            hook: whether the hand may turn about its origin, as on a handle.
            breaking_force: at which it breaks [N].
            timeout: after which it fails [s].
        """
        check_time("timeout", timeout)
        check_above("breaking_force", breaking_force, 1e4, "N")
        self.rows = rows_of(hand)
        self.object, self.hook, self.breaking_force, self.timeout = object, hook, breaking_force, timeout

    def course(self, view: View) -> Course:  # noqa: D102
        seen(view, self.object)
        while True:
            missing = [row for row in self.rows if view.held[row] != self.object]
            if not missing:
                return view
            self.progress = f"the {SIDES[missing[0]]} hand is not within 3 cm of '{self.object}'"
            grips = tuple(Grip(SIDES[row], self.object, self.hook, self.breaking_force) for row in missing)
            view = yield Action(standing(view), view.last.hands, grips)


class Lift(Behaviour):
    """Raises the hands, and fails if the object does not come with them."""

    def __init__(
        self, object: str, height: float = 0.1, *, speed: float = 0.15, hold: float = 0.3, timeout: float = 10.0
    ) -> None:
        """Set how far.

        Args:
            object: what the hands hold.
            height: by how much [m].
            speed: highest speed of the hands [m/s].
            hold: how long it has to stay up before it counts [s].
            timeout: after which it fails [s].
        """
        check_time("timeout", timeout)
        check_above("height", height, 1.0)
        check_speed(speed)
        check_hold(hold, timeout)
        self.object, self.height, self.speed, self.hold, self.timeout = object, height, speed, hold, timeout

    def course(self, view: View) -> Course:  # noqa: D102
        before = seen(view, self.object).position
        goal = shifted(in_frame(view, held_targets(view), "world"), np.array([0.0, 0.0, self.height]))
        view = yield from move(self, view, lambda _: goal, speed=self.speed, tolerance=math.inf, level=goal.together)
        view = yield from wait(view, self.hold)
        rise = float(seen(view, self.object).position[2] - before[2])
        if rise < 0.5 * self.height:
            raise Failure(f"'{self.object}' has risen by {100 * rise:.1f} of {100 * self.height:g} cm: it slipped")
        return view


class Carry(Behaviour):
    """Walks with an object in the hands, and fails if they lose it; it takes what `WalkTo` takes."""

    def __init__(self, object: str, position: tuple[float, float] | None = None, **walk: Any) -> None:  # noqa: ANN401
        """Set what to carry and where.

        Args:
            object: what the hands hold.
            position: x and y in the world [m].
            walk: what else `WalkTo` takes, such as `before`; its speed is 0.3 m/s by default.
        """
        self.object, self.walk = object, WalkTo(position, **{"speed": 0.3, **walk})
        self.timeout = math.inf  # that of the walk

    def course(self, view: View) -> Course:  # noqa: D102
        held_targets(view)
        before = _in_hands(view, self.object)
        self.walk.begin(view)
        while True:
            action = self.walk.update(view)
            if self.walk.status is Status.FAILURE:
                raise Failure(self.walk.reason, self.walk.label)
            way = _in_hands(view, self.object) - before
            if float(np.linalg.norm(way)) > _LOST:
                raise Failure(
                    f"'{self.object}' was lost: it has moved by {100 * np.linalg.norm(way):.0f} cm in the hands"
                )
            if self.walk.status is Status.SUCCESS:
                return view
            view = yield action


def _in_hands(view: View, name: str) -> np.ndarray:
    """Return where an object is from the middle of the hands, in the heading frame [m], shape (3,)."""
    way = seen(view, name).position - view.hands.mean(axis=0)
    return way @ rotations.rotation_z(view.state.yaw)


class Place(Behaviour):
    """Sets an object down: brings it over a point, if there is one, lowers it until something carries it, lets go."""

    def __init__(
        self,
        object: str,
        *,
        on: str | None = None,
        at: tuple[float, float] | None = None,
        lower: float = 0.4,
        speed: float = 0.1,
        timeout: float = 20.0,
    ) -> None:
        """Set where.

        Args:
            object: what the hands hold.
            on: name of the object whose frame `at` is in; None for the world.
            at: x and y over which the object's origin goes first [m]; None to lower it where it is.
            lower: how far it may be lowered at most [m].
            speed: with which it is lowered [m/s].
            timeout: after which it fails [s].
        """
        check_time("timeout", timeout)
        check_above("lower", lower, 1.5)
        check_speed(speed)
        if on is not None and at is None:
            raise ConfigError(f"place on '{on}' needs at, x and y in its frame [m]")
        if at is not None:
            check_place("at", at)
        self.object, self.on, self.at, self.lower = object, on, at, lower
        self.speed, self.timeout = speed, timeout

    def course(self, view: View) -> Course:  # noqa: D102
        hands = in_frame(view, held_targets(view), "world")
        if self.at is not None:
            goal = np.array([*self.at, 0.0])
            if self.on is not None:
                goal = seen(view, self.on).point(goal)
            way = goal - seen(view, self.object).position
            way[2] = 0.0
            over = shifted(hands, way)
            view = yield from move(self, view, lambda _: over, speed=0.2, tolerance=0.1, level=over.together)
            hands = over
        view = yield from wait(view, 0.3)
        top, begin = seen(view, self.object).position[2], view.time
        while True:
            down = self.speed * (view.time - begin)
            sunk = float(top - seen(view, self.object).position[2])
            self.progress = f"'{self.object}' was lowered by {100 * sunk:.0f} cm and stands on nothing yet"
            # What is seen is late by about a tenth of a second.
            if down - sunk > 0.1 * self.speed + 0.02:
                break
            if down > self.lower:
                raise Failure(f"'{self.object}' stands on nothing after {100 * sunk:.0f} cm")
            lower = shifted(hands, np.array([0.0, 0.0, -down]))
            view = yield Action(levelled(view, lower) if hands.together else standing(view), lower)
        stood = seen(view, self.object).position
        view = yield from run(Release(), view)
        moved = float(np.linalg.norm(seen(view, self.object).position - stood))
        if moved > _SHIFTED:
            raise Failure(f"'{self.object}' moved by {100 * moved:.0f} cm when the hands let go")
        return view


class Release(Behaviour):
    """Lets go: opens the grippers, takes the hands off and back, and gives the arms to the controller.

    Two hands go apart; a single one goes away from the middle of what its gripper held.
    """

    def __init__(self, apart: float = 0.08, back: float = 0.2, *, rest: bool = True, timeout: float = 10.0) -> None:
        """Set how.

        Args:
            apart: by how much a hand goes away from the other one, or from the object [m].
            back: by how much they then come back to the robot [m].
            rest: whether the controller gets the arms afterwards.
            timeout: after which it fails [s].
        """
        check_time("timeout", timeout)
        check_above("apart", apart, 0.5)
        check_above("back", back, 1.0)
        self.apart, self.back, self.rest, self.timeout = apart, back, rest, timeout

    def course(self, view: View) -> Course:  # noqa: D102
        grips = tuple(Grip(SIDES[row], None) for row, name in enumerate(view.held) if name is not None)
        last = view.last.hands
        if last is None or last.joints is not None:
            view = yield Action(standing(view), last, grips)
            return view
        hands = in_frame(view, last, "world")
        points = points_of(view, hands)
        if hands.given.all():
            aside = points[0] - points[1]
            aside[2] = 0.0
            aside = aside / max(float(np.linalg.norm(aside)), 1e-6)
            # From where the hands are, not from inside the object where their targets were.
            points = view.hands + self.apart * np.array([aside, -aside])
        else:
            for row, name in enumerate(view.held):
                if name is not None:  # a hand on top of a cup rises, one at a handle goes back
                    away = view.hands[row] - seen(view, name).position
                    points[row] = view.hands[row] + self.apart * away / max(float(np.linalg.norm(away)), 1e-6)
        left, right = (points[row] if given else None for row, given in enumerate(hands.given))
        opened = HandTargets(
            left,
            right,
            "world",
            hands.left_direction,
            hands.right_direction,
            whole_body=hands.whole_body,
        )
        view = yield Action(standing(view), view.last.hands, grips)
        view = yield from move(self, view, lambda _: opened, speed=0.2, tolerance=math.inf)
        home = shifted(opened, -self.back * rotations.rotation_z(view.state.yaw)[:, 0])
        view = yield from move(self, view, lambda _: home, tolerance=math.inf)
        if self.rest:
            view = yield Action(standing(view), None)
        return view
