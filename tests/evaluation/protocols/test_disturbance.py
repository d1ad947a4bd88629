import dataclasses
import json
import math

import numpy as np
import pytest

from hugwbc import Gait
from hugwbc.errors import ConfigError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.protocols import disturbance as module
from hugwbc.evaluation.protocols.disturbance import (
    DIRECTIONS,
    DisturbanceConfig,
    DisturbanceEpisode,
    DisturbanceProtocol,
    DisturbanceResult,
    disturbance_plan,
)
from hugwbc.runtime.controllers import HoldController

CONFIG = DisturbanceConfig(rollouts=4)


def test_a_rollout_has_the_same_robot_at_every_force():
    weak, strong = (disturbance_plan(CONFIG, "second", 90, force, 2) for force in (50.0, 300.0))
    assert weak.conditions == strong.conditions and weak.draw == 2
    (force,) = strong.forces
    np.testing.assert_allclose(force.vector, [0.0, 300.0, 0.0], atol=1e-9)
    assert (force.duration, force.frame, force.link) == (1.0, "heading", "torso_link")
    assert 1.0 <= force.start <= 1.5 and force.start == weak.forces[0].start
    other = disturbance_plan(CONFIG, "constant", 225, 50.0, 3)
    assert other.conditions != weak.conditions and other.forces[0].start != force.start
    assert other.forces[0].duration is None
    np.testing.assert_allclose(other.forces[0].vector, [-50.0 / math.sqrt(2.0)] * 2 + [0.0])
    both = DisturbanceConfig(Gait.HOPPING_LEFT, both_legs=True)
    hops = [disturbance_plan(both, "second", 90, 50.0, draw).command.gait for draw in (2, 3)]
    assert hops == [Gait.HOPPING_LEFT, Gait.HOPPING_RIGHT]


def test_the_tables_have_the_threshold_of_each_direction(monkeypatch):
    """A robot that survives 300 N towards its front, 100 N towards its back, and twice that for a second."""

    def threshold(row: DisturbanceEpisode) -> float:
        return (200.0 + 100.0 * math.cos(math.radians(row.direction))) * (2.0 if row.kind == "second" else 1.0)

    def run_episodes(factory, plans, judge, settings, on_episode):
        rows = [
            DisturbanceEpisode(kind, int(direction), float(force), 1.0, False, 10.0)
            for kind, direction, force in (plan.label.split() for plan in plans)
        ]
        return [dataclasses.replace(row, fell=row.force > threshold(row)) for row in rows]

    monkeypatch.setattr(module, "run_episodes", run_episodes)
    result = DisturbanceProtocol().run(HoldController, CONFIG)
    for kind, factor in (("constant", 1.0), ("second", 2.0)):
        for direction in DIRECTIONS:
            wanted = factor * (200.0 + 100.0 * math.cos(math.radians(direction)))
            tolerated, refused = result.tolerated[kind][str(direction)], result.refused[kind][str(direction)]
            assert refused is not None and tolerated <= wanted < refused <= tolerated * 1.06
    assert result.episodes == len(result.rows) <= 16 * CONFIG.search().most_loads * CONFIG.rollouts
    assert json.loads(json.dumps(dataclasses.asdict(result)))["tolerated"].keys() == {"constant", "second"}


def test_the_baseline_falls_over_and_tolerates_nothing():
    coarse = Conditions(timestep=0.005)
    config = DisturbanceConfig(
        Gait.STANDING, rollouts=1, limit=50.0, resolution=0.9, duration=2.6, settle=0.1, conditions=coarse
    )
    seen = []
    result = DisturbanceProtocol().run(HoldController, config, seen.append)
    assert result.tolerated["constant"] == dict.fromkeys(map(str, DIRECTIONS), 0.0)
    assert [(row.kind, row.direction) for row in seen[:2]] == [("constant", 0), ("constant", 45)]


def test_bad_settings_are_refused():
    for changes, message in (({"rollouts": 0}, "0 trials"), ({"duration": 2.0}, "leave 1.5 s for the force")):
        with pytest.raises(ConfigError, match=message):
            DisturbanceConfig(**changes)


@pytest.mark.parametrize("refused", [80.0, None])
def test_forces_are_listed_by_direction(refused, lines, standing):
    forces = {
        kind: {str(d): factor * 10.0 + d for d in DIRECTIONS} for kind, factor in (("constant", 1), ("second", 2))
    }
    result = DisturbanceResult(
        rollouts=16,
        tolerated=forces,
        refused={"constant": {"0": refused}, "second": {}},
        episodes=500,
        **standing,
    )
    text = DisturbanceProtocol().describe(result)
    assert lines(text)["90 deg, left"] == ["100", "110"] and lines(text)["45 deg"] == ["55", "65"]
    assert "16 rollouts; 500 rollouts in all" in text and ("limit of the search" in text) == (refused is None)


def test_tolerated_forces_have_the_bracket_of_their_search():
    result = {"tolerated": {"second": {"45": 100.0}}, "refused": {"second": {"45": 105.0}}, "rollouts": 16}
    (figure,) = DisturbanceProtocol().figures("qp", result)
    assert (figure.table, figure.quantity, figure.unit) == ("Tolerated force, for one second", "45°", "N")
    assert figure.estimate is not None and figure.higher_is_better
    assert (figure.value, figure.estimate.low, figure.estimate.high) == (100.0, 100.0, 105.0)
