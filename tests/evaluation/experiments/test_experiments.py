"""Every experiment: settings, plans, a short run, figures and pictures."""

import json
import pickle

import numpy as np
import pytest

from hugwbc.behaviours import wait
from hugwbc.cli import main
from hugwbc.errors import ConfigError, HugwbcError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.episode import simulation_of
from hugwbc.evaluation.experiment import Section, frame_of, run_experiment
from hugwbc.evaluation.experiments import EXPERIMENTS, behaviours, experiment_of, hands
from hugwbc.evaluation.plans import Plan
from hugwbc.robot import load_robot
from hugwbc.runtime.controllers import ControllerSpec, HoldController
from hugwbc.sim import Scene, Simulation
from hugwbc.sim.scenes import Box

HOLD = ControllerSpec("hold")
QUICK = {"duration": 0.3, "settle": 0.1, "conditions": Conditions(timestep=0.005)}
# The fewest episodes of each, and lengths that it admits.
SHORT = {
    "single-command": {"gait": "standing", "episodes": 3},
    "intervention": {"gait": "standing", "episodes": 9},
    "disturbance": {"rollouts": 1, "first": 5e3, "limit": 5e3, "resolution": 0.9, "settle": 0.1, "duration": 2.0},
    "ramp": {"gait": "standing", "episodes": 1, "settle": 3.0, "duration": 3.3},
    "contacts": {"gait": "standing"},
    "random-commands": {"episodes": 3},
    "response": {"gait": "standing", "points": 2},
    "stops": {"episodes": 1, "speeds": (0.6,), "duration": 4.2},
    "arrive": {"episodes": 1, "duration": 0.5},
    "behaviours": {"episodes": 1, "duration": 0.5},
    "boxes": {"episodes": 1, "masses": (2.0,), "heights": (0.6,), "duration": 0.5},
    "hands": {"gait": "standing", "episodes": 1, "duration": 0.4, "settle": 0.1},
    "carry": {"episodes": 1},
    "estimation": {"episodes": 1, "duration": 0.5},
    "pull": {"episodes": 1},
    "press": {"episodes": 1},
    "sway": {"episodes": 1},
    "push": {"episodes": 1},
    "faults": {"episodes": 1, "duration": 4.2, "only": ("none",)},
    "engines": {"episodes": 1},
    "tasks": {"episodes": 1, "task": ("press_button",)},
}  # fmt: skip


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_plans_are_values_that_settings_alone_decide(name):
    experiment = EXPERIMENTS[name]
    settings = experiment.settings()
    plans = experiment.plan(settings)
    assert plans and list(map(repr, plans)) == list(map(repr, experiment.plan(experiment.settings())))
    again = pickle.loads(pickle.dumps((experiment.episode, settings, plans[0])))
    assert again[:2] == (experiment.episode, settings) and repr(again[2]) == repr(plans[0])
    assert len(set(map(repr, plans))) == len(plans), "the key of each row is its own"
    for varied in settings.varied & {"payload", "intervention", "friction", "latency"}:
        value = "noise" if varied == "intervention" else 1.0 if varied != "latency" else 0.01
        with pytest.raises(ConfigError, match=f"the experiment sets {varied} itself"):
            experiment.settings(conditions=Conditions(**{varied: value}))


BY_HANDS = ["arrive", "behaviours", "boxes", "carry", "hands", "press", "pull", "push", "sway", "tasks"]


@pytest.mark.parametrize("name", BY_HANDS)
def test_arm_inverse_kinematics_uses_the_robot_named_by_told(name, monkeypatch):
    def ask(conditions):
        raise LookupError(conditions.told)

    experiment = EXPERIMENTS[name]
    settings = experiment.settings(**SHORT[name], conditions=Conditions(told="h1-2023"))
    monkeypatch.setattr(Conditions, "upper_body", ask)
    with pytest.raises(LookupError, match="h1-2023"):
        experiment.episode(HOLD.build(), settings, experiment.plan(settings)[0])


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_a_short_run_gives_rows_figures_and_pictures(name):
    experiment = EXPERIMENTS[name]
    given = {key: value for key, value in (QUICK | SHORT[name]).items() if key not in experiment.settings.varied}
    result = run_experiment(experiment, experiment.settings(**given), HOLD)
    assert result.rows and json.loads(json.dumps(result.rows, allow_nan=False)) == result.rows
    measured = [figure for figure in result.figures if figure.estimate is not None]
    assert measured and all(figure.controller == "hold" for figure in measured)
    if experiment.section:
        pictures = experiment.section.pictures([("hold", result.settings, frame_of(result.rows))], ["hold"])
        assert bool(pictures) == (experiment.section.pictures is not Section.pictures)
        assert all(picture.svg for picture in pictures)


@pytest.mark.parametrize("name", ["random-commands", "engines"])
def test_a_fall_has_no_errors_where_figures_leave_it_out(name, monkeypatch):
    """So that `remarks` counts it among the episodes that means lack."""
    monkeypatch.setattr(Simulation, "fallen", True)
    experiment = EXPERIMENTS[name]
    settings = experiment.settings(**QUICK | SHORT[name] | {"settle": 0.0})
    row = experiment.episode(HOLD.build(), settings, experiment.plan(settings)[0])
    assert row["fell"] and {value for column, value in row.items() if column.startswith("error_")} == {None}


def test_sections_have_runs_in_both_profiles():
    sections = [(experiment.plan, section) for experiment in EXPERIMENTS.values() if (section := experiment.section)]
    assert sections
    for plan, section in sections:
        assert not section.unavailable()
        quick, full = section.quick(), section.full()
        assert section.text and quick and len(quick) <= len(full)
        work = [sum(len(plan(s)) * s.duration for s in runs) for runs in (quick, full)]
        assert work[0] <= work[1]


def test_an_experiment_of_a_file(tmp_path, capsys):
    (tmp_path / "mine.py").write_text(
        "import dataclasses\nfrom hugwbc.evaluation.experiments.contacts import EXPERIMENT\n"
        'MINE = dataclasses.replace(EXPERIMENT, name="mine")\nOTHER = 3\n'
        "BARE = dataclasses.replace(MINE, settings=dict)\n"
        "@dataclasses.dataclass(frozen=True)\nclass Named(EXPERIMENT.settings):\n    payload: float = 1.0\n"
        "NAMED = dataclasses.replace(MINE, settings=Named)\n"
    )
    assert experiment_of(f"{tmp_path}/mine.py:MINE").name == "mine"
    assert main(["evaluate", f"{tmp_path}/mine.py:NAMED"]) == 2
    assert "has a setting 'payload', which is an option of all experiments" in capsys.readouterr().err
    with pytest.raises(HugwbcError, match="give a class based on CountedSettings"):
        experiment_of(f"{tmp_path}/mine.py:BARE")
    for words, message in ((f"{tmp_path}/mine.py:OTHER", "is a int; give an Experiment"), ("contact", "'contacts'")):
        with pytest.raises(HugwbcError, match=message):
            experiment_of(words)


def test_motions_and_faults_are_taken_where_they_matter():
    EXPERIMENTS["intervention"].settings(conditions=Conditions(motions="a folder"))
    EXPERIMENTS["tasks"].settings(conditions=Conditions(faults=("imu-gone@12:1",)))


@pytest.mark.parametrize("name", ["pull", "press", "carry", "push", "sway"])
def test_a_fault_after_the_end_is_refused_where_the_experiment_has_its_own_times(name):
    settings = EXPERIMENTS[name].settings(conditions=Conditions(faults=("imu-gone@15:1",)))
    with pytest.raises(ConfigError, match="starts after the episode"):
        run_experiment(EXPERIMENTS[name], settings, HOLD)


@pytest.mark.parametrize(
    ("name", "changes", "message"),
    [
        ("single-command", {"episodes": 7}, "give 8 or more: one per command of the walking gait"),
        ("single-command", {"episodes": 24, "ends": True}, "give a multiple of 16: both ends of 8 commands"),
        (
            "single-command",
            {"gait": "hopping", "episodes": 8, "ends": True},
            "a multiple of 16: both ends of 4 commands on each leg",
        ),
        ("intervention", {"episodes": 23}, "give 24 or more: 3 interventions and 8 commands"),
        ("intervention", {"training": "nois"}, "noise"),
        ("disturbance", {"duration": 2.0}, "leave 1.5 s for the force"),
        ("disturbance", {"first": 900.0}, "give first <= limit"),
        ("ramp", {"settle": 2.0}, "give 3.0 s or more"),
        ("ramp", {"gait": "hopping"}, "takes standing, walking, jumping"),
        ("stops", {"gait": "standing"}, "takes walking"),
        ("stops", {"speeds": (5.0,)}, "none is within the walking gait's"),
        ("engines", {"gait": "jumping"}, "sets gait itself"),
        ("arrive", {"conditions": Conditions(intervention="noise")}, "sets intervention itself"),
        ("single-command", {"conditions": Conditions(motions="nowhere")}, "add --intervention motion"),
        ("hands", {"conditions": Conditions(motions="nowhere")}, "sets motions itself"),
        ("single-command", {"conditions": Conditions(faults=("imu-gone@10:1",))}, "takes 10 s; give it an earlier"),
        ("boxes", {"settle": 2.0}, "sets settle itself"),
        ("push", {"gait": "standing"}, "takes walking"),
        ("sway", {"duration": 2.0}, "sets duration itself"),
        ("tasks", {"seed": 960, "episodes": 50}, "class selection into class report"),
        (
            "tasks",
            {"conditions": Conditions(faults=("imu-gone@500:1",))},
            "starts after the episode, which takes 120 s",
        ),
        ("behaviours", {"behaviour": "fetch_cap"}, "fetch_cup"),
        ("behaviours", {"scene": "nowhere.yaml"}, "nowhere.yaml"),
        ("hands", {"duration": 1.9, "settle": 1.0}, "give more than 2 s"),
        ("carry", {"gait": "jumping"}, "takes standing, walking"),
        ("pull", {"force": -1.0}, "force is -1"),
        ("press", {"gait": "walking"}, "takes standing"),
        ("estimation", {"conditions": Conditions(sensing="exact")}, "give --sensing robot"),
        ("faults", {"only": ("nothing",)}, "no fault has 'nothing'"),
        ("faults", {"duration": 5.0}, "give 4 s more than settle"),
        ("engines", {"commands": ("fly",)}, "command 'fly'"),
        ("tasks", {"task": ("press_button", "press_button")}, "each once"),
    ],
)
def test_bad_settings_say_what_is_valid(name, changes, message):
    with pytest.raises(HugwbcError, match=message):
        EXPERIMENTS[name].settings(**changes)


def test_hands_walk_with_the_swing_height_of_their_robot():
    conditions = Conditions(robot="g1")
    settings = hands.HandsSettings(gait="walking", duration=2.5, settle=2.0, conditions=conditions)
    command = hands.hands_script(settings, np.random.default_rng(0)).command_at(2.4)
    assert (command.v_x, command.l) == pytest.approx((0.5, 0.12))


def test_a_behaviour_is_not_done_if_an_object_left_the_world(monkeypatch):
    def falling_upwards(settings, plan, *, scene):
        simulation = simulation_of(settings, plan, scene=scene)
        simulation.model.opt.gravity[2] = 200.0
        return simulation

    monkeypatch.setattr(behaviours, "simulation_of", falling_upwards)
    scene = Scene((Box(name="parcel", position=(2.0, 0.0, 9.0), size=(0.2, 0.2, 0.2)),))
    settings = behaviours.BehavioursSettings(duration=1.0, conditions=Conditions(timestep=0.005))
    controller = HoldController(load_robot())
    row, _ = behaviours.play(controller, settings, Plan(0), lambda view: wait(view, 0.4), scene)
    assert not row["success"] and row["seconds"] is None and row["ending"] == "object 'parcel' left the world"


@pytest.mark.parametrize(
    ("name", "changes", "message"),
    [
        ("stops", {"duration": 3.4}, "give 4 s more than settle, in which the robot can stop"),
        ("engines", {"commands": ("walk", "walk")}, "commands are walk, walk; give at least one, each once"),
        ("boxes", {"masses": (2.0, 2.0)}, "masses are 2, 2; give at least one, each once"),
        ("boxes", {"heights": ()}, "heights are none; give at least one"),
    ],
)
def test_settings_that_would_count_what_did_not_happen_are_refused(name, changes, message):
    with pytest.raises(ConfigError, match=message):
        EXPERIMENTS[name].settings(**changes)


def test_arms_that_reach_too_few_targets_are_told(monkeypatch):
    monkeypatch.setattr(hands, "REACHED", -1.0)
    monkeypatch.setattr(hands, "_DRAWS", 2)
    with pytest.raises(ConfigError, match=r"^h1 reaches 0 of 2 pairs of targets from \[ 0\.15"):
        hands.reachable_targets(1, np.random.default_rng(0), load_robot())


def test_endings_that_differ_in_numbers_are_one():
    rows = [{"success": False, "ending": f"the robot moved while told to stand, by 0.{i} m"} for i in range(3)]
    (ending,) = behaviours.other_endings("T", "", frame_of([*rows, {"success": True, "ending": "done"}]))
    assert ending.quantity == "the robot moved while told to stand, by ... m" and ending.value == pytest.approx(75.0)


@pytest.mark.parametrize(("name", "column"), [("tasks", "success"), ("contacts", "agreement")])
def test_means_of_robots_that_fell_are_not_judged(name, column, monkeypatch):
    experiment = EXPERIMENTS[name]
    given = {key: value for key, value in (QUICK | SHORT[name]).items() if key not in experiment.settings.varied}
    settings = experiment.settings(**given)
    monkeypatch.setattr(Simulation, "fallen", True)
    result = run_experiment(experiment, settings, HOLD)
    assert result.rows[0]["fell"] and column in result.rows[0]
    assert {figure.judged for figure in result.figures} == {False}
