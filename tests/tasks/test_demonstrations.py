"""Demonstrations: what is in a frame, and a data set that LeRobot's own reader of Parquet files reads."""

import dataclasses
import json
import pathlib

import datasets
import imageio.v2 as imageio
import numpy as np
import pandas
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from hugwbc import rotations
from hugwbc.behaviours import Action, Grip, View, reach, stand, walk_to
from hugwbc.cli import USAGE_ERROR, main
from hugwbc.commands import Command
from hugwbc.errors import ConfigError
from hugwbc.robot import load_robot
from hugwbc.runtime.controllers import HoldController
from hugwbc.runtime.sight import Sight
from hugwbc.runtime.trace import RECORD_PERIOD
from hugwbc.sim import Arena
from hugwbc.sim.scenes import Box, Scene, Table
from hugwbc.targets import HandTargets
from hugwbc.tasks import Milestone, Task, Verdict, load_task, run_task
from hugwbc.tasks.demonstration import ACTION_NAMES, FPS, Demonstration, demonstrate, state_names
from hugwbc.tasks.lerobot_dataset import DatasetWriter, features_of, read_frames
from hugwbc.tasks.replay import grips, recorded_action
from tests.conftest import make_state

ROBOT = load_robot("h1")
EXACT = Arena(sensing="exact")
DESK = Table(name="desk", position=(0.6, 0.0), size=(0.4, 1.2), height=0.8)
SCENE = Scene((DESK, Box(name="box", on="desk", size=(0.1, 0.1, 0.1), mass=0.5)))
NUMBER = {name: place for place, name in enumerate(ACTION_NAMES)}
STATE = {name: place for place, name in enumerate(state_names(ROBOT))}
PLACE = [NUMBER[f"left_hand.{axis}"] for axis in "xyz"]


def small(behaviour, limit=2.0) -> Task:
    return Task(
        name="small",
        about="Do next to nothing.",
        scene=SCENE,
        behaviour=lambda view, shapes: behaviour(view),
        limit=limit,
        milestones=(Milestone("it is not over", lambda record: float(record.ending.succeeded)),),
    )


def told(behaviour, limit=2.0) -> Demonstration:
    return demonstrate(small(behaviour, limit), HoldController(ROBOT), EXACT.simulation(scene=SCENE, seed=4), seed=4)


def stand_and_reach(view):
    view = yield from stand(view, 0.1)
    return (yield from reach(view, left=(0.3, 0.25, 0.2), frame="pelvis", timeout=0.4))


def made_up(name: str, frames: int, *, success: bool = True, steps=("walk", "press")) -> Demonstration:
    task, rng = load_task(name), np.random.default_rng(frames)
    return Demonstration(
        task=task,
        seed=frames,
        controller="qp",
        robot="h1",
        state=rng.normal(size=(frames, len(STATE))),
        objects=rng.normal(size=(frames, len(task.scene.body_names), 7)),
        action=rng.normal(size=(frames, len(ACTION_NAMES))),
        qpos=np.zeros((frames, 1)),
        steps=tuple(steps[place * len(steps) // frames] for place in range(frames)),
        verdict=Verdict(success, "" if success else "nobody pressed", "", 1.0 if success else 0.25),
    )


def written(folder: pathlib.Path, *episodes: Demonstration) -> pathlib.Path:
    tasks = list({episode.task.name: episode.task for episode in episodes}.values())
    with DatasetWriter(folder, tasks, ROBOT) as writer:
        for episode in episodes:
            writer.add(episode)
    return folder


def read_info(folder: pathlib.Path) -> dict:
    return json.loads((folder / "meta" / "info.json").read_text())


def hugging_face(info: dict) -> datasets.Features:
    """Types of the columns as LeRobot derives them from the features."""
    kinds = {}
    for key, feature in info["features"].items():
        kind, shape = datasets.Value(feature["dtype"]), feature["shape"]
        kinds[key] = kind if shape == [1] else datasets.Sequence(kind, length=shape[0])
    return datasets.Features(kinds)


def test_recording_changes_nothing_of_an_episode():
    task = small(stand_and_reach)
    plain = run_task(task, HoldController(ROBOT), EXACT.simulation(scene=SCENE, seed=4))
    found = told(stand_and_reach)
    assert found.verdict == plain.verdict and found.controller == plain.trace.name
    count = len(found.state)
    assert 0 < count <= len(plain.trace.time)
    joints = found.state[:, : len(ROBOT.joint_names)]
    np.testing.assert_array_equal(joints, plain.trace.qpos[:count, 7:])
    np.testing.assert_array_equal(found.objects, plain.trace.object_pose[:count])
    np.testing.assert_allclose(found.action[:, :8], plain.trace.command[:count])
    given = ~np.isnan(plain.trace.hand_target_world[:count, 0, 0])
    np.testing.assert_array_equal(found.action[:, NUMBER["left_hand.given"]], given)
    assert given.any() and not given.all()
    for row in np.flatnonzero(given):
        pelvis = plain.trace.qpos[row, :7]
        away = plain.trace.hand_target_world[row, 0] - pelvis[:3]
        wanted = away @ rotations.rotation_z(float(rotations.yaw_of(pelvis[3:])))
        np.testing.assert_allclose(found.action[row, PLACE], wanted, atol=1e-9)


def test_a_frame_without_a_target_holds_the_place_of_the_hand_and_the_step():
    found = told(stand_and_reach)
    assert set(found.steps) == {"stand", "reach"} and found.steps[0] == "stand"
    assert found.steps == tuple(sorted(found.steps, reverse=True)), "one step after the other"
    here = [STATE[f"left_hand.{axis}"] for axis in "xyz"]
    base = [STATE[f"base.{axis}"] for axis in "xyz"]
    first = found.action[0]
    assert first[NUMBER["left_hand.given"]] == 0.0
    np.testing.assert_allclose(first[PLACE], found.state[0, here] - found.state[0, base], atol=1e-6)
    last = found.action[-1]
    assert last[NUMBER["left_hand.given"]] == 1.0 and last[NUMBER["right_hand.given"]] == 0.0


def ask(view):
    """Ask for a grip at one tick, wait, let go at another, and wait."""
    for name in ("box", None):
        view = yield Action(grips=(Grip("right", name),))
        for _ in range(4):
            view = yield Action()
    return view


def test_a_gripper_stays_asked_until_it_is_let_go():
    found = told(ask)
    assert found.action[:, NUMBER["right_hand.grip"]].tolist() == [1.0] * 5 + [0.0] * 5
    assert set(found.action[:, NUMBER["left_hand.grip"]]) == {0.0}
    assert set(found.state[:, STATE["right_hand.holds"]]) == {0.0}, "it is out of reach"


def test_a_strong_grip_is_recorded_and_closes_as_strong_again():
    def hang(view):
        hook = Grip("right", "box", breaking_force=9.0, hook=True)
        view = yield Action(grips=(Grip("left", "box", breaking_force=300.0), hook))
        for _ in range(3):
            view = yield Action()
        return view

    found = told(hang)
    assert found.action[0, [NUMBER["left_hand.grip"], NUMBER["right_hand.grip"]]].tolist() == [2.0, -1.0]
    view = View(0.0, make_state(ROBOT.nominal, position=(0.0, 0.0, 1.0)), np.zeros((2, 3)))
    _, wanted = recorded_action(found.action[0], view)
    left, right = grips(view, wanted, [False, False], lambda side: ("box", False))
    assert (left.breaking_force, right.breaking_force) == (300.0, 150.0)
    for wanted, hook in ((2.0, False), (-2.0, True)):
        (left,) = grips(view, np.array([wanted, 0.0]), [False, False], lambda side: ("box", False))
        assert (left.breaking_force, left.hook) == (300.0, hook)
    smaller = dataclasses.replace(view, robot=load_robot("g1"))
    (left,) = grips(smaller, np.array([2.0, 0.0]), [False, False], lambda side: ("box", False))
    assert left.breaking_force == pytest.approx(120.2, abs=0.1), "what its task asks for in place of 300 N"


def test_the_time_limit_leaves_whole_frames():
    found = told(lambda view: stand(view, 10.0), limit=0.3)
    parts = (found.state, found.action, found.objects, found.steps)
    assert {len(part) for part in parts} == {round(0.3 / RECORD_PERIOD) - 1}
    assert not found.verdict.success


def test_objects_that_are_no_longer_seen_are_zeros(monkeypatch):
    look = Sight._objects

    def lost(self, picture, age):
        return look(self, None if picture is None or picture.time > 0.05 else picture, age)

    monkeypatch.setattr(Sight, "_objects", lost)
    objects = told(lambda view: stand(view, 0.2)).objects
    assert objects[0, :, 3].all()  # unit quaternions
    assert not objects[-1].any()


def test_a_controller_slower_than_the_frames_is_refused():
    slow = HoldController(ROBOT)
    slow.period = 0.04  # every other frame would be missing, and the times of the others wrong
    with pytest.raises(ConfigError, match="a demonstration has 50 frames per second"):
        demonstrate(small(stand_and_reach), slow, EXACT.simulation(scene=SCENE, seed=4), seed=4)


def test_hand_targets_without_a_place_in_a_frame_are_refused():
    def follow(view):
        for _ in range(20):
            view = yield Action(Command(), HandTargets(None, None, joints=np.zeros(8)))
        return view

    with pytest.raises(ConfigError, match="asks for targets of the arm joints, for which a demonstration has no"):
        told(follow)


def test_a_behaviour_that_fails_at_once_has_nothing_to_record():
    with pytest.raises(ConfigError, match=r"seed 4, has nothing to record: not done: it is not over .walk to: object"):
        told(lambda view: walk_to(view, before="what is not there"))


def test_the_layout_is_that_of_lerobot(tmp_path):
    episodes = (made_up("press_button", 40), made_up("press_button", 25, success=False, steps=("walk", "wait")))
    folder = written(tmp_path / "demos", *episodes)
    info = read_info(folder)
    assert info["codebase_version"] == "v3.0" and info["fps"] == FPS == 50
    assert (info["total_episodes"], info["total_frames"], info["total_tasks"]) == (2, 65, 1)
    assert info["splits"] == {"train": "0:2"}
    paths = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    assert paths == {
        "meta/info.json",
        "meta/stats.json",
        "meta/tasks.parquet",
        "meta/subtasks.parquet",
        "meta/episodes/chunk-000/file-000.parquet",
        info["data_path"].format(chunk_index=0, file_index=0),
        info["data_path"].format(chunk_index=0, file_index=1),
    }
    rows = datasets.Dataset.from_parquet(
        [str(path) for path in sorted(folder.glob("data/*/*.parquet"))],
        features=hugging_face(info),
        cache_dir=str(tmp_path / "cache"),
    ).with_format("numpy")
    assert rows.features == hugging_face(info) and len(rows) == 65
    for index, (episode, begin) in enumerate(zip(episodes, (0, 40), strict=True)):
        part = rows[begin : begin + len(episode.state)]
        np.testing.assert_allclose(part["observation.state"], episode.state, rtol=1e-6)
        np.testing.assert_allclose(part["action"], episode.action, rtol=1e-6)
        objects = episode.objects.reshape(len(episode.state), -1)
        np.testing.assert_allclose(part["observation.environment_state"], objects, rtol=1e-6)
        np.testing.assert_array_equal(part["frame_index"], range(len(episode.state)))
        np.testing.assert_allclose(part["timestamp"], np.arange(len(episode.state)) / FPS, rtol=1e-6)
        assert set(part["episode_index"]) == {index} and set(part["task_index"]) == {0}
        assert part["next.done"].tolist() == [False] * (len(episode.state) - 1) + [True]
        assert bool(part["next.success"][-1]) == episode.verdict.success
    np.testing.assert_array_equal(rows["index"], range(65))


@pytest.mark.parametrize(("name", "kind"), [("h1", "unitree_h1"), ("/my/robots/mini/mini.yaml", "mini")])
def test_the_type_of_a_robot_is_its_makers_or_ones_own(name, kind, tmp_path):
    with DatasetWriter(
        tmp_path / "demos", [load_task("press_button")], dataclasses.replace(ROBOT, name=name)
    ) as writer:
        writer.add(dataclasses.replace(made_up("press_button", 3), robot=name))
    assert read_info(tmp_path / "demos")["robot_type"] == kind


def test_words_are_looked_up_with_pandas(tmp_path):
    episodes = (made_up("press_button", 4), made_up("press_button", 4, steps=("walk", "wait")))
    folder = written(tmp_path / "demos", *episodes)
    tasks = pandas.read_parquet(folder / "meta" / "tasks.parquet")
    assert tasks.index.name == "task" and tasks.iloc[0].name == load_task("press_button").about
    assert tasks["task_index"].tolist() == [0]
    steps = pandas.read_parquet(folder / "meta" / "subtasks.parquet")
    frames = pq.read_table(folder / "data", columns=["subtask_index"])["subtask_index"]
    named = [steps.iloc[int(place)].name for place in frames.to_numpy()]
    assert named == ["walk", "walk", "press", "press", "walk", "walk", "wait", "wait"]


def test_episodes_say_where_their_frames_are_and_how_they_ended(tmp_path):
    folder = written(tmp_path / "demos", made_up("press_button", 40), made_up("press_button", 25, success=False))
    table = pandas.read_parquet(folder / "meta/episodes/chunk-000/file-000.parquet")
    assert table["episode_index"].tolist() == [0, 1] and table["length"].tolist() == [40, 25]
    assert table["dataset_from_index"].tolist() == [0, 40] and table["dataset_to_index"].tolist() == [40, 65]
    assert set(table["data/chunk_index"]) == {0} and table["data/file_index"].tolist() == [0, 1]
    assert [list(words) for words in table["tasks"]] == [[load_task("press_button").about]] * 2
    assert table["success"].tolist() == [True, False] and table["reason"].tolist() == ["", "nobody pressed"]
    assert table["suite_task"].tolist() == ["press_button"] * 2 and table["seed"].tolist() == [40, 25]
    assert list(table["objects"][0]) == list(load_task("press_button").scene.body_names)


def test_statistics_are_those_of_all_frames_and_of_each_episode(tmp_path):
    episodes = (made_up("press_button", 40), made_up("press_button", 25))
    folder = written(tmp_path / "demos", *episodes)
    stats = json.loads((folder / "meta" / "stats.json").read_text())
    assert set(stats) == set(read_info(folder)["features"])
    actions = np.concatenate([episode.action for episode in episodes])
    for name, value in (("min", actions.min(0)), ("mean", actions.mean(0)), ("std", actions.std(0))):
        np.testing.assert_allclose(stats["action"][name], value, atol=1e-6)
    np.testing.assert_allclose(stats["action"]["q50"], np.median(actions, axis=0), atol=1e-6)
    assert stats["action"]["count"] == [65] and len(stats["timestamp"]["mean"]) == 1
    rows = pq.read_table(folder / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    np.testing.assert_allclose(rows[1]["stats/action/max"], episodes[1].action.max(0), atol=1e-12)


def test_several_tasks_share_the_numbers_of_their_objects(tmp_path):
    one, other = made_up("press_button", 6), made_up("fetch_box", 5)
    counts = [len(episode.task.scene.body_names) for episode in (one, other)]
    folder = written(tmp_path / "demos", one, other)
    feature = read_info(folder)["features"]["observation.environment_state"]
    assert feature["shape"] == [7 * max(counts)] and feature["names"][7] == "object_1.x"
    frames = pq.read_table(folder / "data")
    assert frames["task_index"].to_pylist() == [0] * 6 + [1] * 5
    column = np.array(frames["observation.environment_state"].to_pylist())
    fewer = int(np.argmin(counts))
    rows = column[:6] if fewer == 0 else column[6:]
    assert not rows[:, 7 * min(counts) :].any() and rows[:, : 7 * min(counts)].all()
    alone = features_of([one.task], ROBOT)["observation.environment_state"]["names"]
    assert alone[0] == f"{one.task.scene.body_names[0]}.x"


@pytest.mark.parametrize("error", [KeyboardInterrupt, ConfigError])
def test_a_recording_that_was_stopped_keeps_its_complete_episodes(tmp_path, error):
    task, folder = load_task("press_button"), tmp_path / "demos"
    with pytest.raises(error), DatasetWriter(folder, [task], ROBOT) as writer:
        writer.add(made_up("press_button", 5))
        raise error
    assert list(tmp_path.iterdir()) == [folder]
    assert read_info(folder)["total_frames"] == 5


def test_a_killed_recording_is_continued_and_becomes_the_same_data_set(tmp_path):
    episodes = [made_up("press_button", 5), made_up("press_button", 6), made_up("press_button", 4)]
    episodes = [dataclasses.replace(episode, seed=seed) for seed, episode in enumerate(episodes)]
    whole = written(tmp_path / "whole", *episodes)
    killed = DatasetWriter(tmp_path / "demos", [load_task("press_button")], ROBOT)
    killed.__enter__()
    for episode in episodes[:2]:
        killed.add(episode)
    killed._only.close()  # the kernel takes the lock from a killed process
    staging = tmp_path / ".demos.partial"
    with (staging / "episodes.jsonl").open("a") as file:
        file.write('{"row": {"episode_index": 2, "tas')  # killed while it wrote
    (staging / "data/chunk-000/file-002.parquet").write_bytes(b"half")
    with DatasetWriter(tmp_path / "demos", [load_task("press_button")], ROBOT) as writer:
        assert writer.recorded == {("press_button", 0), ("press_button", 1)}
        writer.add(episodes[2])
    files = sorted(path.relative_to(whole) for path in whole.rglob("*") if path.is_file())
    assert files == sorted(p.relative_to(tmp_path / "demos") for p in (tmp_path / "demos").rglob("*") if p.is_file())
    for path in files:
        assert (tmp_path / "demos" / path).read_bytes() == (whole / path).read_bytes(), path


def test_two_recordings_and_other_settings_are_kept_apart(tmp_path):
    tasks = [load_task("press_button")]
    with DatasetWriter(tmp_path / "demos", tasks, ROBOT, settings={"controller": "qp"}) as writer:
        with (
            pytest.raises(ConfigError, match="another process is working"),
            DatasetWriter(tmp_path / "demos", tasks, ROBOT, settings={"controller": "qp"}),
        ):
            pass
        writer.add(made_up("press_button", 5))
        journal = (tmp_path / ".demos.partial" / "episodes.jsonl").read_bytes()
    (tmp_path / ".more.partial").mkdir()
    (tmp_path / ".more.partial" / "episodes.jsonl").write_bytes(journal)
    with (
        pytest.raises(ConfigError, match="other settings"),
        DatasetWriter(tmp_path / "more", tasks, ROBOT, settings={"controller": "learned"}),
    ):
        pass
    first, *others = tasks[0].scene.objects
    scene = dataclasses.replace(tasks[0].scene, objects=(dataclasses.replace(first, yaw=0.1), *others))
    edited = dataclasses.replace(tasks[0], scene=scene)
    with (
        pytest.raises(ConfigError, match="other settings or another scene"),
        DatasetWriter(tmp_path / "more", [edited], ROBOT, settings={"controller": "qp"}),
    ):
        pass
    assert (tmp_path / ".more.partial" / "episodes.jsonl").read_bytes() == journal


def test_nothing_is_left_of_a_recording_without_a_complete_episode(tmp_path):
    with pytest.raises(KeyboardInterrupt), DatasetWriter(tmp_path / "demos", [load_task("press_button")], ROBOT):
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("error", [OSError("no space left on device"), KeyboardInterrupt()])
def test_complete_episodes_outlive_a_recording_that_cannot_end(tmp_path, monkeypatch, error):
    """Such as with a full disk, or a second Ctrl-C."""

    def stop(*_: object, **__: object) -> None:
        raise error

    with (
        monkeypatch.context() as broken,
        pytest.raises(type(error)),
        DatasetWriter(tmp_path / "demos", [load_task("press_button")], ROBOT) as writer,
    ):
        writer.add(made_up("press_button", 5))
        broken.setattr(pq, "write_table", stop)  # in the middle of the second episode, and at the end
        writer.add(made_up("press_button", 5))
    with DatasetWriter(tmp_path / "demos", [load_task("press_button")], ROBOT) as writer:
        assert len(writer.recorded) == 1
        writer.add(made_up("press_button", 5))
    assert len(pq.read_table(tmp_path / "demos" / "meta/episodes")) == 2


def test_frames_out_of_order_and_those_of_another_episode_are_refused(tmp_path):
    folder = written(tmp_path / "demos", made_up("press_button", 5), made_up("press_button", 5))
    row = pq.read_table(folder / "meta/episodes").to_pylist()[0]
    path, other = sorted((folder / "data").glob("*/*.parquet"))
    assert read_frames(folder, row, "action").shape == (5, len(ACTION_NAMES))
    for table in (pq.read_table(path).take([0, 2, 1, 3, 4]), pq.read_table(other)):
        pq.write_table(table, path)
        with pytest.raises(ConfigError, match="has not the frames of episode 0 in their order; copy the data set"):
            read_frames(folder, row, "action")


def test_values_that_were_changed_are_refused(tmp_path):
    folder = written(tmp_path / "demos", made_up("press_button", 500))
    (row,) = pq.read_table(folder / "meta/episodes").to_pylist()
    (path,) = (folder / "data").glob("*/*.parquet")
    assert read_frames(folder, row, "action").shape == (500, len(ACTION_NAMES))
    table = pq.read_table(path)
    actions = np.array(table["action"].to_pylist(), dtype=np.float32)
    actions[7, 3] += 0.01
    column = pa.FixedSizeListArray.from_arrays(pa.array(actions.ravel()), type=table.schema.field("action").type)
    pq.write_table(table.set_column(table.schema.get_field_index("action"), "action", column), path)
    with pytest.raises(ConfigError, match="has other values of action than were recorded; copy the data set again"):
        read_frames(folder, row, "action")
    assert read_frames(folder, row, "observation.state").shape == (500, len(STATE))


def test_a_folder_is_never_overwritten(tmp_path):
    folder = tmp_path / "demos"
    folder.mkdir()
    with pytest.raises(ConfigError, match="never overwritten"):
        DatasetWriter(folder, [load_task("press_button")], ROBOT)
    with (
        pytest.raises(ConfigError, match="its name"),
        DatasetWriter(tmp_path / "new", [load_task("press_button")], ROBOT) as writer,
    ):
        writer.add(made_up("press_button", 5))
        (tmp_path / "new").mkdir()
        (tmp_path / "new" / "mine.txt").write_text("mine")
    (kept,) = tmp_path.glob(".new.*")
    assert sorted(path.name for path in tmp_path.iterdir()) == [kept.name, "demos", "new"]
    assert read_info(kept)["total_frames"] == 5
    assert (tmp_path / "new" / "mine.txt").read_text() == "mine"


def test_a_data_set_without_an_episode_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="no episode"), DatasetWriter(tmp_path / "a", [load_task("push_cart")], ROBOT):
        pass


def test_the_verb_lists_the_suite_and_records(tmp_path, monkeypatch, capsys, standing_task):
    monkeypatch.chdir(tmp_path)
    assert main(["tasks", "--task", "fetch_box", "open_drawer"]) == 0
    listed = capsys.readouterr().out
    assert load_task("fetch_box").about in listed and "attach" in listed
    words = ["tasks", "--task", str(standing_task()), "--controller", "hold", "--episodes", "2", "--seed", "7"]
    words += ["--record", "d/demos"]
    assert main(words) == 0
    assert "stand, seed 8" in capsys.readouterr().out
    assert read_info(tmp_path / "d" / "demos")["total_episodes"] == 2
    assert main(words) == USAGE_ERROR
    assert "never overwritten" in capsys.readouterr().err
    task = words[1:3]
    assert main(["tasks", *task, "--replay", "d/demos", "--episode", "1"]) == 0
    out = capsys.readouterr().out
    assert "episode 1: stand, seed 8, hold: not done: never" in out and "the base at most 0.0 mm off" in out
    assert "the same outcome in 1 of 1" in out
    assert main(["tasks", *task, "--replay", "d/demos", "--episode", "2"]) == USAGE_ERROR
    assert "episode is 2; d/demos has 0 to 1" in capsys.readouterr().err
    assert main(["tasks", "--replay", "d/demos"]) == USAGE_ERROR
    assert "the recording runs stand; give --task FILE.py, its file, to allow it" in capsys.readouterr().err
    frames = pathlib.Path("d/demos/data/chunk-000/file-001.parquet")
    frames.write_bytes(frames.read_bytes()[:1000])
    assert main(["tasks", *task, "--replay", "d/demos", "--episode", "1"]) == USAGE_ERROR
    assert f"cannot read {frames}: " in capsys.readouterr().err
    info = pathlib.Path("d/demos/meta/info.json")
    info.write_text(info.read_text().replace(".force_on_", ".force_"))  # as before forces acted on the hands
    assert main(["tasks", *task, "--replay", "d/demos"]) == USAGE_ERROR
    assert "whose actions differ: left_hand.force_on_x" in capsys.readouterr().err


def test_two_files_with_tasks_of_one_name_are_refused(tmp_path, monkeypatch, standing_task, capsys):
    """Episodes of the second one would count as recorded."""
    monkeypatch.chdir(tmp_path)
    first = standing_task()
    other = first.with_name("other.py")
    other.write_text(first.read_text())
    assert main(["tasks", "--task", str(first), str(other), "--controller", "hold", "--record", "demos"]) == USAGE_ERROR
    assert "tasks are stand, stand; give at least one, each once" in capsys.readouterr().err


def test_films_of_cameras_are_where_lerobot_looks_for_them(tmp_path, monkeypatch, standing_task):
    monkeypatch.chdir(tmp_path)
    words = ["tasks", "--task", str(standing_task()), "--controller", "hold", "--episodes", "1", "--record", "demos"]
    assert main([*words, "--cameras", "head", "front"]) == 0
    info = read_info(pathlib.Path("demos"))
    (row,) = pq.read_table("demos/meta/episodes").to_pylist()
    stats = json.loads(pathlib.Path("demos/meta/stats.json").read_text())
    for key in ("observation.images.head", "observation.images.front"):
        assert info["features"][key]["dtype"] == "video" and info["features"][key]["shape"] == [224, 224, 3]
        assert np.shape(stats[key]["mean"]) == (3, 1, 1) and 0.0 < stats[key]["mean"][0][0][0] < 1.0
        place = {name: row[f"videos/{key}/{name}"] for name in ("chunk_index", "file_index")}
        film = imageio.get_reader(pathlib.Path("demos") / info["video_path"].format(video_key=key, **place))
        assert film.count_frames() == row["length"] == round(row[f"videos/{key}/to_timestamp"] * info["fps"])
        assert film.get_data(row["length"] - 1).std() > 0.5, "no blank picture"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--episodes", "3"], "--record"),
        (["--cameras", "head"], "--record"),
        (["--episode", "3"], "--episode --replay FOLDER"),
        (["--replay", "out", "--seed", "3"], "--seed does nothing here: a replay has it from its data set"),
        (["--replay", "out"], "out is no data set of `hugwbc tasks --record`"),
        (["--record", "new", "--cameras", "heed"], "Did you mean 'head'"),
        (["--record", "new", "--episodes", "0"], "episodes is 0"),
        (["--record", "new", "--seed", "-1"], "seed is -1; it should be greater than or equal to 0"),
        (["--task", "fetch_box", "fetch_box"], "each once"),
    ],
)
def test_the_verb_refuses_bad_options_and_leaves_nothing(words, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["tasks", *words]) == USAGE_ERROR
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
