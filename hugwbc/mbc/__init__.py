"""The model-based half: gait plan, footsteps, tasks and whole-body QP."""

from hugwbc.mbc.diagnostics import Diagnostics, Output
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.qp import QpStatus
from hugwbc.mbc.whole_body import WholeBodyController

__all__ = ["ControllerParams", "Diagnostics", "Output", "QpStatus", "WholeBodyController"]
