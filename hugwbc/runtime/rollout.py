"""One run of a controller in simulation, and the record of it that metrics, plots and replays read."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from hugwbc.controller import Controller, JointCommand
from hugwbc.errors import ConfigError
from hugwbc.kinematics import MEASURED_NAMES, Kinematics
from hugwbc.robot import SIDES
from hugwbc.runtime.estimation import StateEstimator
from hugwbc.runtime.loop import CommandSource, ControlLoop, UpperBodySource, foot_contacts
from hugwbc.runtime.moment import MOMENT_FIELDS
from hugwbc.runtime.safety import SafetyReport
from hugwbc.sim import Disturber, Force, Simulation

RECORD_PERIOD = 0.02  # [s]
SHORTEST_SWING = 0.05  # [s]; a foot that leaves the ground for less has bounced, not stepped


@dataclasses.dataclass(frozen=True, eq=False)
class Trace:
    """What happened in one run, sampled every `RECORD_PERIOD`: T samples.

    Attributes:
        name: of the controller.
        time: [s], shape (T,).
        command: the eight commands as asked for, clamped to their ranges, order of COMMAND_NAMES, shape (T, 8);
            h, p and w as hand targets need them that ask for the whole body. What the guard (`runtime.feasibility`)
            changes on the way to the controller counts as an error.
        gait: values of `Gait`, shape (T,).
        measured: v_x, v_y, omega, h, p, w as executed (see `kinematics.Measured`), shape (T, 6).
        clearance: height of the left and right sole above the ground [m], shape (T, 2).
        phase: common phase of the gait in [0, 1), NaN for a controller that keeps none, shape (T,).
        foot_contact: whether each foot is on the ground, shape (T, 2), bool.
        foot_force: ground reaction on each foot, world frame [N], shape (T, 2, 3).
        pressure_centre: where it acts [m]; NaN for a foot in the air; shape (T, 2, 3).
        foothold: where the controller plans to put each sole next, x and y [m]; NaN where it has no plan; (T, 2, 2).
        qpos: pelvis position, quaternion (w, x, y, z) and joint positions, shape (T, 26).
        qvel: pelvis velocity [m/s], its angular velocity in its own frame and joint velocities [rad/s], shape (T, 25).
        target: joint position targets that the controller gave at this time [rad], shape (T, 19).
        hand_target_world: targets of both hands [m]; NaN where there is none; shape (T, 2, 3).
        arm_target: arm positions that the inverse kinematics wants [rad]; NaN where it does not move them; (T, 8).
        hand_error: distance of each hand to its target, reachable or not [m]; NaN where there is none; shape (T, 2).
        reachable: whether the inverse kinematics calls each hand's target reachable, shape (T, 2), bool.
        torque: joint torques of the physics step before this time [N*m], shape (T, 19).
        tick_ms: time that each call of the controller took [ms], shape (number of calls,).
        ik_ms: time that each call of the upper-body source took [ms], shape (number of calls,).
        touch_downs: times at which the left and the right foot came down after a swing of at least `SHORTEST_SWING`,
            at the resolution of the physics [s].
        fell: whether the robot fell, or the physics diverged.
        survived_s: time until then, or the whole duration [s].
        steps: control steps executed.
        safety: what the safety filter changed.
    """

    name: str
    time: np.ndarray
    command: np.ndarray
    gait: np.ndarray
    measured: np.ndarray
    clearance: np.ndarray
    phase: np.ndarray
    foot_contact: np.ndarray
    foot_force: np.ndarray
    pressure_centre: np.ndarray
    foothold: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    target: np.ndarray
    hand_target_world: np.ndarray
    arm_target: np.ndarray
    hand_error: np.ndarray
    reachable: np.ndarray
    torque: np.ndarray
    tick_ms: np.ndarray
    ik_ms: np.ndarray
    touch_downs: tuple[np.ndarray, np.ndarray]
    fell: bool
    survived_s: float
    steps: int
    safety: SafetyReport


def rollout(
    controller: Controller,
    source: CommandSource,
    simulation: Simulation,
    upper_body: UpperBodySource | None = None,
    *,
    duration: float,
    estimator: StateEstimator | None = None,
    forces: Sequence[Force] = (),
    on_progress: Callable[[float], None] | None = None,
) -> Trace:
    """Run a controller behind the safety filter from a standing start until it falls or the time is over.

    The loop runs at the controller's period, the physics at its own time step, and the record is taken every
    `RECORD_PERIOD`. The controller reads `Simulation.sense`, or the estimator that does; the record the true state.

    Args:
        controller: whatever implements `Controller`.
        source: commands and hand targets over time.
        simulation: is reset to the nominal stand at the origin.
        upper_body: turns hand targets into arm targets; without it hand targets are ignored.
        duration: [s].
        estimator: of the state from the sensors; None where the controller reads them itself.
        forces: that act on the robot.
        on_progress: called with the fraction done, about fifty times a simulated second.

    Raises:
        ConfigError: if the duration is not above 0, or the controller's period is no multiple of the time step.
        UnknownNameError: if no link has the name of a force's.
    """
    if not 0.0 < duration < np.inf:
        raise ConfigError(f"duration is {duration} s; give a finite time above 0 s")
    loop = ControlLoop(controller, source, simulation, upper_body, estimator)
    recorder = _Recorder(loop, Disturber(simulation.model, forces))
    loop.reset()
    ticks = max(1, round(duration / loop.period))
    for tick in range(ticks):
        t = tick * loop.period
        joint_command = loop.decide(t)
        recorder.tick_ms.append(loop.safe.last_tick_s * 1e3)
        if upper_body is not None:
            recorder.ik_ms.append(loop.ik_s * 1e3)
        if recorder.due(t):
            recorder.sample(t, joint_command)
            if on_progress is not None:
                on_progress(tick / ticks)
        if not recorder.advance(joint_command, t):
            return recorder.trace(fell=True, survived_s=t, steps=tick + 1)
    return recorder.trace(fell=False, survived_s=duration, steps=ticks)


class _Recorder:
    """Collects the samples of one run and watches the feet at every physics step."""

    def __init__(self, loop: ControlLoop, disturber: Disturber) -> None:
        self.loop = loop
        self.disturber = disturber
        self.simulation = loop.simulation
        self.kinematics = Kinematics()
        self.rows: dict[str, list] = {}
        self.tick_ms: list[float] = []
        self.ik_ms: list[float] = []
        self.touch_downs: tuple[list[float], list[float]] = ([], [])
        self._contact = np.array([True, True])
        self._last_contact = np.zeros(2)
        self._samples = 0

    def due(self, t: float) -> bool:
        """Whether the next sample is due at time t."""
        return t >= self._samples * RECORD_PERIOD - 1e-9

    def advance(self, command: JointCommand, t: float) -> bool:
        """Step the physics through one control period, noting touch-downs; whether the robot is still up."""
        dt, data = self.simulation.timestep, self.simulation.data
        for substep in range(self.loop.substeps):
            self.disturber.update(t + substep * dt, data.qpos, data.xfrc_applied)
            now = t + (substep + 1) * dt
            self._contact = foot_contacts(self.loop.step(command, dt))
            for foot in np.flatnonzero(self._contact & (now - self._last_contact > SHORTEST_SWING)):
                self.touch_downs[foot].append(now)
            self._last_contact[self._contact] = now
        return not self.simulation.fallen

    def sample(self, t: float, command: JointCommand) -> None:
        """Add one row of everything at time t."""
        self._samples += 1
        state = self.simulation.state()
        self.kinematics.update(state)
        assert state.position is not None
        left, right = (self.simulation.ground_height(self.kinematics.position(f"{side}_sole")[:2]) for side in SIDES)
        measured = self.kinematics.measured(self.simulation.ground_height(state.position[:2]), (left, right))
        moment = self.loop.moment()
        actual = np.stack([self.simulation.hand_position(side) for side in SIDES])
        row = {
            "time": t,
            "command": self.loop.safe.command.array(),
            "measured": [getattr(measured, name) for name in MEASURED_NAMES],
            "clearance": measured.clearance,
            **{name: getattr(moment, name) for name in MOMENT_FIELDS},
            "qvel": self.simulation.data.qvel.copy(),
            "target": command.q.copy(),
            "hand_error": np.linalg.norm(actual - moment.hand_target_world, axis=1),
            "reachable": self.loop.reachable,
            "torque": self.simulation.torque,
        }
        for name, value in row.items():
            self.rows.setdefault(name, []).append(value)

    def trace(self, *, fell: bool, survived_s: float, steps: int) -> Trace:
        """The record of the run."""
        left, right = (np.array(times) for times in self.touch_downs)
        return Trace(
            name=self.loop.safe.name,
            **{name: np.array(values) for name, values in self.rows.items()},
            tick_ms=np.array(self.tick_ms),
            ik_ms=np.array(self.ik_ms),
            touch_downs=(left, right),
            fell=fell,
            survived_s=survived_s,
            steps=steps,
            safety=self.loop.safe.report(),
        )
