import json
import pathlib
import time

import pytest

from hugwbc.errors import RecipeError
from hugwbc.learned.recipe import ledger
from hugwbc.learned.recipe.ledger import Session, Spent, cpu_seconds, only_process, read_sessions, spent_on


def test_what_is_spent_is_booked_on_the_stage(tmp_path: pathlib.Path) -> None:
    session = Session(tmp_path)
    session.enter("labels~1")
    session.work(labels=10)
    begin = cpu_seconds()
    while cpu_seconds() - begin < 0.1:
        sum(range(10_000))
    session.enter("gaits~1")
    session.work(steps=64)
    session.work(steps=64, episodes=2)
    session.end("finished")
    (record,) = read_sessions(tmp_path)
    assert record.spent["labels~1"].labels == 10 and record.spent["labels~1"].cpu_seconds >= 0.1
    assert record.spent["gaits~1"].steps == 128 and record.spent["gaits~1"].cpu_seconds < 0.1
    assert record.ended is not None and record.ended.endswith("finished")
    assert {"torch", "mujoco"} <= set(record.versions)
    everything = spent_on(read_sessions(tmp_path))
    assert (everything.steps, everything.labels, everything.episodes) == (128, 10, 2)
    assert spent_on(read_sessions(tmp_path), "gaits~1").steps == 128


def test_a_killed_session_has_no_end_but_what_it_has_written(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ledger, "_WRITE_INTERVAL", 0.0)
    session = Session(tmp_path)
    session.enter("gaits~1")
    session.work(steps=64)
    del session
    later = Session(tmp_path)
    later.end("finished")
    first, second = read_sessions(tmp_path)
    assert first.ended is None and first.spent["gaits~1"].steps == 64
    assert (first.number, second.number) == (1, 2)


def test_it_is_written_every_few_seconds_and_not_at_every_call(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = Session(tmp_path)
    session.enter("gaits~1")
    clock = time.monotonic()
    for seconds, written in ((1.0, 0), (4.9, 0), (5.1, 3)):
        monkeypatch.setattr(time, "monotonic", lambda s=seconds: clock + s)
        session.work(steps=1)
        assert sum(one.steps for record in read_sessions(tmp_path) for one in record.spent.values()) == written


def test_sums_and_core_hours() -> None:
    a, b = Spent(cpu_seconds=1800.0, steps=5.0), Spent(cpu_seconds=5400.0, labels=2.0)
    assert (a + b).core_hours == 2.0 and (a + b) - b == a


def test_a_damaged_session_is_refused(tmp_path: pathlib.Path) -> None:
    Session(tmp_path).end("finished")
    path = tmp_path / "sessions" / "0001.json"
    content = json.loads(path.read_text())
    for damage in ("{", "[]", json.dumps({**content, "spent": {"a": {"steps": 1}}}), json.dumps({"spent": {}})):
        path.write_text(damage)
        with pytest.raises(RecipeError, match=r"0001\.json is not a readable record.*not counted in full"):
            read_sessions(tmp_path)


def test_the_lock_is_free_again_afterwards(tmp_path: pathlib.Path) -> None:
    with only_process(tmp_path), pytest.raises(RecipeError, match="another process"), only_process(tmp_path):
        pass
    with only_process(tmp_path):
        pass


def test_the_commit_of_the_source_tree_is_recorded(monkeypatch: pytest.MonkeyPatch) -> None:
    commit, changed = ledger.source_state()
    assert commit == ledger.UNKNOWN or len(commit) == 40
    assert isinstance(changed, bool)
    monkeypatch.setattr(ledger.shutil, "which", lambda name: None)
    assert ledger.source_state() == (ledger.UNKNOWN, False)
