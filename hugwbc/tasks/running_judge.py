"""Judge an episode while it runs, whoever controls it."""

import dataclasses

import numpy as np

from hugwbc.robot import SIDES
from hugwbc.runtime.trace import RECORD_PERIOD
from hugwbc.sim import Simulation
from hugwbc.tasks.record import Ending, TaskWatch
from hugwbc.tasks.task import Task
from hugwbc.tasks.verdict import Verdict

_FIELDS = ("time", "qpos", "hand_force", "hand_error", "object_pose")
_ROUNDING = 1e-9  # [s]


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

    def add(self, **values: np.ndarray) -> None:
        """Add one sample of each field."""
        for name in _FIELDS:
            self._new[name].append(values[name])

    def gather(self) -> None:
        """Append what has been added to the arrays: once for many samples, since it copies them."""
        for name, values in self._new.items():
            if values:
                before, new = getattr(self, name), np.stack(values)
                setattr(self, name, new if not len(before) else np.concatenate((before, new)))
                values.clear()


class RunningJudge:
    """Watches a simulation, with any controller, and judges its progress.

    Call `look` after each physics step, and `sample` at least every `RECORD_PERIOD`.
    """

    def __init__(self, task: Task, simulation: Simulation) -> None:
        """Begin to watch.

        Args:
            task: gives the judge.
            simulation: a robot among the objects of the task's scene.
        """
        self._task, self._simulation = task, simulation
        self._watch, self._samples = TaskWatch(simulation), GrowingSamples()

    @property
    def fell(self) -> bool:
        """Whether the robot has fallen, or the physics diverged."""
        return self._samples.fell

    def look(self) -> None:
        """Note contacts and falls after a physics step."""
        self._watch.look()
        self._samples.fell = self._samples.fell or self._simulation.fallen

    def sample(self, time: float, hand_targets: np.ndarray | None = None) -> None:
        """Take a sample, if one is due.

        Args:
            time: since the start of the episode [s].
            hand_targets: targets of both hands in the world [m], shape (2, 3), NaN for none; None if nobody tells.
        """
        if time < self._samples.count * RECORD_PERIOD - _ROUNDING:
            return
        simulation = self._simulation
        self._watch.sample()
        hands = np.stack([simulation.hand_position(side) for side in SIDES])
        force = simulation.state().hand_force
        self._samples.add(
            time=np.array(time),
            qpos=simulation.qpos,
            hand_force=np.zeros((2, 3)) if force is None else force.copy(),
            hand_error=np.full(2, np.nan) if hand_targets is None else np.linalg.norm(hands - hand_targets, axis=1),
            object_pose=simulation.objects.poses,
        )

    def verdict(self, ending: Ending) -> Verdict:
        """Return the verdict on the episode, as if it ended now."""
        self._samples.gather()
        self._samples.problems = tuple(self._simulation.objects.problems)
        return self._task.judge(self._watch.record(self._samples, ending))
