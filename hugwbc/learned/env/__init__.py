"""The training environment: many H1s, their commands, rewards, curricula, disturbances and interventions."""

from hugwbc.learned.env.humanoid_env import HumanoidEnv, StepResult

__all__ = ["HumanoidEnv", "StepResult"]
