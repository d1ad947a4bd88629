import functools

import numpy as np
import pytest

from hugwbc import Command, Gait
from hugwbc.errors import ConfigError
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.protocols import protocol as module
from hugwbc.evaluation.protocols.episodes import Run
from hugwbc.evaluation.protocols.small_velocities import (
    DIRECTIONS,
    SmallVelocitiesConfig,
    SmallVelocitiesJudge,
    SmallVelocitiesProtocol,
    SmallVelocityEpisode,
    sample_episodes,
)
from hugwbc.runtime.controllers import HoldController


def test_each_direction_gets_its_share_of_the_small_speeds_alone():
    commands = sample_episodes(SmallVelocitiesConfig(Gait.WALKING, episodes=32, seed=1))
    velocities = np.array([command.array()[:3] for command in commands])
    assert not velocities[:, 2].any() and (velocities[:, :2] != 0.0).sum(axis=1).tolist() == [1] * 32
    for column, sign in ((0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)):
        speeds = np.sort(sign * velocities[sign * velocities[:, column] > 0.0, column])
        edges = np.linspace(0.1, 0.3, 9)
        assert np.all(speeds >= edges[:-1]) and np.all(speeds <= edges[1:]), "one in each of eight equal parts"
    hops = sample_episodes(SmallVelocitiesConfig(Gait.HOPPING_LEFT, both_legs=True, episodes=8))
    assert [command.gait for command in hops] == [Gait.HOPPING_LEFT] * 4 + [Gait.HOPPING_RIGHT] * 4


@pytest.mark.parametrize(("name", "value"), [("v_x", 0.2), ("v_x", -0.2), ("v_y", 0.2), ("v_y", -0.2)])
def test_the_executed_part_has_the_sign_of_the_command(name, value, synthetic_trace):
    command = Command(**{name: value}, gait=Gait.WALKING)
    judge = SmallVelocitiesJudge(settle=1.0)
    parts = {
        share: judge(
            0, Run(EpisodePlan(command), synthetic_trace(command, bias={name: (share - 1.0) * value}), np.nan)
        ).executed
        for share in (1.0, 0.0, 0.25, -0.5)
    }
    assert list(parts.values()) == pytest.approx(list(parts))


def test_a_robot_that_ignores_the_command_executes_nothing_of_it():
    config = SmallVelocitiesConfig(Gait.WALKING, episodes=4, duration=0.5, settle=0.2)
    rows = []
    result = SmallVelocitiesProtocol().run(HoldController, config, rows.append)
    assert result.rows == tuple(rows) and result.falls == 0
    assert [row.direction for row in rows] == list(result.executed) == list(DIRECTIONS)
    assert abs(result.executed["left"]) < 0.1 and abs(result.executed["right"]) < 0.1
    # It tips forward or backward a little, whatever the command.
    forward, backward = (result.rows[i].executed * result.rows[i].speed for i in (0, 1))
    assert forward == pytest.approx(-backward, abs=1e-6)


def test_bad_settings_are_refused():
    make = functools.partial(SmallVelocitiesConfig, duration=5.0)
    with pytest.raises(ConfigError, match="give 4 or more: one per direction"):
        make(Gait.WALKING, episodes=3)
    with pytest.raises(ConfigError, match="standing has no velocities"):
        make(Gait.STANDING)
    with pytest.raises(ConfigError, match="both_legs is for hopping"):
        make(Gait.WALKING, both_legs=True)


def test_where_a_robot_falls_to_is_no_part_of_a_velocity(monkeypatch):
    executed = iter([0.5, 9.0, 1.0, None])

    def run_episodes(factory, plans, judge, settings, on_episode):
        return [
            SmallVelocityEpisode("walking", direction, 0.2, part, part is None or part > 2.0, 0)
            for direction, part in zip(["forward", "forward", "left", "left"], executed, strict=True)
        ]

    monkeypatch.setattr(module, "run_episodes", run_episodes)
    result = SmallVelocitiesProtocol().run(HoldController, SmallVelocitiesConfig(Gait.WALKING, episodes=4))
    assert result.falls == 2
    assert result.executed == {"forward": 0.5, "backward": None, "left": 1.0, "right": None}
