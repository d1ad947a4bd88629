"""Reward terms that another package registers."""

import dataclasses
import pickle

import pytest
import torch

from hugwbc.errors import ConfigError
from hugwbc.learned.config import EnvConfig, ExtraWeights, RewardWeights, environment as settings
from hugwbc.learned.config.own_settings import PENALTIES, REWARDS, registered_rewards, with_registered
from hugwbc.learned.env import HumanoidEnv
from hugwbc.learned.env.rewards import evaluate_terms, term


@pytest.fixture
def register(monkeypatch, install):
    """The function that registers terms of a module `own_terms`, and returns settings with a weight of 2 for each."""
    plain = settings.ExtraWeights

    def register(group=REWARDS, **functions):
        install("own_terms", group, functions)
        registered_rewards.cache_clear()
        term.cache_clear()
        of_the_paper = [field.name for field in dataclasses.fields(RewardWeights)]
        weights = with_registered(plain, registered_rewards(), "reward", of_the_paper)
        monkeypatch.setattr(settings, "ExtraWeights", weights)
        return EnvConfig(count=3, extra=weights(**dict.fromkeys(functions, 2.0)))

    yield register
    monkeypatch.undo()
    registered_rewards.cache_clear()
    term.cache_clear()


def ones(t, body):
    """Return 1 for every robot."""
    return torch.ones(len(t.command))


def test_without_such_packages_the_settings_are_what_they_were():
    assert registered_rewards() == {} and with_registered(ExtraWeights, registered_rewards(), "reward") is ExtraWeights
    assert [field.name for field in dataclasses.fields(ExtraWeights)][-1] == "unequal_support"


def test_a_term_has_a_weight_and_counts(register):
    config = register(steady=ones)
    assert dataclasses.asdict(config.extra)["steady"] == 2.0 and type(config.extra)().steady == 0.0
    assert pickle.loads(pickle.dumps(config)) == config
    env = HumanoidEnv(config, seed=0, threads=1)
    transition = env._transition(env.readings, torch.zeros(3, dtype=torch.bool))
    rewards = evaluate_terms(transition, env.body, {"steady": 2.0}, penalty_scale=0.5)
    assert torch.allclose(rewards["steady"], torch.full((3,), 2.0 * env.dt)), "it counts in full"
    env.step(torch.zeros(3, 19))


def test_the_curriculum_scales_penalties(register):
    env = HumanoidEnv(register(PENALTIES, steady=ones), seed=0, threads=1)
    transition = env._transition(env.readings, torch.zeros(3, dtype=torch.bool))
    rewards = evaluate_terms(transition, env.body, {"steady": 2.0}, penalty_scale=0.5)
    assert torch.allclose(rewards["steady"], torch.full((3,), env.dt))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (3, "is a int; register a function"),
        (lambda t: t.command, "fails: TypeError"),
        (lambda t, body: t.no_such_thing, "fails: AttributeError.*test_own_rewards.py, line"),
        (lambda t, body: 1.0, "gives a float; give a tensor"),
        (lambda t, body: t.command, r"gives shape \(3, 8\); give a tensor with one number per robot, here \(3,\)"),
        (lambda t, body: t.fallen, "gives .* that are not finite floats"),
        (lambda t, body: t.height / 0.0, "gives .* that are not finite floats"),
    ],
)
def test_a_term_that_does_not_work_is_refused_before_the_first_step(register, wrong, message):
    config = register(wrong=wrong)
    with pytest.raises(ConfigError, match=rf"reward 'wrong' \(own_terms:wrong\) {message}"):
        HumanoidEnv(config, seed=0, threads=1)


def test_a_term_that_is_switched_on_later_is_tried_then(register):
    config = register(wrong=lambda t, body: 1.0)
    env = HumanoidEnv(dataclasses.replace(config, extra=type(config.extra)()), seed=0, threads=1)
    with pytest.raises(ConfigError, match="gives a float"):
        env.adopt(config)


def test_names_that_are_taken_or_no_options_are_refused(register):
    for name in ("alive", "feet_slip"):
        with pytest.raises(ConfigError, match=f"reward '{name}' .* has the name of a reward of hugwbc"):
            register(**{name: ones})
    with pytest.raises(ConfigError, match="is no name of an option"):
        register(**{"two words": ones})
