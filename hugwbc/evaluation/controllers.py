"""Controllers by name, as on the command line."""

import dataclasses
import pathlib

import numpy as np

from hugwbc.commands import Command
from hugwbc.controller import Controller, JointCommand, UpperBody, override_arms
from hugwbc.errors import UnknownNameError
from hugwbc.robot import load_robot
from hugwbc.state import RobotState

CONTROLLER_NAMES = ("learned", "qp", "hold")


class HoldController:
    """Holds the nominal pose with the PD gains and turns the waist as commanded: the baseline that does not balance."""

    name = "hold"
    period = 0.02

    def __init__(self) -> None:
        self.robot = load_robot()

    def reset(self, state: RobotState) -> None:
        """Nothing to forget."""

    def act(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand:
        """The nominal pose, with the commanded waist angle and external arm targets."""
        q = self.robot.nominal.copy()
        q[self.robot.waist] = command.w
        return override_arms(JointCommand.position(self.robot, np.asarray(q)), upper_body, self.robot)


@dataclasses.dataclass(frozen=True)
class ControllerSpec:
    """A controller by name: cheap to send to another process, which builds it there.

    Attributes:
        name: one of `CONTROLLER_NAMES`.
        policy: name of a shipped policy or path of a policy file, for the learned controller; None for the default.
    """

    name: str
    policy: str | pathlib.Path | None = None

    def __post_init__(self) -> None:
        if self.name not in CONTROLLER_NAMES:
            raise UnknownNameError("controller", self.name, CONTROLLER_NAMES)

    def build(self) -> Controller:
        """The controller, ready to `reset`.

        Raises:
            PolicyFileError: if the policy file is missing, truncated or foreign.
        """
        if self.name == "hold":
            return HoldController()
        if self.name == "qp":
            from hugwbc.mbc import WholeBodyController

            return WholeBodyController()
        from hugwbc.learned.policy import load_policy

        return load_policy() if self.policy is None else load_policy(self.policy)
