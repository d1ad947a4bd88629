"""The safety filter: the last stage of a control period, through which every joint command passes."""

import numpy as np

from hugwbc.controller import JointCommand
from hugwbc.robot import Robot
from hugwbc.runtime.safety_report import SafetyLog

# [rad], and as a part of a joint's highest speed: a drive that gives all its torque for less is a switch.
_LEAST_ERROR, _LEAST_SPEED = 0.05, 0.1
# Counters of what was clamped in the five vectors.
_LIMITED = ("positions_limited", "speeds_limited", "gains_limited", "gains_limited", "torques_limited")


def target_limits(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest position target of each joint [rad], each of shape (n,).

    A PD joint turns the distance to its target into torque. To give its full torque at a position limit, its target
    must lie torque_limit / kp beyond that limit.
    """
    margin = robot.torque_limit / robot.kp
    return robot.lower - margin, robot.upper + margin


def gain_limits(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Return the highest stiffness [N*m/rad] and damping [N*m*s/rad] of each joint, each of shape (n,).

    They give the drive's full torque for an error of 0.05 rad, or of a tenth of the joint's highest speed.
    """
    return robot.torque_limit / _LEAST_ERROR, robot.torque_limit / (_LEAST_SPEED * robot.velocity_limit)


class SafetyFilter:
    """A limiter of joint commands.

    Position targets are clamped to `target_limits`, velocity targets to the joints' highest speeds, gains to 0 and
    `gain_limits`, and feed-forward torques to the torque limits. What is clamped is counted.
    """

    def __init__(self, robot: Robot, log: SafetyLog) -> None:
        """Take the limits from a robot."""
        self._names, self._log = robot.joint_names, log
        (lowest, highest), speed, torque = target_limits(robot), robot.velocity_limit, robot.torque_limit
        self._high = np.array((highest, speed, *gain_limits(robot), torque))
        self._low = np.array((lowest, -speed, *np.zeros((2, torque.size)), -torque))
        self._given: JointCommand | None = None

    def __call__(self, command: JointCommand) -> JointCommand:
        """Return a finite joint command within all limits, and count what was changed."""
        if command is self._given:
            return command
        before = np.array((command.q, command.dq, command.kp, command.kd, command.tau))
        after = np.minimum(np.maximum(before, self._low), self._high)  # in a third of the time of `np.clip`
        different = before != after
        if np.count_nonzero(different):  # in a fifth of the time of `any`
            for counter, joints, way in zip(_LIMITED, different, np.abs(before - after), strict=True):
                if joints.any():
                    joint = self._names[int(np.argmax(way))]
                    self._log.count(counter, f"{counter.replace('_', ' ')}, first at {joint}")
        self._given = JointCommand(*after)
        return self._given
