"""Every number of training, imitation and distillation, with its meaning; each is a flag of its verb."""

from hugwbc.learned.config.environment import (
    CommandConfig,
    CurriculumConfig,
    EnvConfig,
    ExtraWeights,
    RewardWeights,
    TerrainConfig,
)
from hugwbc.learned.config.imitation_settings import CALIBRATED_COMMANDS, DistillationConfig, ImitationConfig
from hugwbc.learned.config.robot_settings import ArmServoGains, LoadConfig, RandomizationConfig
from hugwbc.learned.config.schedules import Schedule, scheduled
from hugwbc.learned.config.training_settings import PPOConfig, TrainConfig

__all__ = [
    "CALIBRATED_COMMANDS",
    "ArmServoGains",
    "CommandConfig",
    "CurriculumConfig",
    "DistillationConfig",
    "EnvConfig",
    "ExtraWeights",
    "ImitationConfig",
    "LoadConfig",
    "PPOConfig",
    "RandomizationConfig",
    "RewardWeights",
    "Schedule",
    "TerrainConfig",
    "TrainConfig",
    "scheduled",
]
