"""The estimator against the truth: delays, drifts, bounds of consistency, and the requirements over fifty walks."""

import dataclasses
import math

import numpy as np
import pytest

from hugwbc import Gait
from hugwbc.errors import ConfigError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.protocols.estimation import (
    EstimationConfig,
    EstimationProtocol,
    chi_square_bounds,
    delays,
    figure_of,
    walk_command,
)
from hugwbc.runtime.controllers import ControllerSpec

ARENA = Conditions()


def test_bounds_of_a_mean_square_are_those_of_the_chi_square_distribution():
    squares = np.random.default_rng(0).standard_normal((4000, 250)) ** 2
    assert chi_square_bounds(250) == pytest.approx(np.quantile(squares.mean(axis=1), (0.025, 0.975)), rel=0.01)
    # Table of the distribution: 74.22 and 129.56 for 100 degrees of freedom.
    assert chi_square_bounds(100) == pytest.approx((0.7422, 1.2956), rel=1e-3)


def test_delays_of_touch_downs_and_lift_offs_leave_bounces_out():
    time = 0.002 * np.arange(500)
    true, inferred = np.zeros(500, dtype=bool), np.zeros(500, dtype=bool)
    true[100:300], inferred[103:295] = True, True
    true[110:115] = False  # a bounce of 10 ms
    assert delays(inferred, true, time, down=True) == pytest.approx([0.006])
    assert delays(inferred, true, time, down=False) == pytest.approx([-0.010])
    assert delays(np.zeros(500, dtype=bool), true, time, down=True) == []


def test_a_figure_is_the_root_of_the_mean_square_or_a_mean():
    rms = figure_of("v_x", [0.03, 0.04, None])
    assert rms.value == pytest.approx(math.sqrt((0.03**2 + 0.04**2) / 2)) and rms.samples == 2
    assert rms.low is not None and rms.high is not None and rms.low <= rms.value <= rms.high
    assert figure_of("drift", [1.0, 3.0]).value == pytest.approx(2.0)


def test_walks_are_drawn_from_seed_and_number_or_all_go_straight_ahead():
    config = EstimationConfig(conditions=ARENA, seed=4)
    assert walk_command(config, 1) == walk_command(config, 1) != walk_command(config, 2)
    assert walk_command(config, 1) != walk_command(dataclasses.replace(config, seed=5), 1)
    straight = walk_command(dataclasses.replace(config, speed=0.5), 3)
    assert (straight.v_x, straight.v_y, straight.omega) == (0.5, 0.0, 0.0)
    with pytest.raises(ConfigError, match="give --sensing robot"):
        EstimationConfig(conditions=Conditions(sensing="exact"))


def test_a_stand_is_known_and_a_wrong_robot_is_noticed():
    protocol = EstimationProtocol()
    rows = []
    for told in (None, "h1-2023"):
        conditions = dataclasses.replace(ARENA, told=told)
        config = EstimationConfig(Gait.STANDING, episodes=1, duration=0.5, settle=0.2, conditions=conditions)
        result = protocol.run(ControllerSpec("hold").build, config)
        rows += result.rows
        text = protocol.describe(result)
        assert "NEES" in text and "falls: 0 of 1" in text
    right, wrong = rows
    for row in (right, wrong):
        assert row.false_contact is None and row.missed_contact == 0.0  # both feet stand all the time
        assert row.drift is None and row.way < 0.1
        assert max(row.v_x, row.v_y, row.v_z) < 0.05
    assert right != wrong
    quantities = {figure.quantity for figure in protocol.figures("hold", dataclasses.asdict(result))}
    assert {"velocity forward", "roll", "NEES", "drift over 20 m"} <= quantities


@pytest.mark.slow
def test_fifty_random_walks_are_estimated_as_exactly_as_required():
    """Velocity to 0.05 m/s, roll and pitch to half a degree, with biases of 0.01 rad/s and 0.1 m/s^2, and consistent.

    Normalised estimation error squared: 1 for each degree of freedom for an estimator that knows how exact it is. A
    smaller mean is a cautious one.
    """
    config = EstimationConfig(episodes=50, duration=4.0, conditions=ARENA, seed=8)
    result = EstimationProtocol().run(ControllerSpec("learned").build, config)
    figures = {name: estimate.value for name, estimate in result.figures.items()}
    assert result.falls == 0
    assert max(figures[name] for name in ("v_x", "v_y", "v_z")) < 0.05
    assert max(figures["roll"], figures["pitch"]) < math.radians(0.5)
    assert figures["false_contact"] < 0.05 and figures["missed_contact"] < 0.05
    assert 0.1 < float(np.median([row.nees for row in result.rows])) < 1.5
    assert 0.3 < result.nees.value < result.nees_bounds[1]
