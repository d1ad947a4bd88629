"""The training environment: many robots, their commands, rewards, curricula, disturbances and interventions."""

from hugwbc.learned.env.humanoid_env import HumanoidEnv
from hugwbc.learned.env.readings import StepResult

__all__ = ["HumanoidEnv", "StepResult"]
