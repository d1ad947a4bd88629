"""Behaviours that follow a learner's actions: its own kind, with a speed limit for the hands, or recorded ones."""

import numpy as np

from hugwbc.behaviours.course import Course
from hugwbc.behaviours.hands import points_in
from hugwbc.gym.task_action import Wish
from hugwbc.hand_wrench import HandWrench
from hugwbc.scripts.view import Action, View
from hugwbc.targets import HandTargets
from hugwbc.tasks.demonstration import ACTION_NAMES
from hugwbc.tasks.replay import Nearest, follow, grips

PERIOD = 0.1  # [s] between two actions
HAND_SPEED = 0.5  # [m/s], of a hand's target
_APART = 0.05  # [m], hands that are nearer have no line between them along which to squeeze


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
            requests = grips(view, self.wish.grips, took, self._nearest)
            view = yield Action(self.wish.command, self._targets(), requests)

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
        return HandTargets(left, right, "heading", together=True, wrench=HandWrench(np.array([-inwards, inwards])))


class FollowRow:
    """Does what `wish` says, a recorded action; it never ends."""

    def __init__(self, nearest: Nearest) -> None:
        """Start from a standing robot whose arms are its controller's; a gripper closes on what is `nearest`."""
        self.wish = np.zeros(len(ACTION_NAMES))  # set another array for another request
        self._nearest = nearest

    def course(self, view: View) -> Course:
        """Follow the wish."""
        return follow(view, lambda time: self.wish, self._nearest)
