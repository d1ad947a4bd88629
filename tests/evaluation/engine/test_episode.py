"""Episodes by plan have their own seed and conditions, are stored and resumed, and share controllers."""

import dataclasses
import functools
import pathlib
import threading

import numpy as np
import pytest

from hugwbc import Command, Gait
from hugwbc.errors import ResultFileError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.engine import (
    EpisodePlan,
    EpisodeSettings,
    Execution,
    ResultStore,
    Run,
    controller_of,
    episode,
    run_episodes,
)
from hugwbc.evaluation.engine.episode import Job, run_job
from hugwbc.runtime.controllers import ControllerSpec, HoldController
from hugwbc.sim.sensors import EXACT, PROFILES

STAND = EpisodePlan(Command())


class _Factory:
    """Counts what it makes; equal to others of the same name, as a copy from another process is."""

    made = 0

    def __init__(self, name):
        self.name = name

    def __eq__(self, other):
        return isinstance(other, _Factory) and self.name == other.name

    def __hash__(self):
        return hash(self.name)

    def build(self):
        _Factory.made += 1
        return HoldController()


@dataclasses.dataclass(frozen=True)
class _Facts:
    index: int
    command: Command
    qpos: np.ndarray
    arm_error: float


def _judge(index, run):
    return _Facts(index, run.command, run.trace.qpos, run.arm_error)


def _run(episodes, *, seed=0, conditions=None):
    jobs = [Job(HoldController, _judge, seed, 0.1, 0.0, conditions or Conditions(), *episode) for episode in episodes]
    rows = list(map(run_job, jobs))
    assert all(index == row.index for index, row in rows)
    return dict(rows)


def test_an_episode_is_the_same_whoever_runs_beside_it_and_another_with_another_seed():
    arms = Conditions(intervention="noise")
    rows = _run([(3, STAND), (4, STAND)], conditions=arms)
    third, fourth = (_run([(index, STAND)], conditions=arms)[index] for index in (3, 4))
    assert np.array_equal(rows[3].qpos, third.qpos) and np.array_equal(rows[4].qpos, fourth.qpos)
    other = _run([(3, STAND)], seed=1, conditions=arms)[3]
    assert not np.array_equal(third.qpos, fourth.qpos) and not np.array_equal(third.qpos, other.qpos)
    drawn = _run([(9, dataclasses.replace(STAND, draw=3))], conditions=arms)[9]
    assert np.array_equal(drawn.qpos, third.qpos), "a plan with a draw has that in place of its index"


def test_the_arms_error_is_known_where_something_moves_them():
    assert np.isnan(_run([(0, STAND)])[0].arm_error)
    assert 0.0 < _run([(0, STAND)], conditions=Conditions(intervention="noise"))[0].arm_error < 1.0


def test_a_plans_own_conditions_go_before_the_jobs():
    own = dataclasses.replace(STAND, conditions=Conditions(payload=30.0))
    rows = _run([(0, STAND), (1, own)])
    assert not np.array_equal(rows[0].qpos, rows[1].qpos)


def test_a_policy_written_anew_under_the_same_name_is_read_anew():
    """A calibration writes each of its trials to one file."""
    _Factory.made = 0
    for made in (1, 2):
        run_episodes(_Factory("trial").build, [STAND, STAND], _judge, EpisodeSettings(duration=0.1, settle=0.0))
        assert _Factory.made == made


def test_a_controller_is_made_once_for_equal_factories_in_each_thread():
    _Factory.made = 0
    first = controller_of(_Factory("a").build)
    assert controller_of(_Factory("a").build) is first, "a bound method of an equal object is the same factory"
    assert controller_of(_Factory("b").build) is not first and _Factory.made == 2
    others = []
    thread = threading.Thread(target=lambda: others.append(controller_of(_Factory("b").build)))
    thread.start()
    thread.join()
    assert _Factory.made == 3 and others[0] is not controller_of(_Factory("b").build)
    assert controller_of(functools.partial(HoldController)) is not controller_of(HoldController)


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


def _in_arena(drives: str, folder: pathlib.Path) -> EpisodeSettings:
    return dataclasses.replace(
        _settings(ResultStore(folder)), conditions=Conditions(drives=drives, sensing="exact", timestep=0.005)
    )


def test_stored_results_never_mix_arenas(tmp_path, counted, monkeypatch):
    rows = [run_episodes(FACTORY, PLANS[:1], _ending, _in_arena(drives, tmp_path)) for drives in ("ideal", "real")]
    assert len(counted) == 2 and rows[0] != rows[1]
    assert len(list(tmp_path.glob("*.jsonl"))) == 2, "a file for each arena"
    again = [run_episodes(FACTORY, PLANS[:1], _ending, _in_arena(drives, tmp_path)) for drives in ("ideal", "real")]
    assert again == rows
    assert len(counted) == 2
    # The same name for other sensors is another arena, too.
    monkeypatch.setitem(PROFILES, "exact", dataclasses.replace(EXACT, gyro=0.001))
    run_episodes(FACTORY, PLANS[:1], _ending, _in_arena("real", tmp_path))
    assert len(counted) == 3


def test_a_foreign_file_in_the_way_is_refused(tmp_path):
    store = ResultStore(tmp_path)
    run_episodes(FACTORY, PLANS[:1], _ending, _settings(store))
    (path,) = tmp_path.iterdir()
    assert path.name.startswith("test_episode-hold-")
    path.write_text('{"format": "hugwbc episodes", "version": 99}\n')
    with pytest.raises(ResultFileError, match="has format version 99"):
        run_episodes(FACTORY, PLANS[:1], _ending, _settings(ResultStore(tmp_path)))
    assert path.read_text().endswith("99}\n")


def test_processes_and_stored_rows_give_the_same_numbers(tmp_path):
    factory = ControllerSpec("learned").build
    conditions = Conditions(timestep=0.005)
    rough = dataclasses.replace(conditions, terrain_roughness=0.01)
    plans = [
        EpisodePlan(Command(v_x=0.2 * i, gait=Gait.WALKING), conditions=rough if i == 2 else None) for i in range(5)
    ]

    def rows(execution: Execution, plans: list[EpisodePlan]) -> list[Ending]:
        settings = EpisodeSettings(duration=0.8, settle=0.1, conditions=conditions, execution=execution)
        return run_episodes(factory, plans, _ending, settings)

    alone = rows(Execution(), plans)
    with Execution(2, store=ResultStore(tmp_path)) as execution:
        shared = rows(execution, plans)
    assert _places(shared) == pytest.approx(_places(alone), abs=1e-9)
    assert rows(Execution(store=ResultStore(tmp_path)), plans) == shared


def _places(rows: list[Ending]) -> list[float]:
    return [value for row in rows for value in (row.index, row.waist, *row.place)]
