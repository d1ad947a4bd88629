"""One episode of a task that is asked for its commands tick by tick, and judged while it goes on."""

import dataclasses

import numpy as np

from hugwbc.controller import Controller
from hugwbc.errors import ConfigError
from hugwbc.gym.follow_wish import FollowWish
from hugwbc.robot import SIDES
from hugwbc.runtime.estimation import StateEstimator
from hugwbc.runtime.loop import ControlLoop
from hugwbc.runtime.moment import Moment
from hugwbc.runtime.trace import RECORD_PERIOD
from hugwbc.scripts.behaviours import BehaviourSource, View
from hugwbc.sim import Simulation
from hugwbc.sim.scenes import REACH
from hugwbc.tasks import Ending, Task, Verdict, shapes_of
from hugwbc.tasks.record import TaskWatch
from hugwbc.upper_ik import UpperBodySource

_ASKED = Ending(False, "asked by a learner")
_FIELDS = ("time", "qpos", "hand_force", "hand_error", "object_pose")


@dataclasses.dataclass(eq=False)
class GrowingSamples:
    """The samples of an episode up to now, as `hugwbc.tasks.record.Samples` has them."""

    time: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0))
    qpos: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((0, 26)))
    hand_force: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((0, 2, 3)))
    hand_error: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((0, 2)))
    object_pose: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((0, 0, 7)))
    fell: bool = False
    problems: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self._new: dict[str, list[np.ndarray]] = {name: [] for name in _FIELDS}

    @property
    def count(self) -> int:
        """Number of samples, those that are not in the arrays yet included."""
        return len(self.time) + len(self._new["time"])

    def add(self, time: float, moment: Moment, hands: np.ndarray) -> None:
        """Add a sample.

        Args:
            time: [s].
            moment: the robot and the objects.
            hands: true positions of both hands [m], shape (2, 3).
        """
        error = np.linalg.norm(hands - moment.hand_target_world, axis=1)
        values = (np.array(time), moment.qpos, moment.hand_force, error, moment.object_pose)
        for name, value in zip(_FIELDS, values, strict=True):
            self._new[name].append(value)

    def gather(self) -> None:
        """Append what has been added to the arrays: once for many samples, since it copies them."""
        for name, values in self._new.items():
            if values:
                before, new = getattr(self, name), np.stack(values)
                setattr(self, name, new if not len(before) else np.concatenate((before, new)))
                values.clear()


class Episode:
    """A robot among the objects of a task, from a stand.

    Attributes:
        simulation: robot and objects.
        shapes: what is told of the objects.
        behaviour: carries out what is asked for; set its `wish`.
        time: since the start [s].
    """

    def __init__(
        self,
        task: Task,
        simulation: Simulation,
        controller: Controller,
        arms: UpperBodySource,
        estimator: StateEstimator | None,
    ) -> None:
        """Begin.

        Args:
            task: its judge is asked.
            simulation: a robot among the objects of the task's scene.
            controller: any object with the members of `Controller`.
            arms: turns hand targets into arm targets.
            estimator: estimates the state from the sensors; None if the controller reads them itself.

        Raises:
            ConfigError: if the simulation has no objects, or the controller's period is not a multiple of the time
                step.
        """
        if simulation.scene is None:
            raise ConfigError(f"task '{task.name}' needs objects; give the simulation scene=task.scene")
        self.simulation, self.shapes, self._task = simulation, shapes_of(simulation.scene), task
        self.behaviour = FollowWish(self._nearest)
        self._source = BehaviourSource(self.behaviour)
        self._loop = ControlLoop(controller, self._source, simulation, arms, estimator)
        self._loop.reset()
        names = [name for name in simulation.scene.body_names if simulation.model.body(name).jntnum[0] > 0]
        self._movable = {name: simulation.objects[name].travel is not None for name in names}
        self._watch, self._samples = TaskWatch(simulation), GrowingSamples()
        self._ticks, self.time = 0, 0.0
        self._decide()

    @property
    def view(self) -> View:
        """What is known now."""
        return dataclasses.replace(self.behaviour.view, last=self._source.action)

    @property
    def problem(self) -> str:
        """Why what is asked for is not carried out any more; empty while it is."""
        return self._source.reason

    @property
    def fell(self) -> bool:
        """Whether the robot has fallen, or the physics diverged."""
        return self._samples.fell

    def advance(self, ticks: int) -> None:
        """Run the control loop for so many of its periods; a robot that falls ends it early."""
        for _ in range(ticks):
            for _ in range(self._loop.substeps):
                state = self._loop.step(self._command, self.simulation.timestep)
                self._watch.look(state, self._loop.estimate)
            self._ticks += 1
            self.time = round(self._ticks * self._loop.period, 9)  # rounding errors would show in `info`
            self._samples.fell = self.simulation.fallen
            self._decide()
            if self._samples.fell:
                return

    def _decide(self) -> None:
        """Take the joint command of the next period, and a sample where one is due."""
        self._command = self._loop.decide(self.time)
        if self.time >= self._samples.count * RECORD_PERIOD - 1e-9:
            moment = self._loop.moment()
            self._watch.sample(moment)
            hands = np.stack([self.simulation.hand_position(side) for side in SIDES])
            self._samples.add(self.time, moment, hands)

    def judge(self) -> Verdict:
        """Return the verdict on the episode, as if it ended now."""
        self._samples.gather()
        self._samples.problems = tuple(self.simulation.objects.problems)
        return self._task.judge(self._watch.record(self._samples, _ASKED))

    def _nearest(self, side: str) -> tuple[str, bool] | None:
        """Return the object nearest to a hand within the reach of its gripper, and whether it moves in a joint."""
        gripper = self.simulation.gripper
        if gripper is None or not self._movable:
            return None
        distance, name = min((gripper.distance(name, side), name) for name in self._movable)
        return (name, self._movable[name]) if distance <= REACH else None
