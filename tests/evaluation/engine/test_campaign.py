import dataclasses
import json

import pytest

from hugwbc import Gait
from hugwbc.errors import ResultFileError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.engine import Cell, CellResult, Execution, ResultStore, read_result, run_cells
from hugwbc.evaluation.protocols.small_velocities import SmallVelocitiesConfig, SmallVelocitiesProtocol
from hugwbc.runtime.controllers import ControllerSpec

HOLD = ControllerSpec("hold")
CONDITIONS = Conditions(timestep=0.005)
WALK = SmallVelocitiesConfig(Gait.WALKING, episodes=4, duration=0.3, settle=0.2, conditions=CONDITIONS)
HOP = dataclasses.replace(WALK, gait=Gait.HOPPING_LEFT, duration=0.6)


@pytest.fixture
def cells():
    """Two cells that count their runs."""
    runs = []

    def counting(factory, config, on_episode):
        runs.append(config.gait)
        return SmallVelocitiesProtocol().run(factory, config, on_episode)

    counting.__module__ = SmallVelocitiesProtocol.__module__
    return [Cell("small-velocities", HOLD, config, counting, config.episodes) for config in (WALK, HOP)], runs


def test_finished_cells_are_read_and_the_others_run(tmp_path, cells):
    cells, runs = cells
    told = []
    alone = run_cells(cells, Execution())
    first = run_cells(cells[:1], Execution(store=ResultStore(tmp_path)))
    assert run_cells(cells, Execution(store=ResultStore(tmp_path)), lambda *told_now: told.append(told_now)) == alone
    assert runs == [Gait.WALKING, Gait.HOPPING_LEFT, Gait.WALKING, Gait.HOPPING_LEFT]
    # The hops take twice as long; the walk was there.
    assert [done for done, _ in told] == pytest.approx([1 / 3, 1 / 2, 2 / 3, 5 / 6, 1.0, 1.0])
    assert [read for _, read in told] == pytest.approx([1 / 3] * 6)
    direct = json.loads(json.dumps(dataclasses.asdict(SmallVelocitiesProtocol().run(HOLD.build, WALK))))
    assert first == alone[:1] == [CellResult("small-velocities", "hold", direct)]
    run_cells(cells, Execution(store=ResultStore(tmp_path, fresh=True)))
    assert len(runs) == 6 and len(list(tmp_path.rglob("*.old"))) == 4


def test_episodes_that_are_only_read_are_told_from_those_that_are_run(tmp_path, cells):
    (cell, _), _ = cells
    told = []

    def stop_after_two(done: float, read: float) -> None:
        if done >= 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_cells([cell], Execution(store=ResultStore(tmp_path)), stop_after_two)
    run_cells([cell], Execution(store=ResultStore(tmp_path)), lambda *told_now: told.append(told_now))
    assert told == [(0.25, 0.25), (0.5, 0.5), (0.75, 0.5), (1.0, 0.5), (1.0, 0.5)]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "cannot read"),
        ("[]", "is not a result of an evaluation"),
        ('{"format": "hugwbc result", "version": 0}', "has format version 0"),
        ('{"format": "hugwbc result", "version": 1, "identity": {}}', "another cell than its name says"),
    ],
)
def test_files_in_the_way_are_refused_and_left_as_they_are(tmp_path, cells, text, message):
    cells, _ = cells
    run_cells(cells[:1], Execution(store=ResultStore(tmp_path)))
    (path,) = (tmp_path / "cells").iterdir()
    path.write_text(text)
    with pytest.raises(ResultFileError, match=message):
        run_cells(cells[:1], Execution(store=ResultStore(tmp_path)))
    assert path.read_text() == text


def test_a_result_that_cannot_be_written_is_told(tmp_path, cells):
    cells, _ = cells
    (tmp_path / "cells").write_text("in the way")
    with pytest.raises(ResultFileError, match=r"cannot write .*; choose another folder"):
        run_cells(cells[:1], Execution(store=ResultStore(tmp_path)))


def test_a_file_without_its_result_is_refused(tmp_path):
    path = tmp_path / "cell.json"
    path.write_text('{"format": "hugwbc result", "version": 1, "identity": {}}')
    with pytest.raises(ResultFileError, match="holds no result; nothing was changed"):
        read_result(path, {})
