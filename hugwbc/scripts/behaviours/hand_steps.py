"""What the hands do on their own: reach, move on, press and wipe."""

import dataclasses
import math

import numpy as np

from hugwbc.errors import ConfigError
from hugwbc.robot import SIDES
from hugwbc.scripts.behaviours.behaviour import Behaviour, Course, Failure, check_hold, check_time, seen
from hugwbc.scripts.behaviours.conditions import STRONGEST, rows_of
from hugwbc.scripts.behaviours.hand_motion import (
    ARRIVED,
    HALF_WIDTH,
    HAND_SPEED,
    TIP,
    Point,
    Pressing,
    check_above,
    check_speed,
    check_tolerance,
    frame_of,
    held_targets,
    in_frame,
    move,
    placed,
    points_in,
    points_of,
    shifted,
    turned,
    wait,
)
from hugwbc.scripts.behaviours.view import Action, View, standing
from hugwbc.targets import HandTargets, direction, position


class Reach(Behaviour):
    """Brings one hand or both to points of a frame or of an object, which may move meanwhile."""

    def __init__(
        self,
        left: Point | None = None,
        right: Point | None = None,
        *,
        frame: str = "heading",
        left_direction: Point | None = None,
        right_direction: Point | None = None,
        together: bool = False,
        whole_body: bool = False,
        speed: float = HAND_SPEED,
        tolerance: float = ARRIVED,
        timeout: float = 10.0,
    ) -> None:
        """Set the points.

        Args:
            left: target of the left hand [m]; None for a hand that stays where it is asked to be.
            right: of the right hand, likewise.
            frame: "pelvis", "heading", "steady", "world", or the name of an object.
            left_direction: along which the left forearm should point, in that frame.
            right_direction: along which the right one should.
            together: whether both hands hold one object.
            whole_body: whether h, p and w may help.
            speed: highest speed of a hand [m/s].
            tolerance: distance at which a hand has arrived [m].
            timeout: after which it fails [s].
        """
        check_time("timeout", timeout)
        check_speed(speed)
        check_tolerance(tolerance)
        HandTargets.of(left, right, left_direction=left_direction, right_direction=right_direction, together=together)
        self.points, self.directions, self.frame = (left, right), (left_direction, right_direction), frame
        self.together, self.whole_body = together, whole_body
        self.speed, self.tolerance, self.timeout = speed, tolerance, timeout

    def course(self, view: View) -> Course:  # noqa: D102
        frame = frame_of(self.frame)
        others = view.last.hands
        stays = [None, None]
        if others is not None and others.joints is None:  # a hand without a point stays
            points = points_in(view, points_of(view, others), frame)
            stays = [points[row] if given else None for row, given in enumerate(others.given)]

        def aim(view: View) -> HandTargets:
            points = [placed(view, self.frame, point) for point in self.points]
            left, right = (stay if point is None else point for point, stay in zip(points, stays, strict=True))
            pointing = [turned(view, self.frame, vector) for vector in self.directions]
            return HandTargets(left, right, frame, pointing[0], pointing[1], self.together, self.whole_body)

        return (yield from move(self, view, aim, speed=self.speed, tolerance=self.tolerance))


class MoveHands(Behaviour):
    """Moves the hands that have targets, as they are to each other, by a displacement or to where their middle goes.

    Directions, forces and what else the targets say stay.
    """

    def __init__(
        self,
        by: Point | None = None,
        *,
        to: Point | None = None,
        frame: str = "heading",
        speed: float = HAND_SPEED,
        tolerance: float = 0.06,
        timeout: float = 10.0,
    ) -> None:
        """Set the motion.

        Args:
            by: displacement [m], or
            to: where the middle of the hands goes [m].
            frame: of the displacement or point: "pelvis", "heading", "steady", "world", or the name of an object.
            speed: highest speed of a hand [m/s].
            tolerance: distance at which a hand has arrived [m].
            timeout: after which it fails [s].
        """
        check_time("timeout", timeout)
        check_speed(speed)
        check_tolerance(tolerance)
        if (by is None) is (to is None):
            raise ConfigError("move_hands needs either by or to; give one of them")
        position("by" if to is None else "to", by if to is None else to)
        self.by, self.to, self.frame = by, to, frame
        self.speed, self.tolerance, self.timeout = speed, tolerance, timeout

    def course(self, view: View) -> Course:  # noqa: D102
        hands = in_frame(view, held_targets(view), frame_of(self.frame))
        if self.to is None:
            by = turned(view, self.frame, self.by)
        else:
            by = placed(view, self.frame, self.to) - np.nanmean(hands.array(), axis=0)  # type: ignore[operator]
        goal = shifted(hands, np.asarray(by))
        return (yield from move(self, view, lambda _: goal, speed=self.speed, tolerance=self.tolerance))


class Press(Behaviour):
    """Presses something with the end of a forearm: goes before it, pushes on along an axis, and comes back.

    It ends when the object has been seen to give way by `travel`, or has been pressed with `force` where forces on the
    hands are known, or at the end of `depth` if neither is asked for.
    """

    def __init__(
        self,
        object: str,
        hand: str = "right",
        *,
        at: Point = (0.0, 0.0, 0.0),
        axis: Point = (1.0, 0.0, 0.0),
        travel: float | None = None,
        force: float | None = None,
        depth: float = 0.08,
        approach: float = 0.08,
        hold: float = 0.3,
        speed: float = 0.08,
        whole_body: bool = False,
        timeout: float = 15.0,
    ) -> None:
        """Set what to press.

        Args:
            object: its name.
            hand: "left" or "right".
            at: where, in the object's frame [m].
            axis: in which direction, in the object's frame.
            travel: way of the object after which it is pressed [m].
            force: on the hand after which it is pressed [N].
            depth: how far the hand is asked to go beyond the point [m].
            approach: distance before the point from which it goes slowly [m].
            hold: how long it stays pressed [s].
            speed: of the slow way [m/s].
            whole_body: whether h, p and w may help.
            timeout: after which it fails [s].
        """
        check_time("timeout", timeout)
        if hand not in SIDES:
            rows_of(hand)
            raise ConfigError("hand is both; press takes one hand: give left or right")
        if travel is not None:
            check_above("travel", travel, 0.5)
        if force is not None:
            check_above("force", force, STRONGEST, "N")
        for name, value in (("depth", depth), ("approach", approach)):
            check_above(name, value, 0.5)
        check_speed(speed)
        check_hold(hold, timeout)
        self.object, self.hand, self.at = object, hand, position("at", at)
        self.axis, self.travel, self.force = direction("axis", axis), travel, force
        self.depth, self.approach, self.hold = depth, approach, hold
        self.speed, self.whole_body, self.timeout = speed, whole_body, timeout

    def course(self, view: View) -> Course:  # noqa: D102
        row = SIDES.index(self.hand)
        thing = seen(view, self.object)  # as it is at rest: it moves when it is pressed
        axis, point = thing.direction(self.axis), thing.point(self.at)

        def ahead(way: float) -> HandTargets:
            """Return the target whose forearm ends this far beyond the point."""
            hands: list = [None, None]
            directions: list = [None, None]
            hands[row], directions[row] = point + (way - TIP) * axis, axis
            left, right = hands
            return HandTargets(left, right, "world", directions[0], directions[1], whole_body=self.whole_body)

        # From below or from the side the hand would meet the object's edge: first it comes up behind the way.
        view = yield from move(self, view, lambda _: ahead(-self.approach), tolerance=0.04)
        rest = seen(view, self.object).position
        begin, met = view.time, False
        while not met:
            way = min(self.speed * (view.time - begin) - self.approach, self.depth)
            gone = float((seen(view, self.object).position - rest) @ axis)
            felt = 0.0 if view.hand_force is None else -float(view.hand_force[row] @ axis)
            wanted = [
                gone >= (self.travel or -math.inf) if self.travel is not None else None,
                felt >= self.force if self.force is not None else None,
            ]
            asked = [answer for answer in wanted if answer is not None]
            met = any(asked) if asked else way >= self.depth
            self.progress = (
                f"'{self.object}' has given way by {1000 * gone:.0f} mm under {felt:.0f} N, "
                f"the hand is asked to go {1000 * way:.0f} mm beyond"
            )
            if not met and way >= self.depth and view.time - begin > (self.approach + self.depth) / self.speed + 1.0:
                break
            view = yield Action(standing(view), ahead(way))
        if met:
            view = yield from wait(view, self.hold)
        progress = self.progress
        view = yield from move(self, view, lambda _: ahead(-self.approach), tolerance=math.inf)
        if not met:
            raise Failure(progress)
        return view


class Wipe(Behaviour):
    """Leads a forearm along a path on a surface, with a force against it."""

    def __init__(
        self,
        object: str,
        path: tuple[Point, ...],
        hand: str = "right",
        *,
        force: float = 15.0,
        normal: Point = (0.0, 0.0, 1.0),
        speed: float = 0.1,
        whole_body: bool = False,
        timeout: float = 60.0,
    ) -> None:
        """Set the path.

        Args:
            object: whose frame the path is in.
            path: at least two points on the surface, in the object's frame [m].
            hand: "left" or "right".
            force: against the surface [N].
            normal: of the surface, away from it, in the object's frame.
            speed: along the path [m/s].
            whole_body: whether h, p and w may help.
            timeout: after which it fails [s].
        """
        check_time("timeout", timeout)
        if hand not in SIDES:
            rows_of(hand)
            raise ConfigError("hand is both; wipe takes one hand: give left or right")
        check_above("force", force, 60.0, "N")
        check_speed(speed)
        if len(path) < 2:
            raise ConfigError(f"path has {len(path)} points; give at least two")
        self.object, self.hand, self.force, self.speed = object, hand, force, speed
        self.path = np.array([position("path", point) for point in path])
        if not np.linalg.norm(np.diff(self.path, axis=0), axis=1).sum() > 0.0:
            raise ConfigError("path has points at one place only; give points along which to wipe")
        self.normal = direction("normal", normal)
        self.whole_body, self.timeout = whole_body, timeout

    def course(self, view: View) -> Course:  # noqa: D102
        row = SIDES.index(self.hand)
        legs = np.linalg.norm(np.diff(self.path, axis=0), axis=1)
        ends = np.concatenate(([0.0], np.cumsum(legs)))

        def on(view: View, way: float, height: float, force: float) -> HandTargets:
            """Return the target `way` along the path and `height` above it."""
            thing = seen(view, self.object)
            point = np.array([np.interp(way, ends, column) for column in self.path.T])
            up = thing.direction(self.normal)
            hands: list = [None, None]
            hands[row] = thing.point(point) + (height + HALF_WIDTH) * up
            targets = HandTargets(hands[0], hands[1], "world", whole_body=self.whole_body)
            return dataclasses.replace(targets, **{f"{self.hand}_force": -force * up}) if force else targets

        view = yield from move(self, view, lambda v: on(v, 0.0, 0.08, 0.0), tolerance=0.05)
        view = yield from move(self, view, lambda v: on(v, 0.0, 0.0, self.force), speed=0.1, tolerance=math.inf)
        begin, length = view.time, float(ends[-1])
        pressing = Pressing(view, row, seen(view, self.object).direction(self.normal), self.force)
        while (way := self.speed * (view.time - begin)) < length + 0.3 * self.speed:
            self.progress = f"{100 * min(way, length):.0f} of {100 * length:.0f} cm are wiped"
            view = yield Action(standing(view), on(view, way, 0.0, pressing.asked(view)))
        return (yield from move(self, view, lambda v: on(v, length, 0.08, 0.0), tolerance=math.inf))
