"""Rollouts of one policy with many robots in step; each robot moves exactly as in a rollout by itself."""

import dataclasses
import math
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hugwbc import rotations
from hugwbc.arm_servo import ArmServo
from hugwbc.commands import Command
from hugwbc.controller import ControllerRows, HasBatch, JointCommand, UpperBody
from hugwbc.evaluation.conditions import Conditions
from hugwbc.robot import load_robot
from hugwbc.runtime.loop import substeps_of
from hugwbc.runtime.safety import SafetyFilter, target_limits
from hugwbc.runtime.trace import CONTACT_FORCE, RECORD_PERIOD, TouchDownWatch, Trace
from hugwbc.scripts.command_source import CommandSource, FollowingSource
from hugwbc.sim.forces import Disturber, Force
from hugwbc.sim.ground import Ground
from hugwbc.sim.lockstep import LockstepSimulation
from hugwbc.sim.robot_model import link_names
from hugwbc.sim.simulation import Simulation
from hugwbc.state import RobotState

if TYPE_CHECKING:
    from hugwbc.evaluation.moved_arms import ArmIntervention

_ANY_STATE = RobotState(np.zeros(19), np.zeros(19), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))
_MOST, _MEMORY, _SAMPLE = 2048, 2**28, 1000  # robots; bytes of all records; bytes of one sample of one robot
_ROUNDING = 1e-9  # [s], of sums of time steps


@dataclasses.dataclass(frozen=True, eq=False)
class BatchMember:
    """The task of one robot of a batch.

    Attributes:
        source: source of its commands; its hand targets are not used.
        conditions: conditions for which `fits` holds.
        forces: external forces on the robot.
        arms: what moves its arms; None leaves them to the controller.
    """

    source: CommandSource
    conditions: Conditions
    forces: tuple[Force, ...] = ()
    arms: "ArmIntervention | None" = None


def fits(controller: object, conditions: Conditions) -> bool:
    """Return whether rollouts can share a batch: a policy, MuJoCo, exact sensors, a plane, empty hands."""
    exact = not (conditions.chosen.estimates or conditions.latency or conditions.faults)
    alike = conditions.engine == Simulation.engine and conditions.is_level and not conditions.hand_payload
    return isinstance(controller, HasBatch) and alike and exact


def most_robots(duration: float) -> int:
    """Return how many robots fit into a batch: `_MOST`, or fewer so that the records take a quarter of a gigabyte.

    Args:
        duration: duration of the episodes [s].
    """
    return max(1, min(_MOST, int(_MEMORY / (_SAMPLE * math.ceil(duration / RECORD_PERIOD)))))


def batch_rollout(
    controller: HasBatch,
    members: Sequence[BatchMember],
    *,
    duration: float,
    threads: int = 1,
) -> list[Trace | None]:
    """Run all members in step; a robot that falls is done, the others continue.

    A trace has everything that the metrics read. Its `pressure_centre` is NaN, and `tick_ms` is each robot's share of
    the computing time.

    Args:
        controller: a controller for which, with each member's conditions, `fits` holds.
        members: one for each robot, all with the same physics time step and arena.
        duration: duration of the episodes [s].
        threads: threads of the physics.

    Returns:
        The trace of each member; None where the policy's output was not finite. Such an episode has to run by itself,
        where the safety filter falls back to the last good command.

    Raises:
        ConfigError: if the controller's period is not a multiple of the time step.
        UnknownNameError: if a force acts on a link that does not exist.
    """
    run = _BatchRun(controller, members, duration, threads)
    for tick in range(run.ticks):
        if not run.rows.size:
            break
        run.tick(tick)
    return run.traces()


class _BatchRun:
    """The state of a batch.

    `rows` are the indices of the robots that are still up, in the order of the policy's rows.
    """

    def __init__(self, controller: HasBatch, members: Sequence[BatchMember], duration: float, threads: int) -> None:
        self.members, self.duration, self.period = members, duration, controller.period
        self.timestep, self.arena = members[0].conditions.timestep, members[0].conditions.chosen
        self.substeps = substeps_of(self.period, self.timestep, controller.name)
        self.ticks = max(1, round(duration / self.period))
        self.name, self.robot, count = controller.name, load_robot(self.arena.robot), len(members)
        known = self.arena.actuators.known_robot(self.robot)  # with the friction of its drives, for the arms' servo
        self.filters = [SafetyFilter(controller, robot=known) for _ in members]
        self.policy: ControllerRows = controller.for_many(count)
        self._following = {
            row: member.source for row, member in enumerate(members) if isinstance(member.source, FollowingSource)
        }
        self.moved = np.array([member.arms is not None for member in members])
        self.simulation = LockstepSimulation(
            [member.conditions.variation() for member in members],
            *self._gains(),
            timestep=self.timestep,
            threads=threads,
            robot=self.robot,
            actuators=self.arena.actuators,
            ground=Ground.named(self.arena.ground),
        )
        self.rows = np.arange(count)
        self.broken = np.zeros(count, dtype=bool)  # whose policy output was not finite
        self.record = BatchRecord(count, duration)
        self.watch = TouchDownWatch(count, self.timestep)
        self.tick_ms: list[float] = []
        self.steps = np.full(count, self.ticks)
        self.end = np.full(count, np.nan)  # time of a fall
        self._limits = target_limits(self.robot)
        self._schedule_forces()
        self._start()

    def _gains(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the gains of every robot: the policy's, and the servo's in arms under external control."""
        servo, gains = ArmServo(robot=self.robot), []
        for own, arms in ((self.policy.kp, servo.kp), (self.policy.kd, servo.kd)):
            rows = np.tile(own, (len(self.members), 1))
            rows[np.ix_(self.moved, self.robot.arms)] = arms
            gains.append(rows)
        return gains[0], gains[1]

    def _schedule_forces(self) -> None:
        """Find the physics steps at which a robot's forces change.

        Looking only at these steps spares a Python call for every robot and step.
        """
        names, dt = link_names(self.simulation.model), self.timestep
        times = (np.arange(self.ticks)[:, None] * self.period + np.arange(self.substeps) * dt).ravel()
        self._changes: dict[int, list[int]] = {}
        self._disturbers: dict[int, Disturber] = {}
        for row, member in enumerate(self.members):
            if not member.forces:
                continue
            self._disturbers[row] = Disturber(names, member.forces)
            ends = [force.start + force.duration for force in member.forces if force.duration is not None]
            for moment in [*(force.start for force in member.forces), *ends]:
                step = int(np.searchsorted(times, moment - _ROUNDING))
                self._changes.setdefault(step, []).append(row)

    def _start(self) -> None:
        self.policy.reset()
        # A rollout by itself shows the policy its first state on reset and again in the first control step.
        self._push()
        for member in self.members:
            if member.arms is not None:
                member.arms.reset()

    def _push(self) -> None:
        simulation, rows = self.simulation, self.rows
        gravity = rotations.rotate_inverse(
            simulation.orientation(rows), np.broadcast_to([0.0, 0.0, -1.0], (rows.size, 3))
        )
        qpos, qvel = simulation.qpos[rows], simulation.qvel[rows]
        self.policy.push(qvel[:, 3:6], gravity, qpos[:, 7:], qvel[:, 6:])

    def tick(self, tick: int) -> None:
        """Run one control period of all robots that are up."""
        t = tick * self.period
        begin = time.perf_counter()
        self._push()
        q, dq, tau = self._decide(t)
        self.tick_ms.append(1e3 * (time.perf_counter() - begin) / self.rows.size)
        if self.broken[self.rows].any():
            good = ~self.broken[self.rows]
            self._keep(good)
            q, dq, tau = q[good], dq[good], tau[good]
            if not self.rows.size:
                return
        if self.record.due(t):
            commands = [self.filters[row].command for row in self.rows]
            self.record.sample(t, self.simulation, self.rows, commands, phase=self.policy.phase, target=q)
        self.simulation.command(self.rows, q, dq, tau)
        for substep in range(self.substeps):
            self._disturb(tick * self.substeps + substep, t + substep * self.timestep)
            self.simulation.step(self.rows)
            force, velocity = self.simulation.foot_force(self.rows), self.simulation.sole_velocity(self.rows)
            self.watch.update(self.rows, t + (substep + 1) * self.timestep, force, velocity)
        fallen = self.simulation.fallen(self.rows)
        self.end[self.rows[fallen]], self.steps[self.rows[fallen]] = t, tick + 1
        if fallen.any():
            self._keep(~fallen)

    def _keep(self, chosen: np.ndarray) -> None:
        self.rows = self.rows[chosen]
        self.policy.keep(chosen)

    def _decide(self, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return position targets, velocity targets and torques of the joints within the limits, shapes (m, 19)."""
        rows = self.rows
        commands, gaits = np.empty((rows.size, 8)), np.empty(rows.size, dtype=int)
        arms = np.zeros((3, rows.size, 8))  # position targets, velocity targets and torques
        for place, row in enumerate(rows.tolist()):
            member, upper_body = self.members[row], UpperBody.none()
            if row in self._following:
                self._following[row].follow(self._state(row))
            command = member.source.command_at(t)
            if member.arms is not None:
                upper_body, command = member.arms.update(_ANY_STATE, None, command, self.period)
            command, upper_body = self.filters[row].admit(command, upper_body)
            if upper_body.indicator:
                upper_body = self.filters[row].driven(upper_body, self.simulation.sensed(row))
            commands[place], gaits[place] = command.array(), int(command.gait)
            arms[:, place] = upper_body.q, upper_body.dq, upper_body.tau
        moved = self.moved[rows]
        q, (dq, tau) = self.policy.decide(commands, gaits, moved), np.zeros((2, rows.size, 19))
        self.broken[rows] = ~np.isfinite(q).all(axis=1)
        for targets, values in zip((q, dq, tau), arms, strict=True):
            targets[np.ix_(moved, self.robot.arms)] = values[moved]
        limited = np.clip(q, *self._limits)
        slower = np.clip(dq, -self.robot.velocity_limit, self.robot.velocity_limit)
        for place in np.flatnonzero(((limited != q) | (slower != dq)).any(axis=1) & ~self.broken[rows]):
            beyond = JointCommand(q[place], dq[place], self.robot.kp, self.robot.kd, tau[place])
            self.filters[rows[place]].limited(beyond)  # counts it
        return limited, slower, tau

    def _state(self, row: int) -> RobotState:
        """Return the true state of one robot."""
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

    def traces(self) -> list[Trace | None]:
        """Return the traces once all episodes are over."""
        return [None if self.broken[row] else self._trace(row) for row in range(len(self.members))]

    def _trace(self, row: int) -> Trace:
        landed = self.watch.of(row)
        fell, steps = bool(np.isfinite(self.end[row])), int(self.steps[row])
        return Trace(
            name=self.name,
            **self.record.of(row),
            tick_ms=np.array(self.tick_ms[:steps]),
            ik_ms=np.zeros(0),
            touch_downs=landed.times,
            touch_down_velocity=landed.velocity,
            stance_peak=landed.peak,
            mass=self.simulation.robot.mass,
            fell=fell,
            survived_s=float(self.end[row]) if fell else self.duration,
            steps=steps,
            robot=self.robot.name,
            safety=self.filters[row].report(),
        )


class BatchRecord:
    """Samples of all robots of a batch, as a `Trace` has them of one; a robot that is done has no further samples."""

    def __init__(self, count: int, duration: float) -> None:
        """Allocate the arrays.

        Args:
            count: number of robots.
            duration: duration of the longest run [s].
        """
        samples = math.ceil(duration / RECORD_PERIOD) + 1
        shapes = {
            "command": (8,), "gait": (), "measured": (6,), "clearance": (2,), "phase": (), "foot_contact": (2,),
            "foot_force": (2, 3), "qpos": (26,), "qvel": (25,), "target": (19,), "torque": (19,),
        }  # fmt: skip
        kinds = {"gait": int, "foot_contact": bool}
        self.arrays = {
            name: np.empty((samples, count, *shape), kinds.get(name, float)) for name, shape in shapes.items()
        }
        self.times: list[float] = []
        self.lengths = np.zeros(count, dtype=int)

    def due(self, t: float) -> bool:
        """Return whether the next sample is due at time t [s]."""
        return t >= len(self.times) * RECORD_PERIOD - 1e-9

    def sample(
        self, t: float, simulation: LockstepSimulation, rows: np.ndarray, commands: list[Command], **others: np.ndarray
    ) -> None:
        """Add one sample of the robots that are up.

        Args:
            t: time [s].
            simulation: simulation of all robots.
            rows: indices of the robots that are up, shape (m,).
            commands: the command of each of them, clamped.
            others: `phase` (m,) and `target` (m, 19), see `Trace`.
        """
        force = simulation.foot_force(rows)
        values = {
            "command": [command.array() for command in commands],
            "gait": [int(command.gait) for command in commands],
            "measured": _measured(simulation, rows),
            "clearance": simulation.sole_height(rows),
            "foot_contact": force[..., 2] > CONTACT_FORCE,
            "foot_force": force,
            "qpos": simulation.qpos[rows],
            "qvel": simulation.qvel[rows],
            "torque": simulation.torque[rows],
            **others,
        }
        for name, value in values.items():
            self.arrays[name][len(self.times), rows] = value
        self.times.append(t)
        self.lengths[rows] = len(self.times)

    def of(self, row: int) -> dict[str, Any]:
        """Return the sampled fields of one robot's trace; fields that a batch does not have are NaN."""
        count = self.lengths[row]
        nothing = {"pressure_centre": (2, 3), "foothold": (2, 2), "hand_target_world": (2, 3), "arm_target": (8,)}
        return {
            "time": np.array(self.times[:count]),
            **{name: array[:count, row] for name, array in self.arrays.items()},
            **{name: np.broadcast_to(np.nan, (count, *shape)) for name, shape in nothing.items()},
            "hand_error": np.broadcast_to(np.nan, (count, 2)),
            "reachable": np.broadcast_to(False, (count, 2)),
        }


def _measured(simulation: LockstepSimulation, rows: np.ndarray) -> np.ndarray:
    """Return `MEASURED_NAMES` of some robots as `Kinematics.measured` does of one, shape (m, 6)."""
    robot = simulation.robot
    qpos, qvel, orientation = simulation.qpos[rows], simulation.qvel[rows], simulation.orientation(rows)
    yaw = rotations.yaw_of(orientation)
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.stack(
        (
            # MuJoCo's linear velocity of the base is in the world, its angular velocity in the pelvis frame.
            cos * qvel[:, 0] + sin * qvel[:, 1],
            cos * qvel[:, 1] - sin * qvel[:, 0],
            rotations.rotate(orientation, qvel[:, 3:6])[:, 2],
            qpos[:, 2] - robot.nominal_height,
            rotations.pitch_of(orientation),
            qpos[:, 7 + robot.waist],
        ),
        axis=1,
    )
