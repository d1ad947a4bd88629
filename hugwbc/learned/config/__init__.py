"""Settings of training and calibration, with their meanings: options of `hugwbc train`, and settings of recipes."""

from hugwbc.learned.config.environment import (
    CommandConfig,
    CurriculumConfig,
    EnvConfig,
    ExtraWeights,
    RewardTerm,
    RewardWeights,
    TerrainConfig,
)
from hugwbc.learned.config.robot_settings import LoadConfig, RandomizationConfig
from hugwbc.learned.config.schedules import Schedule
from hugwbc.learned.config.training_settings import CalibrationConfig, PPOConfig, TrainConfig

__all__ = [
    "CalibrationConfig",
    "CommandConfig",
    "CurriculumConfig",
    "EnvConfig",
    "ExtraWeights",
    "LoadConfig",
    "PPOConfig",
    "RandomizationConfig",
    "RewardTerm",
    "RewardWeights",
    "Schedule",
    "TerrainConfig",
    "TrainConfig",
]
