"""The record of one run of a controller, which metrics, plots and replays read, and the watch over its touch-downs."""

import dataclasses
import math
from typing import Any

import numpy as np

from hugwbc.robot import DEFAULT_ROBOT
from hugwbc.runtime.safety_report import SafetyReport
from hugwbc.sim.scenes.scene import Scene

RECORD_PERIOD = 0.02  # [s] between two samples
CONTACT_FORCE = 1.0  # [N]; a foot with a larger vertical ground reaction counts as on the ground
IMPACT_TIME = 0.01  # [s]; the force of an impact is averaged over it, so that it hardly depends on the time step
SHORTEST_SWING = 0.05  # [s]; a foot that leaves the ground for a shorter time has bounced, not stepped


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Trace:
    """The record of one run: T samples, one every `RECORD_PERIOD`.

    `hugwbc.runtime.trace_file` keeps it in a file, `hugwbc.viz.show.keep_replay` writes a page that replays it.

    Attributes:
        name: name of the controller.
        time: times of the samples [s], shape (T,).
        command: the eight commanded values, clamped to their ranges, in the order of COMMAND_NAMES, shape (T, 8). They
            include the h, p and w of hand targets that ask for the whole body, but not the changes by the guard
            (`runtime.command_chain`), which therefore count as errors.
        gait: values of `Gait`, shape (T,).
        measured: v_x, v_y, omega, h, p, w as executed (see `kinematics.Measured`), shape (T, 6).
        clearance: height of the left and right sole above the ground [m], shape (T, 2).
        phase: common gait phase in [0, 1), shape (T,); NaN for a controller without one.
        foot_contact: whether each foot is on the ground, shape (T, 2), bool.
        foot_force: ground reaction on each foot, world frame [N], shape (T, 2, 3).
        pressure_centre: point where that force acts [m], shape (T, 2, 3); NaN for a foot in the air.
        foothold: where the controller plans to put each sole next, x and y [m], shape (T, 2, 2); NaN without a plan.
        qpos: pelvis position, quaternion (w, x, y, z) and joint positions, shape (T, 26).
        qvel: pelvis velocity [m/s], its angular velocity in its own frame and joint velocities [rad/s], shape (T, 25).
        target: joint position targets of the joint command at this time [rad], shape (T, n).
        hand_target_world: targets of both hands [m], shape (T, 2, 3); NaN without one.
        arm_target: arm positions that the inverse kinematics asks for [rad], shape (T, k); NaN where it does not move
            the arms.
        hand_error: distance of each hand to its target, reachable or not [m], shape (T, 2); NaN without a target.
        reachable: whether the inverse kinematics can reach each hand's target, shape (T, 2), bool.
        torque: joint torques in the physics step before this time [N*m], shape (T, n).
        tick_ms: time that each call of the controller took [ms], shape (number of calls,).
        ik_ms: time that each call of the arms' source took [ms], shape (number of calls,).
        touch_downs: times at which the left and the right foot came down after a swing of at least `SHORTEST_SWING`,
            at the resolution of the physics [s].
        touch_down_velocity: velocity of each foot's sole in the physics step before each of its `touch_downs`, world
            frame [m/s], shape (touch-downs, 3) for each foot.
        stance_peak: largest vertical ground reaction, averaged over `IMPACT_TIME`, in the stance after each of the
            `touch_downs` [N], shape (touch-downs,) for each foot. The last stance may be cut short by the end.
        mass: mass of the robot's description, without a payload [kg].
        fell: whether the robot fell or the physics diverged.
        survived_s: time of the fall, or the whole duration [s].
        steps: number of control steps executed.
        safety: what was changed on the way to the joints.
        robot: name of the simulated robot.
        hand_force: force on each hand from outside, world frame [N], shape (T, 2, 3); empty without a scene.
        object_pose: position [m] and quaternion (w, x, y, z) of every body of the scene, in the order of
            `Scene.body_names`, shape (T, bodies, 7); empty without a scene.
        scene: the objects around the robot, as drawn; None for none.
        problems: what went wrong with the objects, such as one that left the world.
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
    touch_down_velocity: tuple[np.ndarray, np.ndarray]
    stance_peak: tuple[np.ndarray, np.ndarray]
    mass: float
    fell: bool
    survived_s: float
    steps: int
    safety: SafetyReport
    robot: str = DEFAULT_ROBOT
    hand_force: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((0, 2, 3)))
    object_pose: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((0, 0, 7)))
    scene: Scene | None = None
    problems: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Return one line: who, how long, how it ended."""
        fate = f"fell after {self.survived_s:.1f} s" if self.fell else "stayed up"
        around = f", {len(self.scene.objects)} objects" if self.scene is not None else ""
        seconds = float(self.time[-1] - self.time[0]) + RECORD_PERIOD if len(self.time) else 0.0
        return f"Trace('{self.name}', {seconds:.1f} s, {len(self.time)} samples, {fate}, {self.robot}{around})"


class TouchDownWatch:
    """A watch over both feet of one run, called after every physics step."""

    def __init__(self, timestep: float) -> None:
        """Begin with both feet on the ground; the physics time step is in [s]."""
        # Vertical forces of the last physics steps within IMPACT_TIME, written in turn.
        self._count = max(1, round(IMPACT_TIME / timestep))
        self._forces = [[0.0] * self._count for _ in range(2)]
        self._turn = 0
        self._last_contact = [0.0, 0.0]  # [s]
        self._velocity = np.zeros((2, 3))
        self._peak = [0.0, 0.0]  # of the current stance
        self._times: tuple[list[float], list[float]] = ([], [])
        self._velocities: tuple[list[np.ndarray], list[np.ndarray]] = ([], [])
        self._peaks: tuple[list[float], list[float]] = ([], [])

    def update(self, now: float, force: np.ndarray, velocity: np.ndarray) -> None:
        """Take the feet after a physics step.

        Args:
            now: time after the step [s].
            force: ground reactions in the world frame [N], shape (2, 3).
            velocity: velocities of the soles in the world frame [m/s], shape (2, 3).
        """
        self._turn = (self._turn + 1) % self._count
        for foot, normal in enumerate(force[:, 2].tolist()):  # of two numbers, floats are faster than arrays
            if normal > CONTACT_FORCE:
                # A shorter time in the air is a bounce of the contact; its forces belong to the same stance.
                if now - self._last_contact[foot] > SHORTEST_SWING:
                    self._land(foot, now)
                self._last_contact[foot] = now
            forces = self._forces[foot]
            forces[self._turn] = normal if -math.inf < normal < math.inf else 0.0  # diverged physics does not count
            mean = sum(forces) / self._count
            if mean > self._peak[foot]:
                self._peak[foot] = mean
        self._velocity[:] = velocity

    def _land(self, foot: int, now: float) -> None:
        if self._times[foot]:  # a stance from the start of the run follows no touch-down
            self._peaks[foot].append(self._peak[foot])
        self._peak[foot] = 0.0
        self._times[foot].append(now)
        # The contact force slows the sole within a step, so the speed of the impact is that of the step before.
        self._velocities[foot].append(self._velocity[foot].copy())

    def record(self) -> dict[str, Any]:
        """Return `touch_downs`, `touch_down_velocity` and `stance_peak` of a `Trace`."""
        current = [[peak] if times else [] for peak, times in zip(self._peak, self._times, strict=True)]
        return {
            "touch_downs": tuple(map(np.array, self._times)),
            "touch_down_velocity": tuple(np.array(found).reshape(-1, 3) for found in self._velocities),
            "stance_peak": tuple(np.array(closed + last) for closed, last in zip(self._peaks, current, strict=True)),
        }
