"""Gymnasium environments: the tasks of the suite at 10 Hz, and the robot's joints at 50 Hz.

`import hugwbc.gym` registers them; then `gymnasium.make("hugwbc/FetchBox-v0", controller="qp")` builds one. What is in
an action and in an observation is said in docs/how-to/use-gymnasium.md.
"""

from hugwbc.gym.registration import H1, TASK_ENVIRONMENTS, register

__all__ = ["H1", "TASK_ENVIRONMENTS", "register"]

register()
