"""The record of one run of a controller, which metrics, plots and replays read."""

import dataclasses

import numpy as np

from hugwbc.robot import DEFAULT_ROBOT
from hugwbc.runtime.safety import SafetyReport

RECORD_PERIOD = 0.02  # [s] between two samples
SHORTEST_SWING = 0.05  # [s]; a foot that leaves the ground for a shorter time has bounced, not stepped


@dataclasses.dataclass(frozen=True, eq=False)
class Trace:
    """The record of one run: T samples, one every `RECORD_PERIOD`.

    Attributes:
        name: name of the controller.
        time: times of the samples [s], shape (T,).
        command: the eight commanded values, clamped to their ranges, in the order of COMMAND_NAMES, shape (T, 8). They
            include the h, p and w of hand targets that ask for the whole body, but not the changes by the guard
            (`runtime.feasibility`), which therefore count as errors.
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
        target: joint position targets of the joint command at this time [rad], shape (T, 19).
        hand_target_world: targets of both hands [m], shape (T, 2, 3); NaN without one.
        arm_target: arm positions that the inverse kinematics asks for [rad], shape (T, 8); NaN where it does not move
            the arms.
        hand_error: distance of each hand to its target, reachable or not [m], shape (T, 2); NaN without a target.
        reachable: whether the inverse kinematics can reach each hand's target, shape (T, 2), bool.
        torque: joint torques in the physics step before this time [N*m], shape (T, 19).
        tick_ms: time that each call of the controller took [ms], shape (number of calls,).
        ik_ms: time that each call of the arms' source took [ms], shape (number of calls,).
        touch_downs: times at which the left and the right foot came down after a swing of at least `SHORTEST_SWING`,
            at the resolution of the physics [s].
        fell: whether the robot fell or the physics diverged.
        survived_s: time of the fall, or the whole duration [s].
        steps: number of control steps executed.
        safety: report of the safety filter.
        robot: name of the simulated robot.
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
    robot: str = DEFAULT_ROBOT
