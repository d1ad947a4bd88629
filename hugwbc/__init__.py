"""Whole-body control of humanoids: one command interface, a learned policy, a whole-body QP and hand IK.

The package root loads neither torch nor Pinocchio nor placo. The modules that need them do, such as those of
`hugwbc.learned`, `hugwbc.mbc` and `hugwbc.upper_ik`.
"""

from hugwbc.commands import COMMAND_NAMES, Command, CommandRange, command_ranges
from hugwbc.controller import Controller, JointCommand, UpperBody
from hugwbc.errors import HugwbcError
from hugwbc.gait import Gait
from hugwbc.robot import Robot, load_robot
from hugwbc.state import RobotState

__version__ = "0.2.0"

__all__ = [
    "COMMAND_NAMES",
    "Command",
    "CommandRange",
    "Controller",
    "Gait",
    "HugwbcError",
    "JointCommand",
    "Robot",
    "RobotState",
    "UpperBody",
    "__version__",
    "command_ranges",
    "load_robot",
]
