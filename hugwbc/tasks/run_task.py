"""Run one episode of a task with any controller."""

import dataclasses
import math
from collections.abc import Callable

from hugwbc.behaviours import Behaviour, BehaviourSource, Status
from hugwbc.controller import Controller
from hugwbc.errors import ConfigError
from hugwbc.runtime.estimation import StateEstimator
from hugwbc.runtime.rollout import rollout
from hugwbc.runtime.trace import Snapshot, Trace
from hugwbc.sim import Simulation
from hugwbc.tasks.record import Ending, TaskRecord, TaskWatch
from hugwbc.tasks.task import Task
from hugwbc.tasks.verdict import Verdict
from hugwbc.upper_ik import UpperBodySource

AFTERWARDS = 1.0  # [s] after the behaviour has ended, in which things may still tip over


@dataclasses.dataclass(frozen=True, eq=False)
class TaskRun:
    """One episode of a task.

    Attributes:
        trace: record of the rollout.
        record: what the judge looked at.
        verdict: the verdict.
    """

    trace: Trace
    record: TaskRecord
    verdict: Verdict

    @property
    def seconds(self) -> float | None:
        """When the behaviour ended [s]; if it did not, when the episode ended in a success, and None in a failure."""
        ended = self.record.ending.time
        return self.trace.survived_s if ended is None and self.verdict.success else ended


def run_task(
    task: Task,
    controller: Controller,
    simulation: Simulation,
    estimator: StateEstimator | None = None,
    upper_body: UpperBodySource | None = None,
    *,
    behaviour: Behaviour | None = None,
    on_progress: Callable[[float], None] | None = None,
    on_snapshot: Callable[[Snapshot], None] | None = None,
    stop: Callable[[], bool] = lambda: False,
    strict: bool = True,
) -> TaskRun:
    """Run one episode, until a second after the end of the behaviour, a fall, the time limit or a stop.

    Args:
        task: the task.
        controller: any object with the members of `Controller`.
        simulation: a robot among the objects of the task's scene: `Simulation(scene=task.scene, seed=seed)`.
        estimator: estimates the state from the sensors; None for the default of `ControlLoop`.
        upper_body: turns hand targets into arm targets; None for one that knows the simulated robot.
        behaviour: acts in place of the task's own; in the lengths of the simulated robot.
        on_progress: called with the fraction of the time limit.
        on_snapshot: called at each sample, with the state that pictures show.
        stop: whether to end the episode now.
        strict: whether what the controller raises ends the episode (`rollout`).
    """
    if simulation.scene is None:
        raise ConfigError(f"task '{task.name}' needs objects; give the simulation scene=task.scene")
    if task.size != (size := task.sized(simulation.known_robot).size):
        raise ConfigError(
            f"task '{task.name}' has size {task.size:.2f}, but {size:.2f} for {simulation.robot.name}; give task.sized("
            "robot) and the simulation its scene, or name the robot in the scene if that is made for it"
        )
    source = BehaviourSource(behaviour or task.behaviour_in(simulation.scene))
    watch, ended, stopped = TaskWatch(simulation), math.inf, False

    def sample(snapshot: Snapshot) -> None:
        watch.sample(simulation.time, snapshot.gait)
        if simulation.time == 0.0:
            task.check(watch.record(Ending(False)))
        if on_snapshot is not None:
            on_snapshot(snapshot)

    def over() -> bool:
        nonlocal ended, stopped
        if source.status is not Status.RUNNING:
            ended = min(ended, simulation.time)
        stopped = stop()
        return stopped or simulation.time >= ended + AFTERWARDS

    trace = rollout(
        controller,
        source,
        simulation,
        upper_body or UpperBodySource(robot=simulation.known_robot),
        duration=task.limit,
        estimator=estimator,
        on_progress=on_progress,
        on_snapshot=sample,
        on_step=lambda state, estimate: watch.look(),
        until=over,
        strict=strict,
    )
    # A fall in the period in which the behaviour ended comes before `over`.
    why = "" if trace.fell else "it was stopped " if stopped else "the time was over "
    ending = _ending(source, min(ended, simulation.time), why)
    record = dataclasses.replace(watch.record(ending), fell=trace.down)
    return TaskRun(trace, record, task.judge(record))


def _ending(source: BehaviourSource, time: float, why: str) -> Ending:
    if source.status is Status.RUNNING:
        return Ending(False, f"{why}during {source.doing}")
    return Ending(source.status is Status.SUCCESS, source.reason, time)
