"""The paper's experiments, one file per table or figure, and the accuracy of the hands, for any controller."""

from hugwbc.evaluation.protocols.hands import HandsConfig, HandsResult, run_hands
from hugwbc.evaluation.protocols.random_commands import (
    RandomCommandsConfig,
    RandomCommandsResult,
    run_random_commands,
)
from hugwbc.evaluation.protocols.single_command import SingleCommandConfig, SingleCommandResult, run_single_command
from hugwbc.evaluation.protocols.small_velocities import (
    SmallVelocitiesConfig,
    SmallVelocitiesResult,
    run_small_velocities,
)

__all__ = [
    "HandsConfig",
    "HandsResult",
    "RandomCommandsConfig",
    "RandomCommandsResult",
    "SingleCommandConfig",
    "SingleCommandResult",
    "SmallVelocitiesConfig",
    "SmallVelocitiesResult",
    "run_hands",
    "run_random_commands",
    "run_single_command",
    "run_small_velocities",
]
