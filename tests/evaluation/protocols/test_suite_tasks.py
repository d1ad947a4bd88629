import dataclasses
import json
import math

import numpy as np
import pytest

from hugwbc.cli import main
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.protocols.suite_tasks import (
    TaskEpisode,
    TaskJudge,
    TasksConfig,
    TasksProtocol,
    TasksResult,
    figures_of,
    hand_acceleration,
)
from hugwbc.tasks import TASK_NAMES

DONE = TaskEpisode("push_cart", 3, True, "", "", 1.0, 20.0, 5.0, 1000.0, (), 0.001, False, 0)
FAILED = dataclasses.replace(DONE, success=False, reason="the cart was not pushed 2 m", score=0.4, seconds=None)

# A task that is soon over: it asks for nothing but to stand for a moment.
SOON = """
from hugwbc.scripts.behaviours import Elapsed, WaitUntil
from hugwbc.sim import Scene
from hugwbc.sim.scenes import Wall
from hugwbc.tasks import Milestone, Task

TASK = Task(
    name="soon", about="Stand.", scene=Scene((Wall(name="wall", position=(2.0, 0.0)),)), limit=3.0,
    behaviour=lambda shapes: WaitUntil(Elapsed(0.1)),
    milestones=(Milestone("the robot moved", lambda record: float(abs(record.pelvis[-1, 0]) < {within})),),
)
"""


def test_figures_are_shares_and_means_of_the_rows():
    gripping = dataclasses.replace(FAILED, gripped=("tray",), hand_depth=0.004)
    figures = figures_of([DONE, dataclasses.replace(DONE, seconds=30.0), FAILED, gripping])
    assert figures.success == 0.5 and figures.episodes == 4
    low, high = figures.interval
    assert 0.1 < low < 0.5 < high < 0.9
    assert figures.reasons == {"the cart was not pushed 2 m": 2}
    assert figures.seconds == 25.0 and figures.score == pytest.approx(0.7)
    assert figures.attach and figures.hand_depth == 0.004
    assert figures_of([DONE]).reasons == {} and not figures_of([DONE]).attach


def test_the_most_frequent_reason_comes_first():
    other = dataclasses.replace(FAILED, reason="the robot fell")
    assert list(figures_of([other, FAILED, FAILED]).reasons) == ["the cart was not pushed 2 m", "the robot fell"]


def test_the_acceleration_of_hands_on_a_circle():
    angle = 2.0 * np.arange(100) / 50  # 2 rad/s
    hands = np.stack([0.1 * np.cos(angle), 0.1 * np.sin(angle), np.zeros(100)], axis=1)[:, None].repeat(2, axis=1)
    assert hand_acceleration(hands) == pytest.approx(0.4, rel=1e-3)  # omega^2 r
    assert math.isnan(hand_acceleration(hands[:2]))


def test_the_table_names_tasks_rates_and_reasons():
    result = TasksResult(
        controller="qp", gait="walking", seed=3, duration=120.0, settle=1.0, conditions=Conditions(),
        rows=(DONE, FAILED), tasks={"push_cart": figures_of([DONE, FAILED])},
    )  # fmt: skip
    text = TasksProtocol().describe(result)
    assert "push_cart" in text and "50 % of 2" in text and "push_cart: the cart was not pushed 2 m: 1" in text


def test_settings_are_checked():
    assert TasksConfig().task == TASK_NAMES and TasksProtocol().total(TasksConfig(episodes=3)) == 3 * len(TASK_NAMES)
    with pytest.raises(UnknownNameError, match="press_button"):
        TasksConfig(task=("press_the_button",))
    for tasks in ((), ("push_cart", "push_cart")):
        with pytest.raises(ConfigError, match="each once"):
            TasksConfig(task=tasks)


def test_rows_depend_on_the_code_of_their_own_task():
    cart, box = TaskJudge("push_cart", 3), TaskJudge("fetch_box", 3)
    assert cart.modules == ("hugwbc.tasks.push_cart",) and cart.identity() != box.identity()


def test_episodes_of_a_task_are_run_stored_and_read(tmp_path, capsys):
    path, out = tmp_path / "soon.py", tmp_path / "out.json"
    path.write_text(SOON.format(within=0.5))
    words = ["evaluate", "tasks", "--task", str(path), "--controller", "hold", "--episodes", "2", "--seed", "3"]
    words += ["--sensing", "exact", "--results", str(tmp_path / "results"), "--json", str(out)]
    assert main(words) == 0
    first = json.loads(out.read_text())
    figures = first["tasks"][str(path)]
    assert first["controller"] == "hold" and figures["success"] == 1.0 and figures["episodes"] == 2
    assert figures["interval"][1] == 1.0 and figures["reasons"] == {}
    assert [row["seed"] for row in first["rows"]] == [3, 4]
    (file,) = (tmp_path / "results").glob("*.jsonl")
    stored = file.read_text()
    assert main(words) == 0
    assert json.loads(out.read_text()) == first and file.read_text() == stored, "nothing is run again"
    path.write_text(SOON.format(within=-1.0))
    assert main(words) == 0
    changed = json.loads(out.read_text())["tasks"][str(path)]
    assert changed["success"] == 0.0 and changed["reasons"] == {"the robot moved": 2}
    assert "the robot moved: 2" in capsys.readouterr().out


def test_options_that_mean_nothing_are_refused(capsys):
    assert main(["evaluate", "tasks", "--gait", "walking"]) == 2
    assert "--gait means nothing to the tasks protocol" in capsys.readouterr().err
