"""The paper's experiments, one file per table or figure, for any controller."""

from hugwbc.evaluation.protocols.single_command import SingleCommandConfig, SingleCommandResult, run_single_command

PROTOCOL_NAMES = ("single-command",)

__all__ = ["PROTOCOL_NAMES", "SingleCommandConfig", "SingleCommandResult", "run_single_command"]
