"""The paper's experiments, one file per table or figure, for any controller."""

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

PROTOCOL_NAMES = ("single-command", "random-commands", "small-velocities")

__all__ = [
    "PROTOCOL_NAMES",
    "RandomCommandsConfig",
    "RandomCommandsResult",
    "SingleCommandConfig",
    "SingleCommandResult",
    "SmallVelocitiesConfig",
    "SmallVelocitiesResult",
    "run_random_commands",
    "run_single_command",
    "run_small_velocities",
]
