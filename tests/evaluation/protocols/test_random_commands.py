import dataclasses
import json

import numpy as np
import pytest

from hugwbc import Gait
from hugwbc.commands import command_ranges
from hugwbc.errors import ConfigError
from hugwbc.evaluation.engine import Execution
from hugwbc.evaluation.protocols.random_commands import (
    RandomCommandsConfig,
    RandomCommandsProtocol,
    RandomEpisode,
    failing_combinations,
    sample_episodes,
)
from hugwbc.runtime.controllers import ControllerSpec, HoldController


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
