"""External control of the arms in evaluation by the training's noise or motions, for any controller, without IK."""

import numpy as np
import torch

from hugwbc.commands import Command
from hugwbc.controller import UpperBody
from hugwbc.learned.env.arm_intervention import ArmTargets
from hugwbc.robot import Robot
from hugwbc.runtime.trace import Trace
from hugwbc.scripts.motion import MOTION_FPS
from hugwbc.state import RobotState
from hugwbc.targets import HandTargets

_PERIOD = 1.0 / MOTION_FPS  # [s] between two postures of the source
_ONE = torch.tensor([0])


class ArmIntervention:
    """A source of arm targets for `ControlLoop` that moves both arms whatever the hand targets are.

    The postures come at 50 Hz. Between two postures the targets are interpolated linearly, with their velocity.
    """

    solution = None

    def __init__(self, source: ArmTargets, robot: Robot) -> None:
        """Play a source of arm targets for one robot."""
        self._source, self._robot = source, robot
        self._nominal = robot.nominal[robot.arms]
        self.postures: list[np.ndarray] = []  # since `reset` at 50 Hz [rad], each (k,)
        self.reset()

    def reset(self) -> None:
        """Return to the nominal posture; the source continues with new targets."""
        self._source.reset(_ONE)
        self.postures = []
        self._begin = self._end = self._nominal
        self._elapsed = _PERIOD

    def update(
        self,
        state: RobotState,
        hands: HandTargets | None,
        command: Command,
        dt: float,
        commanded: np.ndarray | None = None,
    ) -> tuple[UpperBody, Command]:
        """Return the arm targets at the end of the next `dt` seconds, and the command; the rest does not matter."""
        self._elapsed += dt
        while self._elapsed > _PERIOD + 1e-9:
            self._elapsed -= _PERIOD
            self._source.step()
            self._begin, self._end = self._end, self._source.targets()[0].double().numpy()
            self.postures.append(self._end)
        ratio = self._elapsed / _PERIOD
        speed = (self._end - self._begin) / _PERIOD
        return UpperBody.targets(self._begin + ratio * (self._end - self._begin), speed), command

    def error(self, trace: Trace, settle: float) -> float:
        """Return the mean distance of the arm joints to their targets after `settle` [s] of a run [rad].

        NaN if the run ended before.
        """
        steps = min(len(self.postures), len(trace.time) - 1)
        # A sample is taken before the target of its time acts, so the next sample shows the effect.
        kept = trace.time[1 : steps + 1] >= settle
        reached = trace.qpos[1 : steps + 1, 7:][:, self._robot.arms]
        difference = np.abs(reached - np.array(self.postures[:steps]).reshape(steps, -1))[kept]
        return float(difference.mean()) if difference.size else float("nan")
