import dataclasses
import json

import numpy as np
import pytest

from hugwbc import Gait
from hugwbc.commands import command_ranges
from hugwbc.errors import ConfigError
from hugwbc.evaluation.engine import Execution, ResultStore
from hugwbc.evaluation.protocols.random_commands import (
    RandomCommandsConfig,
    RandomCommandsProtocol,
    RandomEpisode,
    combined_errors,
    failing_combinations,
    sample_episodes,
)
from hugwbc.evaluation.protocols.single_command import SingleCommandConfig, SingleCommandProtocol
from hugwbc.runtime.controllers import ControllerSpec, HoldController

PROTOCOL = RandomCommandsProtocol()


def test_every_command_is_drawn_over_its_full_range_independently():
    config = RandomCommandsConfig(Gait.WALKING, episodes=4000, seed=1)
    commands = sample_episodes(config)
    assert commands == sample_episodes(config)
    values = np.array([command.array() for command in commands])
    low, high = np.array([limits.finishing for limits in command_ranges(Gait.WALKING).values()]).T
    np.testing.assert_allclose(values.mean(axis=0), (low + high) / 2, atol=0.05)
    assert np.all(values >= low) and np.all(values <= high)
    correlation = np.corrcoef(values.T) - np.eye(8)
    assert np.abs(correlation).max() < 0.06
    legs = {command.gait for command in sample_episodes(RandomCommandsConfig(Gait.HOPPING_LEFT, both_legs=True))}
    assert legs == {Gait.HOPPING_LEFT, Gait.HOPPING_RIGHT}


def episode(fell: bool, **values: float) -> RandomEpisode:
    command = {name: limits.default for name, limits in command_ranges(Gait.HOPPING_LEFT).items()} | values
    return RandomEpisode("hopping_left", command, fell, 1.0, {}, 0)


def test_combinations_name_the_thirds_in_which_robots_fell():
    # Hopping draws v_x, v_y, omega within 0.6 and h from -0.3 to 0; all are in the middle but for what is given.
    middle = {"v_x": 0.0, "v_y": 0.0, "omega": 0.0, "h": -0.15}
    rows = [
        episode(True, **middle | {"v_x": 0.5, "h": -0.01}),
        episode(True, **middle | {"v_x": 0.5, "h": -0.01}),
        episode(False, **middle | {"v_x": 0.5}),
        episode(False, **middle),
    ]
    found = {
        tuple(sorted(c.parts.items())): (c.falls, c.episodes)
        for c in failing_combinations(rows, Gait.HOPPING_LEFT)
    }  # fmt: skip
    assert found[(("h", "high"), ("v_x", "high"))] == (2, 2)
    assert found[(("v_x", "high"),)] == (2, 3)
    assert found[(("h", "high"),)] == (2, 2)
    assert found[(("omega", "middle"),)] == (2, 4)
    assert (("v_x", "middle"),) not in found and not any("f" in dict(parts) for parts in found)
    first = failing_combinations(rows, Gait.HOPPING_LEFT)[0]
    assert (first.falls, first.episodes, len(first.parts)) == (2, 2, 1)


def test_falls_of_a_robot_that_only_holds_its_pose():
    config = RandomCommandsConfig(Gait.STANDING, episodes=3, duration=0.3, settle=0.1, seed=2)
    rows = []
    result = RandomCommandsProtocol().run(HoldController, config, rows.append)
    assert result.rows == tuple(rows) and result.falls == 0 and result.combinations == ()
    for row, command in zip(result.rows, sample_episodes(config), strict=True):
        assert row.command["h"] == command.h
        assert row.errors["h"] == pytest.approx(abs(command.h), abs=0.06)  # it stays near h = 0, whatever is commanded
    assert json.loads(json.dumps(dataclasses.asdict(result)))["fall_rate"] == 0.0
    assert (
        RandomCommandsProtocol().run(ControllerSpec("hold").build, dataclasses.replace(config, execution=Execution(2)))
        == result
    )


def test_bad_settings_are_refused():
    with pytest.raises(ConfigError, match="give 1 or more"):
        RandomCommandsConfig(Gait.WALKING, episodes=0)
    with pytest.raises(ConfigError, match="give 0 <= settle < duration"):
        RandomCommandsConfig(Gait.WALKING, settle=20.0)


def test_errors_leave_falls_out_and_have_intervals():
    rows = [
        {"gait": "standing", "fell": fell, "command": {"h": -0.1, "p": 0.0, "w": 0.0}, "errors": errors}
        for fell, errors in (
            (False, {"h": 0.1, "p": 0.2, "w": 0.3, "v_x": 9.0}),
            (False, {"h": 0.3, "p": 0.2, "w": 0.3, "v_x": 9.0}),
            (True, {"h": 9.0, "p": None, "w": 9.0, "v_x": 9.0}),
        )
    ]
    errors = combined_errors(rows)
    assert {name: found for name, found in errors.items() if found} == {
        "E_h": [0.1, 0.3], "E_p": [0.2, 0.2], "E_w": [0.3, 0.3]
    }  # fmt: skip
    figures = {f.quantity: f for f in PROTOCOL.figures("qp", {"gait": "standing", "rows": rows})}
    assert figures["E_h"].value == pytest.approx(0.2) and figures["falls"].value == pytest.approx(100.0 / 3.0)
    single = [{"error_name": "E_h", "error": e, "fell": f} for e, f in ((0.1, False), (0.1, False), (5.0, True))]
    results = {
        "random-commands": [("qp", {"gait": "standing", "rows": rows})],
        "single-command": [("qp", {"gait": "standing", "rows": single}), ("qp", {"gait": "walking", "rows": []})],
    }
    (ratio,) = PROTOCOL.across(results)
    assert (ratio.quantity, ratio.controller) == ("E_h, over that alone", "qp") and ratio.value == pytest.approx(2.0)
    assert ratio.table == figures["E_h"].table
    assert PROTOCOL.across({"random-commands": results["random-commands"]}) == []


def test_stored_single_commands_give_the_ratio(tmp_path):
    settings = {"duration": 0.3, "settle": 0.1, "execution": Execution(store=ResultStore(tmp_path))}
    factory = ControllerSpec("hold").build
    alone = PROTOCOL.run(factory, RandomCommandsConfig(Gait.STANDING, episodes=3, **settings))
    assert alone.single == {} and "run `hugwbc evaluate single-command`" in PROTOCOL.describe(alone)
    single = SingleCommandProtocol().run(factory, SingleCommandConfig(Gait.STANDING, episodes=6, **settings))
    result = PROTOCOL.run(factory, RandomCommandsConfig(Gait.STANDING, episodes=3, **settings))
    assert result.errors == alone.errors and set(result.errors) == set(single.errors)
    assert result.single["E_h"] == single.intervals["E_h"]
    ratio = result.ratios["E_h"].value
    assert ratio == pytest.approx(result.errors["E_h"] / single.errors["E_h"]) and "alone" in PROTOCOL.describe(result)
    other = RandomCommandsConfig(Gait.STANDING, episodes=3, **(settings | {"duration": 0.4}))
    assert PROTOCOL.run(factory, other).single == {}, "episodes of another length do not compare"
    fresh = settings | {"execution": Execution(store=ResultStore(tmp_path, fresh=True))}
    assert PROTOCOL.run(factory, RandomCommandsConfig(Gait.STANDING, episodes=3, **fresh)).single == {}
    names = [path.name for path in tmp_path.iterdir()]
    assert sum(name.startswith("single_command") for name in names) == 1, "the other protocol's file stays in place"
