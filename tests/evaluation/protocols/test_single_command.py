import dataclasses
import json

import numpy as np
import pytest

from hugwbc import Command, Gait, JointCommand
from hugwbc.commands import command_ranges
from hugwbc.errors import ConfigError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.engine import Execution
from hugwbc.evaluation.figures import FALLS
from hugwbc.evaluation.paper import ERROR_NAMES
from hugwbc.evaluation.protocols.single_command import (
    SingleCommandConfig,
    SingleCommandProtocol,
    sampled_commands,
    stratified_samples,
)
from hugwbc.runtime.controllers import ControllerSpec, HoldController

WALKING_NAMES = ("v_x", "v_y", "omega", "f", "l", "h", "p", "w")

RUN = SingleCommandProtocol().run


def test_the_commands_that_each_gait_samples_are_the_papers():
    assert sampled_commands(Gait.STANDING) == ("h", "p", "w")
    assert sampled_commands(Gait.WALKING) == sampled_commands(Gait.JUMPING) == WALKING_NAMES
    assert sampled_commands(Gait.HOPPING_LEFT) == ("v_x", "v_y", "omega", "h")


def test_samples_cover_each_range_evenly_and_follow_the_seed():
    config = SingleCommandConfig(Gait.WALKING, episodes=35, seed=3)
    samples = stratified_samples(config, 35)
    assert samples == stratified_samples(config, 35) != stratified_samples(dataclasses.replace(config, seed=4), 35)
    counts = {name: sum(n == name for n, _ in samples) for name in WALKING_NAMES}
    assert counts == {"v_x": 5, "v_y": 5, "omega": 5, "f": 4, "l": 4, "h": 4, "p": 4, "w": 4}
    for name in WALKING_NAMES:
        low, high = command_ranges(Gait.WALKING)[name].finishing
        values = np.array([getattr(command, name) for n, command in samples if n == name])
        part = np.floor((values - low) / (high - low) * counts[name]).astype(int)
        assert part.tolist() == list(range(counts[name])), "one sample in each equal part"


def test_hopping_on_both_legs_alternates_over_each_range():
    config = SingleCommandConfig(Gait.HOPPING_LEFT, both_legs=True, episodes=16, seed=3)
    samples = stratified_samples(config, 16)
    values = [(name, getattr(command, name), command.gait) for name, command in samples]
    left = [(name, value) for name, value, gait in values if gait is Gait.HOPPING_LEFT]
    right = [(name, value) for name, value, gait in values if gait is Gait.HOPPING_RIGHT]
    assert len(left) == len(right) == 8
    assert [name for name, _ in left] == [name for name, _ in right]
    assert not set(left) & set(right), "the legs share the strata of a range, each has its own"
    assert config.gait_label == "hopping"
    with pytest.raises(ConfigError, match="both_legs is for hopping"):
        SingleCommandConfig(Gait.WALKING, both_legs=True)


def test_ends_draw_each_end_of_each_range_equally_often_on_both_legs():
    config = SingleCommandConfig(Gait.HOPPING_LEFT, both_legs=True, episodes=16, seed=3, ends=True)
    samples = stratified_samples(config, 16, ends=True)
    assert [plan.command for plan in SingleCommandProtocol().plans(config)] == [command for _, command in samples]
    for name in sampled_commands(Gait.HOPPING_LEFT):
        low, high = command_ranges(Gait.HOPPING_LEFT)[name].finishing
        for gait in (Gait.HOPPING_LEFT, Gait.HOPPING_RIGHT):
            values = [getattr(command, name) for n, command in samples if n == name and command.gait is gait]
            assert sorted(values) == [low, high]


def test_a_hop_that_does_not_follow_the_clock_is_seen_in_a_figure_of_its_own():
    settings = SingleCommandConfig(Gait.HOPPING_LEFT, episodes=4, duration=1.4, execution=Execution(1))
    result = RUN(HoldController, settings)
    # A robot that never leaves the ground hops 0 times a second; the clock has 2 Hz.
    assert [row.hop_frequency_error for row in result.rows] == [2.0] * 4 and result.hop_frequency_error == 2.0
    walk = RUN(HoldController, dataclasses.replace(settings, gait=Gait.WALKING, episodes=8))
    assert walk.hop_frequency_error is None


class Recorder(HoldController):
    """Stands on stiff legs and remembers the commands of each episode."""

    def __init__(self):
        super().__init__()
        self.episodes: list[set[Command]] = []

    def reset(self, state):
        self.episodes.append(set())

    def act(self, state, command, upper_body):
        self.episodes[-1].add(command)
        return super().act(state, command, upper_body)


def test_every_episode_varies_one_command_and_holds_it():
    recorder = Recorder()
    config = SingleCommandConfig(Gait.STANDING, episodes=6, seed=1, duration=0.2, settle=0.1)
    rows = []
    result = RUN(lambda: recorder, config, rows.append)
    assert [len(commands) for commands in recorder.episodes] == [1] * 6
    for commands, row in zip(recorder.episodes, rows, strict=True):
        (command,) = commands
        assert getattr(command, row.command) == row.value
        assert dataclasses.replace(command, **{row.command: 0.0}) == Command(gait=Gait.STANDING)
    assert [row.command for row in rows] == ["h", "h", "p", "p", "w", "w"]
    assert result.rows == tuple(rows) and result.falls == 0 and result.episodes == 6


def test_errors_are_the_means_of_the_episodes_of_their_command():
    config = SingleCommandConfig(Gait.STANDING, episodes=6, seed=1, duration=0.3, settle=0.1)
    result = RUN(HoldController, config)
    for name, key in (("E_h", "h"), ("E_p", "p"), ("E_w", "w")):
        errors = [row.error for row in result.rows if row.command == key]
        assert result.errors[name] == pytest.approx(np.mean(errors))
    # the baseline ignores h and p: it is off by about the command, on average over the two samples
    heights = [abs(row.value) for row in result.rows if row.command == "h"]
    assert result.errors["E_h"] == pytest.approx(np.mean(heights), abs=0.03)
    assert [name for name in ERROR_NAMES if result.errors[name] is not None] == ["E_h", "E_p", "E_w"]
    assert result.paper == {"E_h": 0.035, "E_p": 0.047, "E_w": 0.022}
    assert json.loads(json.dumps(dataclasses.asdict(result)))["errors"]["E_vx_low"] is None


class Limp(HoldController):
    def act(self, state, command, upper_body):
        output = super().act(state, command, upper_body)
        return JointCommand(output.q, output.dq, 0 * output.kp, 0 * output.kd, output.tau)


def test_falls_are_counted_and_fast_episodes_kept_apart():
    result = RUN(Limp, SingleCommandConfig(Gait.WALKING, episodes=16, duration=3.0))
    assert result.falls == result.episodes == 16
    # v_x is sampled twice: once in the slow half of -0.6 to 2 m/s and once from 0.7 m/s up
    assert result.episodes_slow == result.falls_slow and result.fall_rate_slow == 1.0
    assert result.episodes_slow == 16 - sum(abs(row.value) > 0.6 for row in result.rows if row.command == "v_x") < 16


def test_paths_of_the_feet_that_a_fall_cut_short_are_left_out():
    result = RUN(Limp, SingleCommandConfig(Gait.STANDING, episodes=3, duration=3.0, settle=0.1))
    assert result.falls == 3 and all(row.foot_travel is not None for row in result.rows)
    assert result.foot_travel is None


def test_two_workers_give_the_result_of_one():
    config = SingleCommandConfig(Gait.STANDING, episodes=3, duration=0.2, settle=0.1)
    factory = ControllerSpec("hold").build
    alone = RUN(factory, config)
    assert RUN(factory, dataclasses.replace(config, execution=Execution(2))) == alone


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"episodes": 7}, "give 8 or more: one per command of the walking gait"),
        ({"duration": 0.5}, "give 0 <= settle < duration"),
        ({"duration": float("nan")}, "give 0 <= settle < duration"),
        ({"seed": -1}, "give 0 or more"),
    ],
)
def test_bad_settings_are_refused(changes, message):
    with pytest.raises(ConfigError, match=message):
        SingleCommandConfig(Gait.WALKING, **changes)


class Yielding(HoldController):
    """Follows what it measures, so that noise moves it."""

    def act(self, state, command, upper_body):
        return dataclasses.replace(super().act(state, command, upper_body), q=state.q.copy())


def test_noisy_episodes_do_not_depend_on_who_runs_them():
    config = SingleCommandConfig(
        Gait.STANDING, episodes=3, seed=1, duration=0.3, settle=0.1, conditions=Conditions(sensing="robot")
    )
    alone = RUN(Yielding, config)
    assert RUN(Yielding, dataclasses.replace(config, execution=Execution(2))).rows == alone.rows
    assert RUN(Yielding, dataclasses.replace(config, conditions=Conditions(sensing="exact"))).rows != alone.rows


def row(**fields):
    return {"fell": False, **fields}


SINGLE = {
    "gait": "walking",
    "paper": {"E_h": 0.064, "E_w": 0.075},
    "rows": [row(error_name="E_h", error=0.1), row(error_name="E_h", error=0.3), row(error_name="E_vy", error=None)],
}


def _by_quantity(figures, controller):
    return {f.quantity: f for f in figures if f.controller == controller}


def test_single_commands_beside_the_paper_and_what_it_prints_for_others():
    protocol = SingleCommandProtocol()
    figures = [*protocol.figures("qp", SINGLE), *protocol.published([("qp", SINGLE)])]
    mine = _by_quantity(figures, "qp")
    assert mine["E_h"].value == pytest.approx(0.2) and mine["E_h"].paper == 0.064 and mine["E_h"].unit == "m"
    assert mine["E_w"].value is None and mine["E_vy"].value is None
    assert mine[FALLS].value == 0.0
    hover = _by_quantity(figures, "HOVER")
    assert hover["E_h"].published == 0.27 and hover["E_h"].estimate is None and hover["E_h"].table == mine["E_h"].table
    assert "E_f" not in hover


def test_every_figure_has_its_interval_and_the_json_says_the_class_of_the_seed():
    config = SingleCommandConfig(Gait.STANDING, episodes=6, seed=3, duration=0.3, settle=0.1)
    result = RUN(HoldController, config)
    content = json.loads(json.dumps(dataclasses.asdict(result)))
    assert content["seed_class"] == "selection" and set(content["intervals"]) == set(content["errors"])
    assert (
        content["intervals"]["E_h"]["value"] == content["errors"]["E_h"] and content["intervals"]["E_h"]["samples"] == 2
    )
    assert content["intervals"]["E_h"]["low"] <= content["errors"]["E_h"] <= content["intervals"]["E_h"]["high"]
    assert content["falls_interval"]["low"] == 0.0 and content["falls_interval"]["high"] == pytest.approx(
        39.03, abs=0.01
    )
    assert "95 % interval" in SingleCommandProtocol().describe(
        result
    ) and "[0.0, 39.0]" in SingleCommandProtocol().describe(result)


IMPACT = {"touch_downs": 9, "speed_median": 0.4, "speed_p95": 0.6, "total_speed_median": 0.5, "total_speed_p95": 0.7}


def test_impacts_are_means_over_the_episodes_but_for_the_maximum():
    rows = [
        row(error_name="E_h", error=0.1, impact=IMPACT | {"peak_mean": 1.2, "peak_max": 2.0}),
        row(error_name="E_h", error=0.1, impact=IMPACT | {"peak_mean": 1.4, "peak_max": 3.0, "speed_median": 0.6}),
        row(error_name="E_h", error=0.1, impact=None),
    ]
    figures = _by_quantity(SingleCommandProtocol().figures("qp", SINGLE | {"rows": rows}), "qp")
    assert figures["touch-down speed, median"].value == pytest.approx(0.5)
    assert figures["peak foot force of 10 ms, mean of stances"].value == pytest.approx(1.3)
    highest = figures["peak foot force of 10 ms, maximum"].estimate
    assert highest.value == 3.0 and highest.low is None and highest.samples == 2


def test_a_default_run_has_16_episodes_of_each_command_of_walking():
    config = SingleCommandConfig()
    names = [name for name, _ in stratified_samples(config, config.episodes)]
    assert {names.count(name) for name in WALKING_NAMES} == {16}
