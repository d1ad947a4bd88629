"""How far a run is: states of its stages, what they have cost, and the time that is left."""

import dataclasses
import json
import pathlib
from collections.abc import Sequence

from hugwbc.errors import RecipeError
from hugwbc.learned.recipe.ancestry import read_record
from hugwbc.learned.recipe.ledger import Spent
from hugwbc.learned.recipe.run_folder import PLAN_FILE, RunFolder
from hugwbc.learned.recipe.stage_work import read_state


@dataclasses.dataclass(frozen=True)
class StageStatus:
    """How far a stage is.

    Attributes:
        name: its name.
        state: waits, begun, or its outcome.
        done: fraction that is done.
        spent: what it has cost so far.
        discarded: steps and labels that led to nothing.
    """

    name: str
    state: str
    done: float
    spent: Spent
    discarded: float


@dataclasses.dataclass(frozen=True)
class RunStatus:
    """How far a run is.

    Attributes:
        stages: its stages in their order.
        sessions: number of sessions so far.
        spent: what everything has cost.
        newest: the end of the last session, or that it goes on.
        left: what is left, in words.
    """

    stages: tuple[StageStatus, ...]
    sessions: int
    spent: Spent
    newest: str
    left: str


def status_of(path: pathlib.Path) -> RunStatus:
    """Return how far a run is.

    Raises:
        RecipeError: if there is no run in the folder.
    """
    folder = RunFolder(path)
    stored = folder.stored()
    if not stored:
        raise RecipeError(f"{path} holds no run of a recipe; give the folder that was --out of `hugwbc recipe run`")
    sessions = folder.sessions()
    stages = tuple(_stage(folder, name) for name in stored["stages"])
    unfinished = [f"{one.name} ({100.0 * one.done:.0f} %)" for one in stages if one.done < 1.0]
    hours = _hours_left(folder, stages)
    about = "" if hours is None else f", about {hours:.2f} core-hours"
    left = f"left: {', '.join(unfinished)}{about}" if unfinished else "finished"
    newest = ""
    if sessions:
        newest = sessions[-1].ended or f"session {sessions[-1].number} of {sessions[-1].began} runs, or was killed"
    return RunStatus(stages, len(sessions), folder.spent(), newest, left)


def _hours_left(folder: RunFolder, stages: Sequence[StageStatus]) -> float | None:
    """Return the planned cost of what is left, corrected by what the finished part has cost; None without a plan."""
    try:
        plan = json.loads((folder.path / PLAN_FILE).read_text(encoding="utf-8"))
        planned = {one.name: float(plan[one.name]) for one in stages}
    except (OSError, ValueError, KeyError, TypeError):
        return None
    expected = sum(planned[one.name] for one in stages if one.done == 1.0)
    spent = sum(one.spent.cpu_seconds for one in stages if one.done == 1.0)
    factor = spent / expected if expected > 0.0 and spent > 0.0 else 1.0
    return factor * sum((1.0 - one.done) * planned[one.name] for one in stages) / 3600.0


def _stage(folder: RunFolder, name: str) -> StageStatus:
    place = folder.stage(name)
    spent = folder.spent_on_stage(name, folder.sessions())
    record = read_record(place)
    if record is not None:
        discarded = sum(one.steps + one.labels for one in record.discarded)
        return StageStatus(name, record.outcome, 1.0, spent, discarded)
    if not place.exists():
        return StageStatus(name, "waits", 0.0, spent, 0.0)
    state = read_state(place)
    branches = sum(float(one["steps"]) for one in state.get("discarded", []))
    return StageStatus(name, "begun", min(float(state.get("progress", 0.0)), 0.999), spent, branches)
