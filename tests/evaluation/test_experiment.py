"""Rows are kept, an interrupted run goes on, and processes share the episodes."""

import dataclasses
import json
import shutil

import pytest

from hugwbc import Command
from hugwbc.errors import ConfigError, HugwbcError
from hugwbc.evaluation import episode, store
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.episode import CountedSettings, ending, simulate
from hugwbc.evaluation.execution import Execution
from hugwbc.evaluation.experiment import Experiment, run_experiment
from hugwbc.evaluation.experiments import behaviours
from hugwbc.evaluation.experiments.behaviours import BehavioursSettings
from hugwbc.evaluation.experiments.random_commands import EXPERIMENT, RandomCommandsSettings
from hugwbc.evaluation.figures import Figure
from hugwbc.evaluation.intervals import bootstrap_mean
from hugwbc.evaluation.plans import Plan
from hugwbc.evaluation.store import Store, table_key
from hugwbc.gait import Gait
from hugwbc.runtime.controllers import ControllerSpec
from hugwbc.source import source_commit

HOLD = ControllerSpec("hold")
SETTINGS = CountedSettings(
    duration=0.2, settle=0.1, episodes=4, conditions=Conditions(timestep=0.005, terrain_roughness=0.01)
)


def plan(settings):
    return [Plan(draw, Command(w=0.1 * draw), {"waist": 0.1 * draw}) for draw in range(settings.episodes)]


def measure(controller, settings, plan):
    trace = simulate(controller, settings, plan)
    return {"place": trace.qpos[-1, :3].tolist(), **ending(trace)}


def figures(settings, rows):
    return [Figure("Places", "x", "m", bootstrap_mean(place[0] for place in rows["place"]))]


WAISTS = Experiment("waists", "turn the waist", CountedSettings, plan, measure, figures)


@pytest.fixture
def counted(monkeypatch):
    """Commanded waist angles of the episodes that are simulated here."""
    seen, whole = [], episode.rollout
    monkeypatch.setattr(episode, "rollout", lambda *a, **k: (seen.append(a[1].command_at(0.0).w), whole(*a, **k))[1])
    return seen


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """The result of an experiment, and the file that stores it."""
    folder = tmp_path_factory.mktemp("measured")
    result = run_experiment(WAISTS, SETTINGS, HOLD, store=Store(folder))
    (path,) = folder.iterdir()
    return result, path


@pytest.fixture
def stored(measured, tmp_path):
    """A copy of the file in the test's own folder."""
    return shutil.copy(measured[1], tmp_path / measured[1].name)


def test_an_interrupted_run_goes_on_where_it_stopped_and_has_the_same_numbers(tmp_path, measured, counted):
    alone = measured[0]
    assert [row["waist"] for row in alone.rows] == [0.0, 0.1, 0.2, 0.1 * 3] and alone.figures[0].controller == "hold"

    def stop(done):
        if done == 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_experiment(WAISTS, SETTINGS, HOLD, store=Store(tmp_path), on_progress=stop)
    (path,) = tmp_path.iterdir()
    path.write_text(path.read_text() + '{"_episode": "half a li')  # as a kill leaves it
    told = []
    again = run_experiment(WAISTS, SETTINGS, HOLD, store=Store(tmp_path), on_progress=told.append)
    assert again == alone and counted == pytest.approx([0.0, 0.1, 0.2, 0.3]) and told == [0.75, 1.0]
    assert run_experiment(WAISTS, SETTINGS, HOLD, store=Store(tmp_path)) == alone and len(counted) == 4
    assert run_experiment(WAISTS, SETTINGS, HOLD, store=Store(tmp_path, fresh=True)) == alone and len(counted) == 8
    assert run_experiment(WAISTS, SETTINGS, HOLD, store=Store(tmp_path)) == alone and len(counted) == 8
    assert {"waist", "place", "fell"} < set(json.loads(path.read_text().splitlines()[1]))


def test_episodes_that_are_none_or_say_two_things_are_refused():
    with pytest.raises(ConfigError, match="experiment 'waists' plans no episode"):
        run_experiment(dataclasses.replace(WAISTS, plan=lambda settings: []), SETTINGS, HOLD)
    twice = dataclasses.replace(WAISTS, episode=lambda controller, settings, plan: {"waist": 3.0})
    with pytest.raises(ConfigError, match="row has waist, as its plan's tags do"):
        run_experiment(twice, SETTINGS, HOLD)


@pytest.mark.parametrize("name", ["hold", "qp", "learned"])
def test_two_processes_give_the_numbers_of_one(tmp_path, name):
    controller = ControllerSpec(name)
    settings = RandomCommandsSettings(episodes=5, duration=0.3, settle=0.1)
    alone = run_experiment(EXPERIMENT, settings, controller)
    with Execution(2) as execution:
        assert run_experiment(EXPERIMENT, settings, controller, execution=execution, store=Store(tmp_path)) == alone


def test_a_table_is_of_one_experiment_controller_setting_file_and_commit(tmp_path, monkeypatch):
    (tmp_path / "clip.npz").write_bytes(b"one")
    moved = dataclasses.replace(SETTINGS, conditions=Conditions(intervention="motion", motions=str(tmp_path)))
    keys = [
        table_key("waists", measure, SETTINGS, HOLD),
        table_key("other", measure, SETTINGS, HOLD),
        table_key("waists", measure, SETTINGS, ControllerSpec("qp")),
        table_key("waists", measure, dataclasses.replace(SETTINGS, seed=1), HOLD),
        table_key("waists", measure, moved, HOLD),
    ]
    (tmp_path / "clip.npz").write_bytes(b"two")
    keys.append(table_key("waists", measure, moved, HOLD))
    for content in ("one", "two"):
        (tmp_path / "walk.csv").write_text(content)
        keys.append(table_key("waists", measure, moved, HOLD))
    installed = store.importlib.metadata.version
    for package in ("sapien", "onnxruntime"):  # the second engine, and exported policies
        with monkeypatch.context() as other:
            other.setattr(
                store.importlib.metadata, "version", lambda name, new=package: "0.1" if name == new else installed(name)
            )
            keys.append(table_key("waists", measure, SETTINGS, HOLD))
    monkeypatch.setattr(store, "versions", lambda: {"mujoco": "1.0"})
    keys.append(table_key("waists", measure, SETTINGS, HOLD))
    monkeypatch.setattr(store, "source_commit", lambda **which: "another")
    keys.append(table_key("waists", measure, SETTINGS, HOLD))
    assert len({json.dumps(key) for key in keys}) == len(keys) and source_commit()


def test_a_users_own_code_may_load_any_shipped_policy(tmp_path, monkeypatch):
    file = tmp_path / "mine.py"
    file.write_text(
        "from hugwbc.runtime.controllers import HoldController as Mine\n\n\ndef still(view):\n    yield None\n"
    )
    monkeypatch.setattr(store, "source_commit", lambda *, policies: f"policies count: {policies}")
    ours, own = BehavioursSettings(behaviour="fetch_cup"), BehavioursSettings(behaviour=f"{file}:still")
    for settings, spec, counts in (
        (ours, HOLD, False),
        (own, HOLD, True),
        (ours, ControllerSpec(f"{file}:Mine"), True),
    ):
        assert table_key("behaviours", behaviours.episode, settings, spec)["commit"] == f"policies count: {counts}"


def test_a_file_that_is_no_table_is_refused_and_left(tmp_path, stored):
    for text in ("no json\n", '{"settings": {}}\n'):
        stored.write_text(text)
        with pytest.raises(ConfigError, match="not a table of episodes"):
            run_experiment(WAISTS, SETTINGS, HOLD, store=Store(tmp_path))
        assert stored.read_text() == text


def test_a_controller_whose_files_change_during_a_search_is_refused(tmp_path):
    """Its rows would be of two controllers, in the table of the first one."""
    file = tmp_path / "own.py"
    text = "from hugwbc.runtime.controllers import HoldController as Own\n"
    file.write_text(text)

    def following(settings, rows):
        file.write_text(text + "# changed\n")
        return [Plan(len(rows), Command(w=0.1))] if len(rows) < 2 else []

    search = dataclasses.replace(WAISTS, plan=lambda settings: [Plan(0, Command(w=0.1))], following=following)
    with pytest.raises(ConfigError, match="have changed during the run; run it again with what they are now"):
        run_experiment(search, SETTINGS, ControllerSpec(f"{file}:Own"))


def test_a_search_goes_on_until_nothing_follows(tmp_path):
    def following(settings, rows):
        return [] if len(rows) >= 3 else [Plan(len(rows), Command(w=0.1))]

    search = dataclasses.replace(WAISTS, plan=lambda settings: following(settings, ()), following=following)
    first = run_experiment(search, SETTINGS, HOLD, store=Store(tmp_path))
    assert len(first.rows) == 3 and run_experiment(search, SETTINGS, HOLD, store=Store(tmp_path)) == first


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"duration": 0.5}, "give 0 <= settle < duration"),
        ({"duration": float("nan")}, "duration"),
        ({"seed": -1}, "seed is -1"),
        ({"episodes": 0}, "episodes is 0"),
        ({"gait": "waking"}, "gait 'waking'. Did you mean 'walking'"),
        ({"conditions": Conditions(slope=0.05), "duration": 600.0}, "give up to 200 s"),
    ],
)
def test_bad_settings_are_refused(changes, message):
    with pytest.raises(HugwbcError, match=message):
        CountedSettings(**changes)


def test_hopping_takes_turns():
    assert CountedSettings(gait="hopping").gaits == (Gait.HOPPING_LEFT, Gait.HOPPING_RIGHT)
    assert CountedSettings(gait="hopping_right").gaits == (Gait.HOPPING_RIGHT, Gait.HOPPING_RIGHT)
