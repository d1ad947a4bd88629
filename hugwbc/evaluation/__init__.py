"""Runs of any controller, the paper's tracking errors and protocols, and the comparison of controllers."""

from hugwbc.evaluation.rollout import Constant, Trace, rollout

__all__ = ["Constant", "Trace", "rollout"]
