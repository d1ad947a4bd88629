"""One episode of a task, stepped from outside and judged while it runs."""

import dataclasses

from hugwbc.behaviours import BehaviourSource, View
from hugwbc.controller import Controller
from hugwbc.errors import ConfigError
from hugwbc.gym.follow_wish import FollowRow, FollowWish
from hugwbc.runtime.loop import ControlLoop
from hugwbc.sim import Simulation
from hugwbc.tasks import Ending, Task, Verdict, shapes_of
from hugwbc.tasks.record import TaskWatch
from hugwbc.tasks.replay import nearest_in
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
        if simulation.scene is None:
            raise ConfigError(f"task '{task.name}' needs objects; give the simulation scene=task.scene")
        self.simulation, self.shapes = simulation, shapes_of(simulation.scene)
        follower = FollowRow if recorded else FollowWish
        self.behaviour = follower(nearest_in(simulation))  # carries out its `wish`; set it
        self._source = BehaviourSource(self.behaviour.course)
        self._loop = ControlLoop(controller, self._source, simulation, arms)
        self._loop.reset()
        self._task, self._watch = task, TaskWatch(simulation)
        self._ticks, self.time = 0, 0.0
        self._recorded, self._decided = recorded, False
        self._settle()
        task.check(self._watch.record(_ASKED))

    @property
    def view(self) -> View:
        """The view now."""
        return dataclasses.replace(self._loop.look(self.time), last=self._source.action)

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
            self._decide()
            for _ in range(self._loop.substeps):
                self._loop.step_physics(self._command)
                self._watch.look()
            self._ticks += 1
            self.time = round(self._ticks * self._loop.period, 9)  # rounding errors would show in `info`
            self._settle()
            if self.fell:
                return

    def _decide(self) -> None:
        """Take the joint command of this period."""
        if not self._decided:
            self._command, self._decided = self._loop.decide(self.time), True

    def _settle(self) -> None:
        """End a period: take a sample where one is due."""
        self._decided = False
        if not self._recorded:
            self._decide()
        self._watch.sample(self.time, self._loop.control.chain.command.gait)

    def judge(self) -> Verdict:
        """Return the verdict on the episode, as if it ended now."""
        return self._task.judge(self._watch.record(_ASKED))
