import dataclasses
import inspect
import pathlib
import sys

import numpy as np
import pytest

from hugwbc.behaviours import stand
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.evaluation.comparison import compare, headline
from hugwbc.robot import load_robot
from hugwbc.runtime.controllers import HoldController
from hugwbc.sim import Arena, Simulation
from hugwbc.tasks import TASK_NAMES, Milestone, load_task, run_task, shapes_of
from hugwbc.tasks.task import SCENES
from hugwbc.upper_ik import UpperBodySource


@pytest.mark.parametrize("name", TASK_NAMES)
def test_a_task_has_its_name_its_scene_and_a_behaviour(name):
    task = load_task(name)
    assert task.name == name and task.about.endswith(".") and task.scene.varies
    assert (SCENES / f"{name}.yaml").is_file()
    timeout = inspect.signature(task.behaviour).parameters["timeout"].default
    assert 0.0 < timeout < task.limit, "a behaviour ends before the task's limit"


@pytest.mark.parametrize("robot", ["h1", "h1-2023"])
def test_the_arms_are_those_of_the_robot_that_plays(robot, monkeypatch):
    moved = []

    class Noted(UpperBodySource):
        def update(self, *given):
            moved.append(self.ik.robot.name)
            return super().update(*given)

    # The package has a function of the module's name.
    monkeypatch.setattr(sys.modules["hugwbc.tasks.run_task"], "UpperBodySource", Noted)
    task, arena = load_task("press_button"), Arena(robot=robot, sensing="exact")
    run_task(
        dataclasses.replace(task, limit=0.1), HoldController(load_robot(robot)), arena.simulation(scene=task.scene)
    )
    assert set(moved) == {robot}


def test_a_simulation_can_be_used_again():
    task = dataclasses.replace(load_task("press_button"), limit=0.1)
    simulation = Arena(sensing="exact").simulation(scene=task.scene)
    times = [run_task(task, HoldController(load_robot()), simulation).record.time.tolist() for _ in range(2)]
    assert times[0] == times[1] and len(times[0]) == 5


def test_a_success_without_an_end_took_the_whole_time(standing_task):
    task = dataclasses.replace(load_task(str(standing_task("Milestone('unmet', lambda record: 1.0)"))), limit=0.06)
    (run,) = compare({"hold": HoldController(load_robot())}, task, arena=Arena(sensing="exact"))
    assert headline({"hold": run.outcome}) == "hold did the task in 0.1 s."
    assert run.outcome["verdict"]["seconds"] == 0.06
    undone = dataclasses.replace(task, milestones=(Milestone("unmet", lambda record: 0.0),))
    (run,) = compare({"hold": HoldController(load_robot())}, undone, arena=Arena(sensing="exact"))
    assert run.outcome["verdict"]["seconds"] is None


def test_a_behaviour_that_ends_in_the_period_of_a_fall_has_a_time(standing_task, monkeypatch):
    monkeypatch.setattr(Simulation, "fallen", True)
    task = load_task(str(standing_task()))
    simulation = Arena(sensing="exact").simulation(scene=task.scene)
    run = run_task(task, HoldController(load_robot()), simulation, behaviour=lambda view: iter(()))
    assert run.record.fell and run.seconds == pytest.approx(0.002)


def test_a_fall_is_not_said_to_be_the_end_of_the_time(standing_task, monkeypatch):
    task = load_task(str(standing_task()))
    for fallen, words in ((False, "the time was over during stand"), (True, "during stand")):
        monkeypatch.setattr(Simulation, "fallen", fallen)
        simulation = Arena(sensing="exact").simulation(scene=task.scene)
        short = dataclasses.replace(task, limit=0.1)
        run = run_task(short, HoldController(load_robot()), simulation, behaviour=lambda view: stand(view, 1.0))
        assert run.record.ending.reason == words and run.seconds is None


@pytest.mark.parametrize("name", TASK_NAMES)
def test_scenes_can_be_drawn_with_any_seed(name):
    scene = load_task(name).scene
    assert len({scene.draw(seed) for seed in range(20)}) == 20


def test_behaviours_are_told_dimensions_and_nothing_else():
    shapes = shapes_of(load_task("fetch_box").scene.draw(0))
    assert set(shapes) == {"desk", "box", "bench"}
    assert set(shapes["box"]) == {"size"} and set(shapes["desk"]) == {"size", "height"}
    button = shapes_of(load_task("press_button").scene.draw(0))["button"]
    assert "force" not in button and button["travel"] == 0.02


def test_a_task_of_ones_own_is_a_file(standing_task):
    assert load_task(str(standing_task())).name == "stand"


def test_what_is_no_task_is_refused(tmp_path):
    with pytest.raises(UnknownNameError, match="press_button"):
        load_task("press_buton")
    with pytest.raises(ConfigError, match="there is no file"):
        load_task(str(tmp_path / "none.py"))
    path = tmp_path / "own.py"
    for text, message in (
        ("TASK = 3", "has no task"),
        ("TASK = (", "SyntaxError"),
        ("import nowhere_at_all", "nowhere"),
    ):
        path.write_text(text)
        with pytest.raises(ConfigError, match=message):
            load_task(str(path))


def test_every_task_has_a_row_in_the_page():
    page = (pathlib.Path(__file__).parents[2] / "docs" / "tasks.md").read_text()
    suite = page.partition("## The suite\n")[2].partition("\n## ")[0]
    for name in TASK_NAMES:
        (row,) = [line for line in suite.splitlines() if line.startswith(f"| `{name}` |")]
        task = load_task(name)
        assert f"| {task.limit:g} |" in row
        assert ("`attach`" in row) == ("attach" in task.idealised)


@pytest.mark.parametrize("name", TASK_NAMES)
def test_every_task_has_the_size_of_the_robot(name):
    """Lengths follow the height of the shoulders, and masses its third power; the H1's layouts are as they are."""
    task, g1 = load_task(name), load_robot("g1")
    assert task.sized(load_robot("h1")) == task.sized(load_robot("h1-2023")) == task
    size = (g1.nominal_height + g1.shoulder[2]) / (0.98 + load_robot("h1").shoulder[2])
    sized = task.sized(g1)
    assert sized.sized(g1).size == sized.size == pytest.approx(size)
    for thing, one in zip(task.scene.draw(3).objects, sized.scene.draw(3).objects, strict=True):
        assert one.position == pytest.approx(tuple(size * value for value in thing.position))
        assert getattr(one, "mass", 0.0) == pytest.approx(size**3 * getattr(thing, "mass", 0.0))
        assert (one.name, one.yaw, one.friction) == (thing.name, thing.yaw, thing.friction)


def test_a_robot_with_short_arms_is_refused():
    short = dataclasses.replace(load_robot("g1"), forearm=0.1)
    with pytest.raises(ConfigError, match=r"'fetch_box' is made for h1; it is 0.74 times as large for g1"):
        load_task("fetch_box").sized(short)


def test_a_task_in_the_size_of_another_robot_is_refused():
    """A G1 would fail in the layout of an H1, and nobody would know why."""
    task, controller = load_task("press_button"), HoldController(load_robot("g1"))
    simulation = Simulation(robot="g1", scene=task.scene)
    with pytest.raises(ConfigError, match=r"'press_button' has size 1.00, but 0.74 for g1; give task.sized\(robot\)"):
        run_task(task, controller, simulation)


def test_a_record_is_judged_in_the_lengths_that_milestones_are_made_for(made_up):
    record = made_up("press_button")
    half = record.scaled(0.5)
    np.testing.assert_allclose(half.pelvis[:, :3], 0.5 * record.pelvis[:, :3])
    np.testing.assert_array_equal(half.pelvis[:, 3:], record.pelvis[:, 3:])
    again = half.scaled(2.0)
    np.testing.assert_allclose(again.travel["button"], record.travel["button"])
    assert half.thing("button").travel == pytest.approx(0.5 * record.thing("button").travel)
