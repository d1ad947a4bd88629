"""Every number of training, imitation and distillation, with its meaning; each is a flag of its verb."""

from hugwbc.learned.config.environment import (
    CommandConfig,
    CurriculumConfig,
    EnvConfig,
    ExtraWeights,
    RandomizationConfig,
    RewardWeights,
    TerrainConfig,
)
from hugwbc.learned.config.imitation_settings import CALIBRATED_COMMANDS, DistillationConfig, ImitationConfig
from hugwbc.learned.config.training_settings import PPOConfig, TrainConfig

__all__ = [
    "CALIBRATED_COMMANDS",
    "CommandConfig",
    "CurriculumConfig",
    "DistillationConfig",
    "EnvConfig",
    "ExtraWeights",
    "ImitationConfig",
    "PPOConfig",
    "RandomizationConfig",
    "RewardWeights",
    "TerrainConfig",
    "TrainConfig",
]
