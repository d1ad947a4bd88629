import dataclasses
import subprocess
import sys
import time

import pytest

from hugwbc import Command, Gait
from hugwbc.errors import ResultFileError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.engine import episode
from hugwbc.evaluation.engine.execution import Execution
from hugwbc.evaluation.engine.plans import EpisodePlan
from hugwbc.evaluation.engine.store import ResultStore
from hugwbc.evaluation.protocols.episodes import (
    CountedResult,
    EpisodeSettings,
    GaitSettings,
    ProtocolResult,
    Run,
    _batch_size,
    run_episodes,
)
from hugwbc.runtime.controllers import ControllerSpec

PLANS = [EpisodePlan(Command(w=w, gait=Gait.STANDING)) for w in (0.1, 0.2, 0.3, 0.4)]
FACTORY = ControllerSpec("hold").build


@dataclasses.dataclass(frozen=True)
class Ending:
    """Where an episode ended."""

    index: int
    waist: float
    place: tuple[float, ...]


def _ending(index: int, run: Run) -> Ending:
    qpos = run.trace.qpos[-1]
    return Ending(index, run.command.w, tuple(qpos[:3].tolist()))


def _settings(store: ResultStore | None, **changes) -> EpisodeSettings:
    conditions = Conditions(timestep=0.005, terrain_roughness=0.01)
    execution = Execution(changes.pop("workers", 1), store=store)
    return EpisodeSettings(duration=0.2, settle=0.1, conditions=conditions, execution=execution, **changes)


@pytest.fixture
def counted(monkeypatch):
    """Commanded waist angles of the episodes that are simulated here."""
    seen = []
    whole = episode._run

    def run(controller, job, index, plan):
        seen.append(plan.command.w)
        return whole(controller, job, index, plan)

    monkeypatch.setattr(episode, "_run", run)
    return seen


class _StopError(Exception):
    """What ends a run in the middle."""


def test_an_interrupted_run_goes_on_where_it_stopped(tmp_path, counted):
    alone = run_episodes(FACTORY, PLANS, _ending, _settings(None))
    counted.clear()

    def stop_after_two(row: Ending) -> None:
        if row.index == 1:
            raise _StopError

    with pytest.raises(_StopError):
        run_episodes(FACTORY, PLANS, _ending, _settings(ResultStore(tmp_path)), stop_after_two)
    assert counted == [0.1, 0.2]
    rows = []
    assert run_episodes(FACTORY, PLANS, _ending, _settings(ResultStore(tmp_path)), rows.append) == alone == rows
    assert counted == [0.1, 0.2, 0.3, 0.4]
    assert run_episodes(FACTORY, PLANS, _ending, _settings(ResultStore(tmp_path))) == alone
    assert len(counted) == 4, "a finished run is only read"


def test_stored_results_count_for_the_same_question_only(tmp_path, counted):
    run_episodes(FACTORY, PLANS[:1], _ending, _settings(ResultStore(tmp_path)))
    longer = dataclasses.replace(_settings(ResultStore(tmp_path)), duration=0.21)
    others = [
        (PLANS[1:2], _settings(ResultStore(tmp_path))),
        (PLANS[:1], _settings(ResultStore(tmp_path), seed=1)),
        (PLANS[:1], longer),
        ([dataclasses.replace(PLANS[0], conditions=Conditions(timestep=0.004))], _settings(ResultStore(tmp_path))),
    ]
    for number, (plans, settings) in enumerate(others):
        run_episodes(FACTORY, plans, _ending, settings)
        assert len(counted) == number + 2
    fresh = ResultStore(tmp_path, fresh=True)
    run_episodes(FACTORY, PLANS[:1], _ending, _settings(fresh))
    run_episodes(FACTORY, PLANS[:1], _ending, _settings(fresh))
    assert len(counted) == 6, "a fresh store runs it once more"


def test_a_foreign_file_in_the_way_is_refused(tmp_path):
    store = ResultStore(tmp_path)
    run_episodes(FACTORY, PLANS[:1], _ending, _settings(store))
    (path,) = tmp_path.iterdir()
    assert path.name.startswith("test_episodes-hold-")
    path.write_text('{"format": "hugwbc episodes", "version": 99}\n')
    with pytest.raises(ResultFileError, match="has format version 99"):
        run_episodes(FACTORY, PLANS[:1], _ending, _settings(ResultStore(tmp_path)))
    assert path.read_text().endswith("99}\n")


def test_batches_processes_and_stored_rows_give_the_same_numbers(tmp_path):
    factory = ControllerSpec("learned").build
    conditions = Conditions(timestep=0.005)
    rough = dataclasses.replace(conditions, terrain_roughness=0.01)
    plans = [
        EpisodePlan(Command(v_x=0.2 * i, gait=Gait.WALKING), conditions=rough if i == 2 else None) for i in range(5)
    ]

    def rows(execution: Execution, plans: list[EpisodePlan]) -> list[Ending]:
        settings = EpisodeSettings(duration=0.8, settle=0.1, conditions=conditions, execution=execution)
        return run_episodes(factory, plans, _ending, settings)

    timed = [dataclasses.replace(plan, timed=True) for plan in plans]
    alone = rows(Execution(), timed)
    assert _places(rows(Execution(), plans)) == pytest.approx(_places(alone), abs=1e-9)
    with Execution(2, store=ResultStore(tmp_path)) as execution:
        shared = rows(execution, plans)
    assert _places(shared) == pytest.approx(_places(alone), abs=1e-9)
    assert rows(Execution(store=ResultStore(tmp_path)), plans) == shared


def _places(rows: list[Ending]) -> list[float]:
    return [value for row in rows for value in (row.index, row.waist, *row.place)]


@pytest.mark.parametrize(
    ("count", "workers", "duration", "size"),
    [
        (0, 1, 10.0, 1),
        (5, 2, 10.0, 3),
        (64, 1, 10.0, 64),
        (1000, 1, 5.0, 250),
        (4096, 1, 10.0, 536),
        (100, 8, 10.0, 13),
    ],
)
def test_batches_are_as_large_as_memory_and_workers_allow(count, workers, duration, size):
    settings = EpisodeSettings(duration=duration, execution=Execution(workers))
    assert _batch_size(count, settings) == size


@dataclasses.dataclass(frozen=True)
class Fallen:
    """Whether an episode ended in a fall."""

    fell: bool


@dataclasses.dataclass(frozen=True, kw_only=True)
class Counted(CountedResult[Fallen]):
    """A result with a field of its own."""

    own: int


def test_a_result_says_what_its_settings_were_and_counts_falls():
    config = GaitSettings(Gait.HOPPING_LEFT, True, seed=3, duration=5.0, settle=2.0, conditions=Conditions(noise=True))
    rows = [Fallen(True), Fallen(False), Fallen(True)]
    assert Counted.of(FACTORY, config, rows, own=7) == Counted(
        **{"controller": "hold", "gait": "hopping", "seed": 3, "duration": 5.0, "settle": 2.0},
        **{"conditions": Conditions(noise=True), "rows": tuple(rows), "episodes": 3, "falls": 2, "own": 7},
    )
    assert ProtocolResult.of(FACTORY, config, PLANS).rows == tuple(PLANS)


@pytest.mark.slow
def test_a_killed_process_loses_only_what_was_under_way(tmp_path):
    words = ["evaluate", "small-velocities", "--controller", "qp", "--episodes", "8", "--duration", "2"]

    def start(folder: str) -> subprocess.Popen:
        places = ["--results", str(tmp_path / folder), "--json", str(tmp_path / f"{folder}.json")]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        return subprocess.Popen([sys.executable, "-m", "hugwbc.cli", *words, *places], **quiet)

    def lines() -> list[str]:
        return [line for path in (tmp_path / "cut").glob("*.jsonl") for line in path.read_text().splitlines()]

    assert start("whole").wait() == 0
    process = start("cut")
    while len(lines()) < 4 and process.poll() is None:
        time.sleep(0.05)
    process.kill()
    process.wait()
    kept = lines()
    assert 4 <= len(kept) < 9, "a head and some of the eight episodes"
    assert start("cut").wait() == 0
    assert lines()[: len(kept)] == kept and len(lines()) == 9
    assert (tmp_path / "cut.json").read_bytes() == (tmp_path / "whole.json").read_bytes()
