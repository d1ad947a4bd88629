"""Rollouts of one policy with many robots at once, each of which gives what a rollout by itself does."""

import dataclasses
import math
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from hugwbc import rotations
from hugwbc.controller import ControllerRows, HasBatch, JointCommand, UpperBody
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.engine.batch_record import BatchRecord
from hugwbc.robot import load_robot
from hugwbc.runtime.loop import CONTACT_FORCE, CommandSource, FollowingSource, substeps_of
from hugwbc.runtime.safety import SafetyFilter, target_limits
from hugwbc.runtime.trace import RECORD_PERIOD, SHORTEST_SWING, Trace
from hugwbc.sim.forces import Disturber, Force
from hugwbc.sim.lockstep import LockstepSimulation
from hugwbc.state import RobotState

if TYPE_CHECKING:
    from hugwbc.evaluation.moved_arms import ArmIntervention

_ANY_STATE = RobotState(np.zeros(19), np.zeros(19), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))
_MOST, _MEMORY, _SAMPLE = 2048, 2**28, 1000  # robots; bytes of all records; bytes of one sample of one robot
_ROUNDING = 1e-9  # [s], of sums of time steps


@dataclasses.dataclass(frozen=True, eq=False)
class Episode:
    """What one of the robots is to do.

    Attributes:
        source: of its commands; without hand targets.
        conditions: such that `fits` holds.
        forces: that act on it.
        arms: what moves its arms; None leaves them to the controller.
    """

    source: CommandSource
    conditions: Conditions
    forces: tuple[Force, ...] = ()
    arms: "ArmIntervention | None" = None


def fits(controller: object, conditions: Conditions) -> bool:
    """Whether rollouts of a controller under some conditions can share a batch: a policy, exact sensors, a plane."""
    exact = not conditions.noise and not conditions.latency
    return isinstance(controller, HasBatch) and conditions.is_level and exact


def most_robots(duration: float) -> int:
    """How many robots fit into a batch, for records of a quarter of a gigabyte, at most `_MOST`.

    Args:
        duration: of the episodes [s].
    """
    return max(1, min(_MOST, int(_MEMORY / (_SAMPLE * math.ceil(duration / RECORD_PERIOD)))))


def rollouts(
    controller: HasBatch,
    episodes: Sequence[Episode],
    *,
    duration: float,
    threads: int = 1,
) -> list[Trace | None]:
    """Run all episodes in step; a robot that falls is done, the others go on.

    A record has all that metrics read. `pressure_centre` is NaN, and `tick_ms` has each robot's share of the time.

    Args:
        controller: for which, with each episode's conditions, `fits` holds.
        episodes: with one time step for all.
        duration: [s].
        threads: of the physics.

    Returns:
        The record of each episode; None for one that has to run by itself, because the policy gave what is not finite.

    Raises:
        ConfigError: if the controller's period is no multiple of the time step.
        UnknownNameError: if no link has the name of a force's.
    """
    run = _BatchRun(controller, episodes, duration, threads)
    for tick in range(run.ticks):
        if not run.rows.size:
            break
        run.tick(tick)
    return run.traces()


class _BatchRun:
    """The state of all episodes under way: `rows` are the robots that are still up, in the order of the policy's."""

    def __init__(self, controller: HasBatch, episodes: Sequence[Episode], duration: float, threads: int) -> None:
        self.episodes, self.duration, self.period = episodes, duration, controller.period
        self.timestep = episodes[0].conditions.timestep
        self.substeps = substeps_of(self.period, self.timestep, controller.name)
        self.ticks = max(1, round(duration / self.period))
        self.name, self.robot, count = controller.name, load_robot(), len(episodes)
        self.filters = [SafetyFilter(controller) for _ in episodes]
        self.policy: ControllerRows = controller.for_many(count)
        self._following = {
            row: episode.source for row, episode in enumerate(episodes) if isinstance(episode.source, FollowingSource)
        }
        self.moved = np.array([episode.arms is not None for episode in episodes])
        self.simulation = LockstepSimulation(
            [episode.conditions.variation() for episode in episodes],
            *self._gains(),
            timestep=self.timestep,
            threads=threads,
        )
        self.rows = np.arange(count)
        self.broken = np.zeros(count, dtype=bool)
        self.record = BatchRecord(count, duration)
        self.touch_downs: list[tuple[list[float], list[float]]] = [([], []) for _ in episodes]
        self.last_contact = np.zeros((count, 2))
        self.tick_ms: list[float] = []
        self.steps = np.full(count, self.ticks)
        self.end = np.full(count, np.nan)  # time of a fall
        self._limits = target_limits(self.robot)
        self._schedule_forces()
        self._start()

    def _gains(self) -> tuple[np.ndarray, np.ndarray]:
        """Gains of every robot: the policy's, and the description's in arms under external control."""
        gains = []
        for own, described in ((self.policy.kp, self.robot.kp), (self.policy.kd, self.robot.kd)):
            rows = np.tile(own, (len(self.episodes), 1))
            rows[np.ix_(self.moved, self.robot.arms)] = described[self.robot.arms]
            gains.append(rows)
        return gains[0], gains[1]

    def _schedule_forces(self) -> None:
        """Find the physics steps at which a robot's forces change."""
        model, dt = self.simulation.model, self.timestep
        times = (np.arange(self.ticks)[:, None] * self.period + np.arange(self.substeps) * dt).ravel()
        self._changes: dict[int, list[int]] = {}
        self._disturbers: dict[int, Disturber] = {}
        for row, episode in enumerate(self.episodes):
            if not episode.forces:
                continue
            self._disturbers[row] = Disturber(model, episode.forces)
            ends = [force.start + force.duration for force in episode.forces if force.duration is not None]
            for moment in [*(force.start for force in episode.forces), *ends]:
                step = int(np.searchsorted(times, moment - _ROUNDING))
                self._changes.setdefault(step, []).append(row)

    def _start(self) -> None:
        self.policy.reset()
        self._push()
        for episode in self.episodes:
            if episode.arms is not None:
                episode.arms.reset()

    def _push(self) -> None:
        simulation, rows = self.simulation, self.rows
        gravity = rotations.rotate_inverse(
            simulation.orientation(rows), np.broadcast_to([0.0, 0.0, -1.0], (rows.size, 3))
        )
        qpos, qvel = simulation.qpos[rows], simulation.qvel[rows]
        self.policy.push(qvel[:, 3:6], gravity, qpos[:, 7:], qvel[:, 6:])

    def tick(self, tick: int) -> None:
        """One control period of all robots that are up."""
        t = tick * self.period
        begin = time.perf_counter()
        self._push()
        q, dq = self._decide(t)
        self.tick_ms.append(1e3 * (time.perf_counter() - begin) / self.rows.size)
        if self.broken[self.rows].any():
            good = ~self.broken[self.rows]
            self._keep(good)
            q, dq = q[good], dq[good]
            if not self.rows.size:
                return
        if self.record.due(t):
            commands = [self.filters[row].command for row in self.rows]
            self.record.sample(t, self.simulation, self.rows, commands, phase=self.policy.phase, target=q)
        self.simulation.command(self.rows, q, dq)
        for substep in range(self.substeps):
            self._disturb(tick * self.substeps + substep, t + substep * self.timestep)
            self.simulation.step(self.rows)
            self._note_touch_downs(t + (substep + 1) * self.timestep)
        fallen = self.simulation.fallen(self.rows)
        self.end[self.rows[fallen]], self.steps[self.rows[fallen]] = t, tick + 1
        if fallen.any():
            self._keep(~fallen)

    def _keep(self, chosen: np.ndarray) -> None:
        self.rows = self.rows[chosen]
        self.policy.keep(chosen)

    def _decide(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Position and velocity targets of the joints, within the limits, shapes (m, 19)."""
        rows = self.rows
        commands, gaits = np.empty((rows.size, 8)), np.empty(rows.size, dtype=int)
        arms = np.zeros((2, rows.size, 8))  # position and velocity targets
        for place, row in enumerate(rows.tolist()):
            episode, upper_body = self.episodes[row], UpperBody.none()
            if row in self._following:
                self._following[row].follow(self._state(row))
            command = episode.source.command_at(t)
            if episode.arms is not None:
                upper_body, command = episode.arms.update(_ANY_STATE, None, command, self.period)
            command, upper_body = self.filters[row].admit(command, upper_body)
            commands[place], gaits[place] = command.array(), int(command.gait)
            arms[:, place] = upper_body.q, upper_body.dq
        moved = self.moved[rows]
        q, dq = self.policy.decide(commands, gaits, moved), np.zeros((rows.size, 19))
        self.broken[rows] = ~np.isfinite(q).all(axis=1)
        for targets, values in ((q, arms[0]), (dq, arms[1])):
            targets[np.ix_(moved, self.robot.arms)] = values[moved]
        limited = np.clip(q, *self._limits)
        for place in np.flatnonzero((limited != q).any(axis=1) & ~self.broken[rows]):
            self.filters[rows[place]].limited(JointCommand.position(self.robot, q[place]))  # counts it
        return limited, dq

    def _state(self, row: int) -> RobotState:
        """The true state of one robot."""
        one, qpos, qvel = np.array([row]), self.simulation.qpos[row], self.simulation.qvel[row]
        return RobotState(
            q=qpos[7:].copy(),
            dq=qvel[6:].copy(),
            orientation=self.simulation.orientation(one)[0],
            angular_velocity=qvel[3:6].copy(),
            position=qpos[:3].copy(),
            velocity=qvel[:3].copy(),
            foot_force=self.simulation.foot_force(one)[0],
        )

    def _disturb(self, step: int, t: float) -> None:
        for row in self._changes.get(step, ()):
            self._disturbers[row].update(t, self.simulation.qpos[row], self.simulation.forces[row])

    def _note_touch_downs(self, now: float) -> None:
        contact = self.simulation.foot_force(self.rows)[..., 2] > CONTACT_FORCE
        for place, foot in np.argwhere(contact & (now - self.last_contact[self.rows] > SHORTEST_SWING)).tolist():
            self.touch_downs[self.rows[place]][foot].append(now)
        self.last_contact[self.rows] = np.where(contact, now, self.last_contact[self.rows])

    def traces(self) -> list[Trace | None]:
        """The records, once all episodes are over."""
        return [None if self.broken[row] else self._trace(row) for row in range(len(self.episodes))]

    def _trace(self, row: int) -> Trace:
        left, right = (np.array(times) for times in self.touch_downs[row])
        fell, steps = bool(np.isfinite(self.end[row])), int(self.steps[row])
        return Trace(
            name=self.name,
            **self.record.of(row),
            tick_ms=np.array(self.tick_ms[:steps]),
            ik_ms=np.zeros(0),
            touch_downs=(left, right),
            fell=fell,
            survived_s=float(self.end[row]) if fell else self.duration,
            steps=steps,
            safety=self.filters[row].report(),
        )
