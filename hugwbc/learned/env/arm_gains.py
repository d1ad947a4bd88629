"""Gains of the arms in training: the policy's own, or the arm servo's while they are under external control."""

import torch

from hugwbc.learned.config import ArmServoGains
from hugwbc.robot import Robot
from hugwbc.sim.batch import RobotBatch


class ArmGains:
    """Stiffness and damping of the arm joints of n robots, between the policy's and the servo's.

    Under an intervention of noise level alpha the arms follow a mixture of external targets and the policy's, and their
    gains are the same mixture.
    """

    def __init__(self, simulation: RobotBatch, robot: Robot, servo: ArmServoGains) -> None:
        """Take the policy's gains from the robots; their random factors apply to the servo's as well.

        Args:
            simulation: the robots, with their own gains.
            robot: the robot as described.
            servo: gains of the servo.
        """
        self._arms = torch.as_tensor(robot.arms, device=simulation.device)
        self._gain = simulation.expand("actuator_gainprm")
        self._bias = simulation.expand("actuator_biasprm")
        # tau = k target + b_0 - k q - d dq; an offset of the target is b_0 / k.
        own = self._gain[:, self._arms, 0]
        bias = self._bias[:, self._arms]
        damping = -bias[..., 2]
        gains = robot.kp[robot.arms], robot.kd[robot.arms], *servo.of(robot)
        kp, kd, stiffness, servo_damping = map(simulation.tensor, gains)
        self._offset = bias[..., 0] / own
        self._own = own, damping
        self._servo = own / kp * stiffness, damping / kd * servo_damping
        self._share = own.new_zeros(len(own))

    def update(self, share: torch.Tensor) -> None:
        """Set the gains of the robots whose share of the servo, (n,), from 0 to 1, has changed."""
        wanted = share.to(self._share)
        rows = (wanted != self._share).nonzero().squeeze(1)
        if not rows.numel():
            return
        self._share = wanted
        part = wanted[rows, None]
        stiffness, damping = (
            (1.0 - part) * own[rows] + part * servo[rows] for own, servo in zip(self._own, self._servo, strict=True)
        )
        where = rows[:, None], self._arms
        self._gain[*where, 0] = stiffness
        self._bias[*where, 0] = stiffness * self._offset[rows]
        self._bias[*where, 1] = -stiffness
        self._bias[*where, 2] = -damping
