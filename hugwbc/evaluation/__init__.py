"""Runs of any controller, the paper's tracking errors and protocols, and the comparison of controllers."""

from hugwbc.evaluation.loop import Constant, ControlLoop
from hugwbc.evaluation.rollout import Trace, rollout

__all__ = ["Constant", "ControlLoop", "Trace", "rollout"]
