"""The `qp` controller: model-based, by gait plan, footsteps, tasks and a whole-body QP."""

from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.qp import QpStatus
from hugwbc.mbc.whole_body import Diagnostics, WholeBodyController

__all__ = ["ControllerParams", "Diagnostics", "QpStatus", "WholeBodyController"]
