"""Run the episodes of a protocol, in one process or many, and keep their results.

This is the door of the engine: other rooms import from here. `docs/engine.md` explains how episodes are identified,
stored, resumed and distributed.
"""

from hugwbc.evaluation.engine.campaign import Cell, CellResult, read_result, run_cells
from hugwbc.evaluation.engine.episode import (
    ControllerFactory,
    EpisodeSettings,
    Judge,
    Row,
    Run,
    controller_of,
    run_episodes,
    stored_rows,
)
from hugwbc.evaluation.engine.execution import Execution
from hugwbc.evaluation.engine.plans import EpisodePlan, Knot, Schedule, Stage, Tour, Waypoint
from hugwbc.evaluation.engine.store import DEFAULT_FOLDER, ResultStore

__all__ = [
    "DEFAULT_FOLDER",
    "Cell",
    "CellResult",
    "ControllerFactory",
    "EpisodePlan",
    "EpisodeSettings",
    "Execution",
    "Judge",
    "Knot",
    "ResultStore",
    "Row",
    "Run",
    "Schedule",
    "Stage",
    "Tour",
    "Waypoint",
    "controller_of",
    "read_result",
    "run_cells",
    "run_episodes",
    "stored_rows",
]
