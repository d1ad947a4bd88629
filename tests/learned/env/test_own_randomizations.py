"""Randomisations that another package registers."""

import dataclasses

import numpy as np
import pytest

from hugwbc.errors import ConfigError
from hugwbc.learned.config import RandomizationConfig, robot_settings
from hugwbc.learned.config.own_settings import RANDOMIZATIONS, registered_randomizations, with_registered
from hugwbc.learned.env.randomization import randomize
from hugwbc.sim.batch import BatchSimulation


@pytest.fixture
def register(monkeypatch, install):
    """The function that registers randomisations of a module `own_draws`, and returns the class of settings."""
    plain = robot_settings.RandomizationConfig

    def register(**functions):
        install("own_draws", RANDOMIZATIONS, functions)
        registered_randomizations.cache_clear()
        settings = with_registered(plain, registered_randomizations(), "randomization")
        monkeypatch.setattr(robot_settings, "RandomizationConfig", settings)
        return settings

    yield register
    monkeypatch.undo()
    registered_randomizations.cache_clear()


def springs(simulation, width, rng):
    """Draw a spring for every joint."""
    simulation.batch.expand("jnt_stiffness")[:] = rng.uniform(0.0, width, (simulation.count, simulation.model.njnt))


def _draw(config):
    simulation = BatchSimulation(2)
    randomize(simulation, config, np.random.default_rng(0))
    return simulation.batch


def test_without_such_packages_the_settings_are_what_they_were():
    assert registered_randomizations() == {}
    assert with_registered(RandomizationConfig, registered_randomizations(), "randomization") is RandomizationConfig


def test_a_width_switches_it_on_and_changes_no_other_draw(register):
    settings = register(springs=springs)
    off, on = _draw(settings()), _draw(settings(springs=3.0))
    assert off.expanded("jnt_stiffness") is None
    assert 0.0 < on.expand("jnt_stiffness").max() < 3.0
    np.testing.assert_array_equal(off.expand("body_mass"), on.expand("body_mass"))
    assert settings.off().springs == 0.0 and dataclasses.asdict(settings(springs=3.0))["springs"] == 3.0


@pytest.mark.parametrize("width", [-1.0, float("nan"), float("inf")])
def test_a_width_is_checked(register, width):
    with pytest.raises(ConfigError, match="springs"):
        register(springs=springs)(springs=width)


def _infinite(simulation, width, rng):
    simulation.batch.expand("body_mass")[0, 3] = np.inf


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (3, "is a int; register a function of a batch, a width and a generator"),
        (lambda simulation: None, "fails: TypeError"),
        (lambda simulation, width, rng: simulation.nothing, "fails: AttributeError.*test_own_randomizations.py, line"),
        (_infinite, "leaves numbers in body_mass that are not finite"),
    ],
)
def test_one_that_does_not_work_is_refused(register, wrong, message):
    settings = register(wrong=wrong)
    with pytest.raises(ConfigError, match=rf"randomization 'wrong' \(own_draws:wrong\) {message}"):
        _draw(settings(wrong=1.0))


def test_names_that_are_taken_are_refused(register):
    with pytest.raises(ConfigError, match="has the name of a randomization of hugwbc"):
        register(friction=springs)
