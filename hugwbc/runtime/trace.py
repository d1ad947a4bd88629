"""The record of one run of a controller, which metrics, plots and replays read."""

import dataclasses

import numpy as np

from hugwbc.runtime.safety import SafetyReport

RECORD_PERIOD = 0.02  # [s] between two samples
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
