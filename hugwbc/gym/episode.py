"""One episode of a task, stepped from outside and judged while it runs, and behaviours that follow its actions."""

import numpy as np

from hugwbc.behaviours import BehaviourSource
from hugwbc.behaviours.course import Course
from hugwbc.behaviours.hands import points_in
from hugwbc.commands import default_command
from hugwbc.controller import Controller
from hugwbc.gait import Gait
from hugwbc.gym.task_action import Wish
from hugwbc.hand_wrench import HandWrench
from hugwbc.robot import Robot
from hugwbc.runtime.loop import ControlLoop
from hugwbc.scripts.view import Action, View
from hugwbc.sim import Simulation
from hugwbc.targets import HandTargets
from hugwbc.tasks import Ending, Task, Verdict, shapes_of
from hugwbc.tasks.demonstration import ACTION_NAMES
from hugwbc.tasks.record import TaskWatch
from hugwbc.tasks.replay import Nearest, follow, grips, nearest_in
from hugwbc.upper_ik import UpperBodySource

_ASKED = Ending(False, "asked by a learner")


class Episode:
    """A robot among the objects of a task, from a stand."""

    def __init__(
        self,
        task: Task,
        simulation: Simulation,
        controller: Controller,
        arms: UpperBodySource,
        *,
        recorded: bool = False,
    ) -> None:
        """Begin, with a robot among the objects of the task's scene; the task judges.

        A wish acts one control period after what was seen for it; a recorded one acts at once, as in the recording.
        """
        assert simulation.scene is not None
        self.simulation, self.shapes = simulation, shapes_of(simulation.scene)
        nearest = nearest_in(simulation)
        # Carries out its `wish`; set it.
        self.behaviour = FollowRow(nearest) if recorded else FollowWish(nearest, simulation.robot)
        self._source = BehaviourSource(self.behaviour.course)
        self._loop = ControlLoop(controller, self._source, simulation, arms)
        self._loop.reset()
        self._task, self._watch = task, TaskWatch(simulation)
        self._ticks, self.time = 0, 0.0
        self._recorded = recorded
        self._settle()
        task.check(self._watch.record(_ASKED))

    @property
    def view(self) -> View:
        """The view now."""
        return self._source.completed(self._loop.look(self.time))

    @property
    def problem(self) -> str:
        """Why the request is not carried out; empty while it is."""
        return self._source.reason

    @property
    def fell(self) -> bool:
        """Whether the robot has fallen, or the physics diverged."""
        return self._watch.fell

    def advance(self, ticks: int) -> None:
        """Run the control loop for so many of its periods; a robot that falls ends it early."""
        for _ in range(ticks):
            if self._recorded:
                self._command = self._loop.decide(self.time)
            for substep in range(self._loop.substeps):
                self._sample(self.time + substep * self.simulation.timestep)
                self._loop.step_physics(self._command)
                self._watch.look()
            self._ticks += 1
            self.time = round(self._ticks * self._loop.period, 9)  # rounding errors would show in `info`
            self._settle()
            if self.fell:
                return

    def _settle(self) -> None:
        """End a period: decide on the next one unless its wish is still to come, and take a sample where one is due."""
        if not self._recorded:
            self._command = self._loop.decide(self.time)
        self._sample(self.time)

    def _sample(self, time: float) -> None:
        """Take a sample if one is due at a time [s]."""
        self._watch.sample(time, self._loop.control.chain.command.gait)

    def judge(self) -> Verdict:
        """Return the verdict on the episode, as if it ended now."""
        return self._task.judge(self._watch.record(_ASKED))


PERIOD = 0.1  # [s] between two actions
HAND_SPEED = 0.5  # [m/s], of a hand's target
_APART = 0.05  # [m], hands that are nearer have no line between them along which to squeeze


class FollowWish:
    """Does what `wish` says; it never ends."""

    def __init__(self, nearest: Nearest, robot: Robot | None = None) -> None:
        """Start from a standing robot whose arms are its controller's; a gripper closes on what is `nearest`."""
        self.wish = Wish(default_command(Gait.STANDING, robot))  # the request; set it at any time
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
        self.wish = np.zeros(len(ACTION_NAMES))  # the request; set it at any time
        self._nearest = nearest

    def course(self, view: View) -> Course:
        """Follow the wish."""
        return follow(view, lambda time: self.wish, self._nearest)
