"""Figures of rows that are known by hand."""

import dataclasses
import itertools
import types

import numpy as np
import pytest

from hugwbc.commands import command_ranges, default_command
from hugwbc.errors import ConfigError
from hugwbc.evaluation import metrics
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.episode import ending
from hugwbc.evaluation.experiment import frame_of
from hugwbc.evaluation.experiments import (
    behaviours,
    contacts,
    disturbance,
    engines,
    estimation,
    faults,
    forces,
    hands,
    intervention,
    ramp,
    random_commands,
    single_command,
    stops,
    suite_tasks,
)
from hugwbc.evaluation.intervals import bootstrap_rms, wilson_percentage
from hugwbc.gait import Gait
from hugwbc.robot import load_robot
from hugwbc.runtime.controllers import ControllerSpec

END = {"fell": False, "survived_s": 10.0, "mistakes": 0}
SINGLE = {
    **{"value": 0.5, "error": None, "arm_error": None, "foot_travel": None, "held_foot_contact": None},
    **{"hop_frequency_error": None, **{f"impact_{name}": None for name in single_command.IMPACTS}, **END},
}


def values(figures):
    return {(f.table, f.quantity): f.value for f in figures}


def by_quantity(figures):
    return {f.quantity: f for f in figures if f.estimate is not None}


def test_single_commands_beside_the_paper_and_what_it_prints_for_others():
    rows = [
        SINGLE | {"command": "h", "error_name": "E_h", "error": 0.1, "impact_peak_mean": 1.2},
        SINGLE | {"command": "h", "error_name": "E_h", "error": 0.3, "impact_peak_mean": 1.4},
        SINGLE | {"command": "v_x", "error_name": "E_vx_high", "value": 1.5, "fell": True, "foot_travel": 9.0},
    ]
    figures = single_command.figures(single_command.SingleCommandSettings(), frame_of(rows))
    mine = by_quantity(figures)
    assert mine["E_h"].value == pytest.approx(0.2) and mine["E_h"].paper == 0.064 and mine["E_h"].unit == "m"
    assert mine["E_w"].value is None and mine["falls"].value == pytest.approx(100.0 / 3.0)
    assert mine["falls at up to 0.6 m/s"].value == 0.0 and mine["falls at up to 0.6 m/s"].estimate.samples == 2
    assert mine["peak foot force of 10 ms, mean of stances"].value == pytest.approx(1.3)
    assert not any("path of both feet" in quantity for quantity in mine), "a fall cut it short"
    stand = by_quantity(
        single_command.figures(single_command.SingleCommandSettings(gait="standing"), frame_of(rows[:2]))
    )
    assert stand["falls"].value == 0.0 and len([name for name in stand if name.startswith("falls")]) == 1, (
        "counted once"
    )
    settings = single_command.SingleCommandSettings(conditions=Conditions(intervention="noise"))
    slow = SINGLE | {"command": "v_x", "error_name": "E_vx_low", "error": 0.1}
    moved = by_quantity(single_command.figures(settings, frame_of([slow, rows[2] | {"error": 0.5}])))
    assert moved["E_vx"].value == pytest.approx(0.3) and moved["E_vx"].paper == 0.0483, "at all speeds"
    assert moved["E_vx"].reference == moved["falls"].reference == "trained with noise" and not mine["E_h"].reference
    assert moved["E_vx_low"].value == 0.1 and moved["E_vx_low"].paper is None and "E_vx" not in mine
    hover = {f.quantity: f for f in figures if f.controller == "HOVER"}
    assert hover["E_h"].published == 0.27 and "E_f" not in hover


def test_samples_cover_each_range_evenly_and_follow_the_seed():
    settings = single_command.SingleCommandSettings(episodes=35, seed=3)
    samples = single_command.stratified_samples(settings, 35)
    assert samples == single_command.stratified_samples(settings, 35)
    assert samples != single_command.stratified_samples(dataclasses.replace(settings, seed=4), 35)
    for name in single_command.sampled_commands(Gait.WALKING, load_robot()):
        low, high = command_ranges(Gait.WALKING)[name].finishing
        found = np.array([getattr(command, name) for n, command in samples if n == name])
        part = np.floor((found - low) / (high - low) * len(found)).astype(int)
        assert part.tolist() == list(range(len(found))), "one sample in each equal part"


@pytest.mark.parametrize("gait", ["hopping", "walking"])
def test_both_ends_of_a_range_come_equally_often_on_each_leg(gait):
    settings = single_command.SingleCommandSettings(gait=gait, episodes=16, ends=True)
    plans = single_command.plan(settings)
    for name in single_command.sampled_commands(settings.gaits[0], load_robot()):
        for leg in settings.gaits:
            found = [getattr(p.command, name) for p in plans if p.tags["command"] == name and p.command.gait is leg]
            assert sorted(found) == list(command_ranges(leg)[name].finishing)


def test_random_commands_without_falls():
    errors = {f"error_{name}": 0.2 for name in ("v_x", "v_y", "omega", "h", "p", "w", "f", "l")}
    low, high = ({name: r.finishing[end] for name, r in command_ranges(Gait.WALKING).items()} for end in (0, 1))
    rows = [{"gait": "walking", **low, **errors, **END}, {"gait": "walking", **high, **errors, **END, "fell": True}]
    settings = random_commands.RandomCommandsSettings(episodes=2)
    found = by_quantity(random_commands.figures(settings, frame_of(rows)))
    assert found["E_h"].value == 0.2 and found["falls"].value == 50.0
    assert found["E_vx_low"].value == 0.2 and "E_vx_high" not in found, "its episode fell"


def test_an_episode_that_fell_early_counts_as_much_in_the_mean_of_the_hands():
    rows = [
        END
        | {"hand_error_m": error, "joint_error_rad": 0.01, "fell": count < 400}
        | {"errors": [[error, error]] * count, "reachable": [[True, True]] * count}
        for error, count in ((0.01, 400), (0.03, 25))
    ]
    mean = by_quantity(hands.figures(hands.HandsSettings(), frame_of(rows)))["hand error, mean"].estimate
    assert (mean.value, mean.low, mean.high) == pytest.approx((2.0, 1.0, 3.0)), "of one and the same quantity"


def test_a_robot_that_does_not_come_to_rest_is_counted():
    rows = [END | {"way": way, "stop_s": 1.5, "moved": 0.5} for way in ("a", "a", "b")]
    rows[1] |= {"stop_s": None, "moved": None}
    found = by_quantity(stops.figures(stops.StopsSettings(), frame_of(rows)))
    assert found["a: never still"].value == 50.0 and found["a: time until still"].value == 1.5
    assert "b: never still" not in found and found["a: falls"].value == 0.0


def test_random_scripts_reach_every_change_of_gait_within_the_ranges():
    settings = random_commands.RandomCommandsSettings(changing=True, episodes=60, duration=12.0)
    plans, changes, ramps = random_commands.plan(settings), set(), []
    for plan in plans:
        knots = plan.commands.knots
        changes |= {(before.command.gait, after.command.gait) for before, after in itertools.pairwise(knots)}
        ramps += [knot.ramp for knot in knots[1:]]
        assert all(knot.command.validate() for knot in knots)
        assert all(1.0 <= after.time - before.time <= 5.0 for before, after in itertools.pairwise(knots))
    assert len(changes) == len(Gait) ** 2 and 0.3 < np.mean(np.array(ramps) == 0.0) < 0.7
    assert plans[7] == random_commands.plan(dataclasses.replace(settings, episodes=8))[7], "one can be run again"
    with pytest.raises(ConfigError, match="leave --gait out"):
        random_commands.RandomCommandsSettings(changing=True, gait="jumping")
    with pytest.raises(ConfigError, match="leave --settle out"):
        random_commands.RandomCommandsSettings(changing=True, settle=2.0)


def test_a_search_of_forces_is_that_of_its_rows():
    settings = disturbance.DisturbanceSettings(rollouts=1, first=100.0, limit=400.0, resolution=0.5)
    rows, limits = [], {"constant": 120.0, "second": 1000.0}
    plans = disturbance.following(settings, rows)
    assert len(plans) == 16 and {plan.tags["force"] for plan in plans} == {100.0}
    assert len({repr(plan.conditions) for plan in plans}) == 1, "every force meets the same robot"
    while plans:
        rows += [dict(plan.tags) | {"fell": plan.tags["force"] > limits[plan.tags["kind"]]} for plan in plans]
        plans = disturbance.following(settings, rows)
    found = {(f.table, f.quantity): f.estimate for f in disturbance.figures(settings, frame_of(rows))}
    one = found["Tolerated force, constant", "90°"]
    assert (one.value, one.low, one.high) == (100.0, 100.0, 150.0)
    assert found["Tolerated force, for one second", "0°"].high is None, "the limit was survived"


def test_a_ramp_goes_from_the_minimum_to_the_maximum():
    settings = ramp.RampSettings(episodes=2)
    plans = ramp.plan(settings)
    low, high = command_ranges(Gait.WALKING)["p"].finishing
    schedule = plans[0].commands
    assert [schedule.command_at(t).p for t in (0.0, 3.0, 4.0, 14.0)] == pytest.approx([0.0, low, low, high])
    assert repr(plans[0].conditions) == repr(plans[2].conditions) != repr(plans[1].conditions)
    rows = [{"command": name, "error": 0.1, "commanded": [0.0], "measured": [0.1], **END} for name in ("p", "p", "w")]
    found = by_quantity(ramp.figures(settings, frame_of(rows)))
    assert found["E_p"].value == pytest.approx(0.1) and found["E_p"].paper and found["falls, w"].estimate.samples == 1


def test_a_controller_is_compared_with_the_policy_of_its_training():
    settings = intervention.adapt(intervention.InterventionSettings(), ControllerSpec("hold"))
    assert settings.training == "noise"
    rows = [SINGLE | {"intervention": "none", "command": "v_x", "error_name": "E_vx_low", "error": 0.4}]
    figures = intervention.figures(settings, frame_of(rows))
    mine = [f for f in figures if f.estimate is not None and f.quantity == "E_vx" and "arms free" in f.table]
    assert mine[0].value == 0.4 and mine[0].reference == "trained with noise"
    alone = {f.reference for f in figures if f.estimate is None}
    assert alone == {"trained with motions", "trained without intervention"}
    kinds = {plan.conditions.intervention for plan in intervention.plan(settings)}
    assert kinds == {"none", "noise", "motion"}


@pytest.mark.parametrize(("duration", "paper"), [(21.0, 0.0339), (11.0, None)])
def test_a_stand_of_another_length_is_not_compared_with_the_papers(duration, paper):
    settings = intervention.InterventionSettings(gait="standing", duration=duration, training="noise")
    row = SINGLE | {"intervention": "noise", "command": "h", "foot_travel": 0.02, "foot_creep": 0.01}
    found = intervention.figures(settings, frame_of([row, row | {"foot_travel": 9.0, "fell": True}]))
    feet = [f for f in found if f.quantity == "foot displacement, h commanded" and "by noise" in f.table]
    (mine,) = [f for f in feet if f.estimate is not None]
    assert (mine.value, mine.paper, mine.unit) == (0.02, paper, f"m in {duration - 1.0:g} s")
    assert [f.paper for f in feet if f.estimate is None] == ([2.0815, 17.5358] if paper else [])


def test_the_clock_is_shifted_to_where_it_agrees():
    phases = contacts.clock_phases(Gait.WALKING, 1.5, 0.37, 200)
    offset, agreement = contacts.fit_clock(phases < 0.5, Gait.WALKING, 1.5)
    assert offset == pytest.approx(0.37) and agreement == 1.0


def test_pushes_get_stronger_until_the_robot_falls():
    settings, rows = forces.PushSettings(episodes=1), []
    while plans := forces.next_pushes(settings, rows):
        rows += [dict(plan.tags) | END | {"fell": plan.tags["change"] > 0.5} for plan in plans]
    assert len(rows) == 8 * 3 and forces.survived(settings, frame_of(rows))[45] == [pytest.approx(0.4)]
    figures = by_quantity(forces.push_figures(settings, frame_of(rows)))
    assert figures["median of all"].value == pytest.approx(0.4)
    assert figures["ladders that ended in a fall"].estimate == wilson_percentage([True] * 8)


def test_a_push_changes_the_velocity_of_the_payload_too():
    conditions = Conditions(payload=10.0)
    (push,) = forces.next_pushes(forces.PushSettings(episodes=1, conditions=conditions), [])[0].forces
    assert push.vector[0] * forces.PUSH_TIME == pytest.approx((load_robot().mass + 10.0) * forces.PUSH_STEP)


def test_ladders_of_pushes_that_end_without_a_fall_count_once_each():
    settings, rows = forces.PushSettings(), []
    while plans := forces.next_pushes(settings, rows):
        rows += [dict(plan.tags) | END | {"fell": plan.tags["direction"] == 90} for plan in plans]
    figures = by_quantity(forces.push_figures(settings, frame_of(rows)))
    assert figures["ladders that ended in a fall"].estimate == wilson_percentage([True] * 4 + [False] * 28)
    assert figures["0°"].value == pytest.approx(2.4) and figures["median of all"].estimate.low is not None


def test_pushes_of_one_direction_are_spread_over_a_stride():
    plans = [plan for plan in forces.next_pushes(forces.PushSettings(), ()) if plan.tags["direction"] == 0]
    starts = np.array([plan.forces[0].start for plan in plans])
    stride = 1.0 / default_command(Gait.WALKING, load_robot()).f
    np.testing.assert_allclose(starts, forces.BEGIN + stride * np.array([0.0, 0.25, 0.5, 0.75]))


def test_the_acceleration_of_a_hand_that_is_shaken():
    time = 0.02 * np.arange(200)
    shaken = np.stack((0.5 * time, 0.01 * np.sin(2.0 * np.pi * 2.0 * time), np.ones(200)), axis=1)
    acceleration = metrics.hand_acceleration(np.stack((shaken, shaken), axis=1))
    assert acceleration == pytest.approx(0.01 * (4.0 * np.pi) ** 2 / np.sqrt(2.0), rel=0.02)


def test_the_ratio_of_swaying_hands_is_of_the_walks_in_which_neither_fell():
    settings = forces.SWAY.settings(episodes=2)
    rows = [
        END | {"walk": walk, "arms": arms, "acceleration": value}
        for walk, arms, value in ((0, "steady", 1.0), (0, "stiff", 4.0), (1, "steady", 9.0), (1, "stiff", None))
    ]
    found = by_quantity(forces.sway_figures(settings, frame_of(rows)))
    assert found["ratio"].value == pytest.approx(0.25) and found["ratio"].estimate.samples == 1


def test_the_error_of_an_estimated_force_is_none_in_a_fall(synthetic_trace):
    errors = forces.HandForceErrors(lambda truth: np.zeros((2, 3)))
    state = types.SimpleNamespace(time=10.0, hand_force=np.full((2, 3), [2.0, 0.0, 0.0]))
    errors(state, state)
    trace = synthetic_trace(default_command(Gait.STANDING))
    knelt = dataclasses.replace(trace, safety=dataclasses.replace(trace.safety, lowered=1))
    assert errors.row(trace) == {"estimate_error": 2.0} and errors.row(knelt) == {"estimate_error": None}


def test_a_robot_that_knelt_down_did_not_stay_up(synthetic_trace):
    trace = synthetic_trace(default_command(Gait.STANDING))
    assert not ending(trace)["fell"]
    assert ending(dataclasses.replace(trace, safety=dataclasses.replace(trace.safety, lowered=1)))["fell"]


def test_a_fault_for_good_goes_well_if_the_ground_is_reached_softly():
    settings = faults.FaultsSettings(episodes=2, only=("IMU gone",))
    speeds = {"touch_speed": 0.5, "noticed_s": 0.3}
    rows = [END | speeds | {"fault": name, "fell": True, "before": False} for name in settings.faults for _ in range(2)]
    found = values(faults.figures(settings, frame_of(rows)))
    assert found["IMU gone for good", "went well"] == 100.0 and found["IMU gone for 200 ms", "went well"] == 0.0
    assert found["IMU gone for good", "noticed after, at most"] == 0.3
    rows[-1] |= {"before": True, "touch_speed": None}  # it lay on the ground already
    found = values(faults.figures(settings, frame_of(rows)))
    assert found["IMU gone for good", "went well"] == 50.0
    plans = faults.plan(settings)
    assert plans[0].tags["start"] == plans[2].tags["start"] and "imu-gone@" in plans[0].conditions.faults[0]


def test_delays_of_inferred_contacts_and_the_root_mean_square():
    time = np.arange(100) * 0.01
    true = (time >= 0.3) & (time < 0.7)
    late = (time >= 0.32) & (time < 0.69)
    assert estimation.delays(late, true, time, down=True) == pytest.approx([0.02])
    assert estimation.delays(late, true, time, down=False) == pytest.approx([-0.01])
    assert bootstrap_rms([3.0, 4.0]).value == pytest.approx(np.sqrt(12.5))


@pytest.mark.parametrize("samples", [2500, 2501, 100, 1])
def test_drift_is_divided_by_the_length_of_the_whole_path(samples):
    time = 0.002 * np.arange(samples)
    record = {"time": time, "true_position": np.outer(time, [0.3, -0.4, 0.0])}
    assert estimation._way(record) == pytest.approx(0.5 * time[-1])


def test_drifts_are_those_of_all_walks_over_their_ways():
    still = dict.fromkeys((*estimation.COLUMNS, "nees"), 0.1) | END
    rows = [still | {"drift": drift, "way": way} for drift, way in ((0.1, 4.0), (0.1, 0.5), (None, 0.0))]
    settings = estimation.EstimationSettings(episodes=3)
    found = by_quantity(estimation.figures(settings, frame_of(rows)))["drift over 20 m"]
    assert found.value == pytest.approx(20.0 * 0.2 / 4.5) and found.estimate.samples == 2
    stands = [row | {"way": 0.02} for row in rows]
    assert by_quantity(estimation.figures(settings, frame_of(stands)))["drift over 20 m"].value is None


def test_errors_in_both_engines_and_their_ratio():
    rows = [
        {"command": "walk", "engine": engine, "error_v_x": error, "error_v_y": 0.1, "error_omega": None, **END}
        for engine, error in (("mujoco", 0.1), ("physx", 0.2))
    ]
    found = by_quantity(engines.figures(engines.EnginesSettings(commands=("walk",), episodes=1), frame_of(rows)))
    assert found["E_v_x, ratio"].value == pytest.approx(2.0) and found["falls, physx"].value == 0.0
    hard = [row | {"error_v_x": 0.9} for row in rows]
    hard[1] |= {"error_v_x": None, "fell": True}
    settings = engines.EnginesSettings(commands=("walk",), episodes=2)
    found = by_quantity(engines.figures(settings, frame_of([*rows, *hard])))
    assert found["E_v_x, mujoco"].value == pytest.approx(0.5) and found["falls, physx"].value == 50.0
    assert found["E_v_x, ratio"].value == pytest.approx(2.0), "over the episodes that stay up in both"


def test_a_task_that_fails_says_why():
    done = END | {"success": True, "reason": "", "score": 1.0, "seconds": 10.0, "hand_acceleration": 1.0}
    done |= {
        "task": "press_button",
        "energy": 5.0,
        "gripped": [],
        "hand_depth": 0.001,
        "drift": 0.02,
        "end_speed": 0.01,
    }
    failed = {"success": False, "reason": "too late", "score": 0.5, "seconds": None, "gripped": ["box"]}
    rows = [done, done | failed | {"energy": 90.0, "hand_acceleration": 7.0}]
    settings = suite_tasks.TasksSettings(task=("press_button",), episodes=2)
    found = by_quantity(suite_tasks.figures(settings, frame_of(rows)))
    assert found["success"].value == 50.0 and found["failed: too late"].value == 50.0
    assert found["energy of a success"].value == 5.0 and found["hand acceleration of a success"].value == 1.0
    assert found["time of a success"].value == 10.0 and found["idealised gripper"].value == 50.0


def test_boxes_are_in_proportion_to_the_robot():
    rows = frame_of([{"mass": 2.0, "height": 0.6, "success": True, "ending": "", **END}])
    for robot, table, quantity in (("h1", "2 kg", "done from 0.6 m"), ("g1", "0.801 kg", "done from 0.442 m")):
        settings = behaviours.BoxesSettings(conditions=Conditions(robot=robot))
        found = behaviours.boxes_figures(settings, rows)[0]
        assert (found.table, found.quantity) == (table, quantity)
