"""One run of a controller in simulation and its record."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from hugwbc.commands import MEASURED_NAMES, Command
from hugwbc.controller import Controller, JointCommand
from hugwbc.errors import ConfigError
from hugwbc.kinematics import Kinematics
from hugwbc.robot import SIDES
from hugwbc.runtime.estimation import StateEstimator
from hugwbc.runtime.loop import ControlLoop
from hugwbc.runtime.trace import RECORD_PERIOD, SCENE_FIELDS, SNAPSHOT_FIELDS, Snapshot, TouchDownWatch, Trace
from hugwbc.scripts.view import CommandSource
from hugwbc.sim import Disturber, Engine, Force
from hugwbc.state import RobotState
from hugwbc.upper_ik import UpperBodySource


def rollout(
    controller: Controller | str,
    source: CommandSource | Command,
    simulation: Engine,
    upper_body: UpperBodySource | None = None,
    *,
    duration: float,
    estimator: StateEstimator | None = None,
    forces: Sequence[Force] = (),
    on_progress: Callable[[float], None] | None = None,
    on_snapshot: Callable[[Snapshot], None] | None = None,
    on_step: Callable[[RobotState, RobotState], None] | None = None,
    until: Callable[[], bool] | None = None,
    past_falls: bool = False,
    strict: bool = True,
) -> Trace:
    """Return the record of a run from a standing start until the robot falls or the time is over.

    The loop runs at the controller's period and the physics at its own time step; a sample is recorded every
    `RECORD_PERIOD`. The controller reads the estimated state; the record holds the true one.

    Args:
        controller: any object with the members of `Controller`, or what `load_controller` takes.
        source: gives commands and hand targets over time; or one command for all times.
        simulation: the robot; it is reset to the nominal stand at the origin.
        upper_body: turns hand targets into arm targets (`UpperBodySource`); without it, a warning says that they are
            ignored.
        duration: length of the run [s].
        estimator: estimates the state from the sensors; None for one that knows the simulated robot, or for none where
            the sensors tell the state.
        forces: external forces on the robot.
        on_progress: called with the fraction done, about fifty times per simulated second.
        on_snapshot: called at each sample of the record, with the state that pictures show.
        on_step: called after each physics step, with the true state and the controller's state.
        until: called after each control period; the run ends early where it returns True, such as when a behaviour has
            ended (`BehaviourSource.done`).
        past_falls: whether the run continues after a fall.
        strict: whether a mistake in the code of the controller or of a source ends the run with a `ConfigError`: what
            it raises, and what is no joint command, command or target. Otherwise it is counted in `Trace.safety`, as on
            a robot.

    Raises:
        ConfigError: if the duration is not above 0 s and finite, or the parts do not fit each other.
    """
    if not 0.0 < duration < np.inf:
        raise ConfigError(f"duration is {duration} s; give a finite time above 0 s")
    loop = ControlLoop(controller, source, simulation, upper_body, estimator)
    loop.control.log.strict = strict
    disturber = Disturber(simulation.link_names, simulation.robot.trunk, forces) if forces else None
    recorder = Recorder(loop, disturber, on_step, on_snapshot)
    loop.reset()
    fell_s = None
    ticks = max(1, round(duration / loop.period))
    for tick in range(ticks):
        t = tick * loop.period
        joint_command = loop.decide(t)
        if (tick_s := loop.control.guard.last_tick_s) > 0.0:
            recorder.tick_ms.append(tick_s * 1e3)
        if upper_body is not None:
            recorder.ik_ms.append(loop.control.ik_s * 1e3)
        if on_progress is not None and recorder.due(t):
            on_progress(tick / ticks)
        fell = recorder.advance(joint_command, t, past_falls=past_falls)
        fell_s = fell if fell_s is None else fell_s
        if fell_s is not None and not past_falls:
            return recorder.trace(fell_s, t, steps=tick + 1)
        if until is not None and until():
            return recorder.trace(fell_s, t + loop.period, steps=tick + 1)
    return recorder.trace(fell_s, duration, steps=ticks)


class Recorder:
    """A collector of the samples of one run, which watches the feet at every physics step."""

    def __init__(
        self,
        loop: ControlLoop,
        disturber: Disturber | None,
        on_step: Callable[[RobotState, RobotState], None] | None,
        on_snapshot: Callable[[Snapshot], object] | None,
    ) -> None:
        self.loop = loop
        self.on_step = on_step
        self.on_snapshot = on_snapshot
        self.disturber = disturber
        self.simulation = loop.simulation
        self.kinematics = Kinematics(self.simulation.robot)
        self.rows: list[dict[str, Any]] = []
        self.tick_ms: list[float] = []
        self.ik_ms: list[float] = []
        self._watch = TouchDownWatch(self.simulation.timestep)
        self._samples = 0
        self._power, self._steps = 0.0, 0  # sum over the physics steps since the last sample [W], and their number
        left_out = SCENE_FIELDS if self.simulation.scene is None else ()
        self._snapshot_fields = [name for name in SNAPSHOT_FIELDS if name not in left_out]

    def due(self, t: float) -> bool:
        """Return whether the next sample is due at time t [s]."""
        return t >= self._samples * RECORD_PERIOD - 1e-9

    def advance(self, command: JointCommand, t: float, *, past_falls: bool) -> float | None:
        """Step the physics through one control period, or to a fall if it ends the run, and note touch-downs.

        Samples and falls are taken at the physics steps at which they are due, whatever the control period is.

        Returns:
            When the robot fell [s]; None if it is up.
        """
        dt, simulation, fell_s = self.simulation.timestep, self.simulation, None
        for substep in range(self.loop.substeps):
            if self.due(t + substep * dt):
                snapshot = self.sample(t + substep * dt, command)
                if self.on_snapshot is not None:
                    self.on_snapshot(snapshot)
            if self.disturber is not None:
                self.disturber.update(t + substep * dt, simulation.qpos, simulation.external_force)
            self.loop.step_physics(command)
            self._power += float(np.abs(simulation.torque) @ np.abs(simulation.qvel[6:]))
            self._steps += 1
            if self.on_step is not None:
                self.on_step(simulation.state(), self.loop.control.estimate)
            self._watch.update(t + (substep + 1) * dt, simulation.foot_force, simulation.sole_velocity)
            if fell_s is None and simulation.fallen:
                fell_s = t + (substep + 1) * dt
                if not past_falls:
                    break
        return fell_s

    def sample(self, t: float, command: JointCommand) -> Snapshot:
        """Add a sample at time t [s]; return the part of it that a picture shows."""
        self._samples += 1
        state = self.simulation.state()
        self.kinematics.update(state)
        assert state.position is not None
        left, right = (self.simulation.ground_height(self.kinematics.position(f"{side}_sole")[:2]) for side in SIDES)
        measured = self.kinematics.measured(self.simulation.ground_height(state.position[:2]), (left, right))
        snapshot = self.loop.snapshot()
        actual = np.stack([self.simulation.hand_position(side) for side in SIDES])
        self.rows.append(
            {
                "time": t,
                "command": self.loop.control.chain.command.array(),
                "measured": [getattr(measured, name) for name in MEASURED_NAMES],
                "clearance": measured.clearance,
                **{name: getattr(snapshot, name) for name in self._snapshot_fields},
                "qvel": self.simulation.qvel,
                "target": command.q.copy(),
                "hand_error": np.linalg.norm(actual - snapshot.hand_target_world, axis=1),
                "reachable": self.loop.reachable,
                "torque": self.simulation.torque,
                "power": self._power / max(1, self._steps),
            }
        )
        self._power, self._steps = 0.0, 0
        return snapshot

    def trace(self, fell_s: float | None, end: float, *, steps: int) -> Trace:
        """Return the record of the run, with the time of the first fall, if any, and of the end [s]."""
        return Trace(
            name=self.loop.control.guard.name,
            **{name: np.array([row[name] for row in self.rows]) for name in self.rows[0]},
            tick_ms=np.array(self.tick_ms),
            ik_ms=np.array(self.ik_ms),
            **self._watch.record(),
            mass=self.simulation.robot.mass,
            fell=fell_s is not None,
            survived_s=end if fell_s is None else fell_s,
            steps=steps,
            safety=self.loop.control.log.report(),
            robot=self.simulation.robot.name,
            scene=self.simulation.scene,
            problems=tuple(self.simulation.objects.problems),
        )
