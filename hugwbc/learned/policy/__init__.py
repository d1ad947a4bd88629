"""The learned policy: its networks, observations, files and contract."""

from hugwbc.learned.policy.policy import load_policy

__all__ = ["load_policy"]
