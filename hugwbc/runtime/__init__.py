"""Run a robot: the control loop, rollouts and their records, safety, estimation, controllers by name.

The names below are what users need. Modules of hugwbc itself import the submodules.
"""

from hugwbc.arm_servo import ArmServo
from hugwbc.runtime.command_chain import feasible
from hugwbc.runtime.controllers import ControllerSpec, HoldController, controller_names, load_controller
from hugwbc.runtime.estimation import StateEstimator
from hugwbc.runtime.loop import ControlLoop
from hugwbc.runtime.mujoco_robot import MujocoRobot
from hugwbc.runtime.rollout import rollout
from hugwbc.runtime.safety_report import SafetyReport
from hugwbc.runtime.trace import Snapshot, Trace, read_trace, write_trace
from hugwbc.scripts.view import CommandSource, Constant
from hugwbc.sim import Arena, Force, SensorProfile, Simulation
from hugwbc.upper_ik import UpperBodySource

__all__ = [
    "Arena",
    "ArmServo",
    "CommandSource",
    "Constant",
    "ControlLoop",
    "ControllerSpec",
    "Force",
    "HoldController",
    "MujocoRobot",
    "SafetyReport",
    "SensorProfile",
    "Simulation",
    "Snapshot",
    "StateEstimator",
    "Trace",
    "UpperBodySource",
    "controller_names",
    "feasible",
    "load_controller",
    "read_trace",
    "rollout",
    "write_trace",
]
