"""A behaviour that follows a learner's actions, with a speed limit for the hands."""

from collections.abc import Callable

import numpy as np

from hugwbc.behaviours.course import Course
from hugwbc.behaviours.hands import points_in
from hugwbc.gym.task_action import Wish
from hugwbc.robot import SIDES
from hugwbc.scripts.view import Action, Grip, View
from hugwbc.targets import HandTargets

PERIOD = 0.1  # [s] between two actions
HAND_SPEED = 0.5  # [m/s], of a hand's target
_APART = 0.05  # [m], hands that are nearer have no line between them along which to squeeze

Nearest = Callable[[str], tuple[str, bool] | None]
"""Returns the name of what the gripper of a side can take now, and whether that moves in a joint; None for nothing."""


class FollowWish:
    """Does what `wish` says; it never ends."""

    def __init__(self, nearest: Nearest) -> None:
        """Start from a standing robot whose arms are its controller's; a gripper closes on what is `nearest`."""
        self.wish = Wish()  # the request; set it at any time
        self._nearest = nearest

    def course(self, view: View) -> Course:
        """Follow the wish."""
        self.points = np.full((2, 3), np.nan)  # targets of the hands now, heading frame [m]; NaN without one
        took = [False, False]  # whether each gripper has held something since it was asked to
        time, wish, left = view.time, self.wish, 0.0
        while True:
            if self.wish is not wish:
                wish, left = self.wish, PERIOD
            self._move(view, view.time - time, left)
            left, time = left - (view.time - time), view.time
            view = yield Action(self.wish.command, self._targets(), self._grips(view, took))

    def _move(self, view: View, dt: float, left: float) -> None:
        """Move the targets towards the wish, to be there with the next action; a new target starts from its hand."""
        measured = points_in(view, view.hands, "heading")
        start = np.where(np.isnan(self.points), measured, self.points)
        way = self.wish.points - start
        length = np.linalg.norm(way, axis=1, keepdims=True)
        share = np.minimum(HAND_SPEED * dt / np.maximum(length, 1e-9), dt / max(left, dt, 1e-9))
        self.points = np.where(self.wish.used[:, None], start + share * way, np.nan)

    def _targets(self) -> HandTargets | None:
        used, points = self.wish.used, self.points
        if not used.any():
            return None
        left, right = (points[hand] if used[hand] else None for hand in range(2))
        between = points[1] - points[0]
        length = float(np.linalg.norm(between)) if used.all() else 0.0
        if self.wish.squeeze <= 0.0 or length < _APART:
            return HandTargets(left, right, "heading")
        inwards = self.wish.squeeze / length * between
        return HandTargets(left, right, "heading", together=True, left_force=inwards, right_force=-inwards)

    def _grips(self, view: View, took: list[bool]) -> tuple[Grip, ...]:
        """Return the requests to the grippers. After a grip broke, the gripper must be opened first."""
        requests = []
        for hand, side in enumerate(SIDES):
            held = view.held[hand]
            if not self.wish.grips[hand]:
                took[hand] = False
                if held is not None:
                    requests.append(Grip(side, None))
            elif held is not None:
                took[hand] = True
            elif not took[hand] and (found := self._nearest(side)) is not None:
                name, jointed = found
                # A second hand on an object may turn, and so may one on a thing that moves in a joint: an arm has four
                # joints, and its weld would fight the other one.
                requests.append(Grip(side, name, hook=jointed or name in view.held))
        return tuple(requests)
