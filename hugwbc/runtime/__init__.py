"""Run a robot: the control loop, rollouts and their records, safety, estimation, controllers by name."""

from hugwbc.runtime.controllers import ControllerSpec, controller_names, load_controller
from hugwbc.runtime.loop import CommandSource, Constant, ControlLoop
from hugwbc.runtime.rollout import rollout
from hugwbc.runtime.trace import Trace
from hugwbc.sim import Simulation

__all__ = [
    "CommandSource",
    "Constant",
    "ControlLoop",
    "ControllerSpec",
    "Simulation",
    "Trace",
    "controller_names",
    "load_controller",
    "rollout",
]
