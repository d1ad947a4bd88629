"""Rewards, curricula and randomisations of a user's settings."""

import dataclasses

import numpy as np
import pytest
import torch

from hugwbc.cli import USAGE_ERROR, main
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.learned.config import CurriculumConfig, EnvConfig, RandomizationConfig, RewardTerm, Schedule, TrainConfig
from hugwbc.learned.env import HumanoidEnv
from hugwbc.learned.env.randomization import randomize
from hugwbc.learned.env.rewards import evaluate_terms
from hugwbc.learned.policy.records import settings_record
from hugwbc.robot import load_robot
from hugwbc.sim.batch import BatchSimulation


def ones(t, body):
    return torch.ones(len(t.command))


def rise(value, curriculum):
    return value + 0.25


def springs(simulation, rng):
    shape = simulation.count, simulation.model.njnt
    simulation.expand("jnt_stiffness")[:] = simulation.tensor(rng.uniform(0.0, 3.0, shape))


def robots(**settings):
    return HumanoidEnv(EnvConfig(count=2, **settings), seed=0, threads=1)


@pytest.mark.parametrize(("penalty", "scale"), [(False, 1.0), (True, 0.5)])
def test_a_reward_counts_with_its_weight_and_as_a_penalty_by_its_curriculum(penalty, scale):
    env = robots(terms={"steady": RewardTerm(ones, 2.0, penalty)})
    transition = env._transition(env.readings, torch.zeros(2, dtype=torch.bool))
    rewards = evaluate_terms(env.config.terms, transition, env.body, penalty_scale=0.5)
    assert torch.allclose(rewards["steady"], torch.full((2,), scale * 2.0 * env.dt))
    env.step(torch.zeros(2, 19))
    assert "reward/steady" in env.statistics.pop()


@pytest.mark.parametrize("wrong", [lambda t, body: 1.0, lambda t, body: t.command, lambda t, body: t.height / 0.0])
def test_a_reward_that_is_not_one_finite_number_per_robot_is_refused(wrong):
    with pytest.raises(ConfigError, match="reward 'wrong' gives"):
        robots(terms={"wrong": RewardTerm(wrong, 1.0)})


def test_a_rule_moves_a_setting_after_the_warm_up_and_is_part_of_the_state():
    curriculum = CurriculumConfig(warm_up_iterations=1, rules={"loads.payload": rise})
    env, again = robots(curriculum=curriculum), robots(curriculum=curriculum)
    payloads = []
    for _ in range(3):
        env.update_curriculum()
        payloads.append(env.loads.config.payload)
    assert payloads == [0.0, 0.25, 0.5] and env.levels == {"rule/loads.payload": 0.5}
    again.load_state_dict(env.state_dict())
    assert again.loads.config.payload == 0.5
    env.adopt(EnvConfig(count=2, curriculum=curriculum))
    assert env.config.loads.payload == 0.5, "a schedule moves other settings, not this one"


@pytest.mark.parametrize("name", ["count", "loads.nothing", "nothing"])
def test_a_rule_for_a_setting_that_the_robots_cannot_take_over_is_refused(name):
    with pytest.raises(UnknownNameError, match=name.removeprefix("loads.")):
        EnvConfig(curriculum=CurriculumConfig(rules={name: rise}))


@pytest.mark.parametrize("name", ["loads", "loads.hand_time", "curriculum.steps", "curriculum.agile_fraction"])
def test_a_rule_that_would_fail_later_or_do_nothing_is_refused(name):
    with pytest.raises(ConfigError, match=f"no rule can move '{name}'"):
        EnvConfig(curriculum=CurriculumConfig(rules={name: rise}))


def test_a_rule_moves_a_whole_number_by_whole_numbers():
    rules = {"command.resample_steps": lambda value, curriculum: 1.01 * value}
    env = robots(curriculum=CurriculumConfig(warm_up_iterations=0, rules=rules))
    env.update_curriculum()
    assert env.config.command.resample_steps == 303
    env.update_curriculum()
    assert env.config.command.resample_steps == 306


def test_a_randomisation_comes_after_ours():
    def drawn(**settings):
        simulation = BatchSimulation(2, robot=load_robot())
        randomize(simulation, RandomizationConfig(**settings), np.random.default_rng(0))
        return simulation

    plain, springy = drawn(), drawn(functions=(springs,))
    assert 0.0 < springy.expand("jnt_stiffness").max() < 3.0
    np.testing.assert_array_equal(plain.expand("body_mass"), springy.expand("body_mass"))


def test_names_of_ours_are_taken():
    with pytest.raises(ConfigError, match="reward 'feet_slip' exists"):
        EnvConfig(terms={"feet_slip": RewardTerm(ones, 1.0)})


def test_the_record_of_a_policy_names_the_functions():
    env = EnvConfig(terms={"steady": RewardTerm(ones, 2.0)}, randomization=RandomizationConfig(functions=(springs,)))
    config = TrainConfig(env=env, schedules={"env.loads.payload": Schedule({0: 0.0, 1e6: 1.0})}).at(5e5)
    assert dataclasses.asdict(config)["env"]["loads"]["payload"] == 0.5
    record = settings_record(config)["env"]
    assert record["terms"]["steady"]["function"] == f"{__name__}.ones"
    assert record["randomization"]["functions"] == [f"{__name__}.springs"]


@pytest.mark.parametrize(("text", "message"), [("other = 1", "has no 'CONFIG'"), ("CONFIG = 1", "is a int; make it a")])
def test_a_file_without_settings_is_refused(tmp_path, capsys, text, message):
    (tmp_path / "mine.py").write_text(text)
    assert main(["train", "--config", str(tmp_path / "mine.py"), "--out", str(tmp_path / "run")]) == USAGE_ERROR
    assert message in capsys.readouterr().err and not (tmp_path / "run").exists()
