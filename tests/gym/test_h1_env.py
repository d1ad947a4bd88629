import dataclasses

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import hugwbc.gym  # noqa: F401  registers the environments
from hugwbc.errors import ConfigError
from hugwbc.gym.h1_env import LARGEST_ACTION, H1Env, H1VectorEnv
from hugwbc.learned.config import CurriculumConfig, EnvConfig
from hugwbc.learned.config.environment import RewardTerm
from hugwbc.learned.env import HumanoidEnv
from tests.gym.conftest import actions

SHORT = EnvConfig(episode_steps=3)
FRAME = slice(5 * 63 - 19, 5 * 63)  # last action in the newest frame of the history


@pytest.mark.filterwarnings("error", "ignore:.*symmetric and normalized:UserWarning")
def test_gymnasiums_checker_is_content():
    check_env(gymnasium.make("hugwbc/H1-v0", disable_env_checker=True).unwrapped, skip_render_check=True)


@pytest.mark.filterwarnings("error")
def test_the_vector_form_is_native_and_says_how_it_restarts():
    envs = gymnasium.make_vec("hugwbc/H1-v0", num_envs=4, vectorization_mode="vector_entry_point")
    assert isinstance(envs, H1VectorEnv) and envs.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    observation, info = envs.reset(seed=3)
    assert envs.observation_space.contains(observation) and info["critic"].shape == (4, 122)
    observation, reward, terminated, truncated, _ = envs.step(actions(4))
    assert envs.observation_space.contains(observation)
    assert reward.shape == terminated.shape == truncated.shape == (4,) and terminated.dtype == truncated.dtype == bool
    envs.close()


def test_it_is_the_environment_of_the_training():
    config = dataclasses.replace(EnvConfig(), count=4)
    ours, theirs = H1VectorEnv(4), HumanoidEnv(config, seed=3, threads=1)
    ours.reset(seed=3)
    theirs.begin_episodes(torch.arange(4))
    for step in range(5):
        observation, reward, _, _, info = ours.step(actions(4, step))
        result, seen = theirs.step(torch.from_numpy(actions(4, step))), theirs.observe()
        np.testing.assert_array_equal(reward, result.reward.numpy())
        np.testing.assert_array_equal(observation, torch.cat((seen.history, seen.command), 1).numpy())
        np.testing.assert_array_equal(info["critic"], seen.critic.numpy())


def test_last_observations_are_those_before_the_restart():
    envs = H1VectorEnv(4, config=SHORT)
    envs.reset(seed=3)
    for step in range(3):
        observation, _, terminated, truncated, info = envs.step(actions(4, step))
    assert truncated.all() and not terminated.any() and info["_final_obs"].all()
    for robot in range(4):
        np.testing.assert_allclose(info["final_obs"][robot][FRAME], actions(4, 2)[robot])
        assert not observation[robot, FRAME].any(), "a new episode has no last action"
        assert info["final_info"]["reason"][robot] == "the time was over"
        assert info["final_info"]["critic"][robot].shape == (122,)
    assert "final_obs" not in envs.step(actions(4))[4]


def test_a_fall_terminates():
    envs = H1VectorEnv(4)
    envs.reset(seed=3)
    fell = np.zeros(4, dtype=bool)
    for _ in range(150):
        _, _, terminated, truncated, info = envs.step(np.full((4, 19), 5.0))
        assert not truncated.any()
        reasons = info["final_info"]["reason"] if "final_obs" in info else [None] * 4
        assert [reason == "the robot fell" for reason in reasons] == terminated.tolist()
        fell |= terminated
        if fell.all():
            break
    assert fell.all()


def test_the_same_seed_is_the_same_run_and_one_robot_is_a_vector_of_one():
    runs = []
    for _ in range(2):
        envs = H1VectorEnv(1, config=SHORT)
        rows = [envs.reset(seed=3)[0][0]]
        for step in range(5):
            observation, _, _, _, info = envs.step(actions(1, step))
            rows.append(info["final_obs"][0] if "final_obs" in info else observation[0])
        runs.append(rows)
    env = H1Env(config=SHORT)
    rows = [env.reset(seed=3)[0]]
    for step in range(5):
        observation, _, terminated, truncated, info = env.step(actions(1, step)[0])
        rows.append(observation)
        assert truncated is (step == 2) and not terminated and ("reason" in info) is truncated
    for row, again, single in zip(*runs, rows, strict=True):
        np.testing.assert_array_equal(row, again)
        np.testing.assert_array_equal(row, single)
    assert not np.array_equal(H1VectorEnv(1).reset(seed=4)[0][0], rows[0])


def test_bad_numbers_do_no_harm():
    envs = H1VectorEnv(2)
    envs.reset(seed=3)
    for value in (np.nan, np.inf, -np.inf, 1e30):
        observation, reward, _, _, _ = envs.step(np.full((2, 19), value))
        assert np.isfinite(observation).all() and np.isfinite(reward).all()


def test_the_curriculum_moves_as_in_the_training_unless_it_is_switched_off():
    config = EnvConfig(curriculum=CurriculumConfig(steps=8, warm_up_iterations=0))
    scales = []
    for curriculum in (True, False):
        envs = H1VectorEnv(4, config=config, curriculum=curriculum)
        envs.reset(seed=3)
        for step in range(6):
            envs.step(actions(4, step))
        assert envs.env is not None
        scales.append(envs.env.curriculum.penalty_scale)
    start = config.curriculum.penalty_start
    assert scales == [pytest.approx(start * config.curriculum.penalty_growth**3), start]


def test_many_robots_move_the_curriculum_several_times_in_a_step():
    config = EnvConfig(curriculum=CurriculumConfig(steps=8, warm_up_iterations=0))
    envs = H1VectorEnv(24, config=config)
    envs.reset(seed=3)
    envs.step(actions(24, 0))
    assert envs.env is not None
    grown = config.curriculum.penalty_start * config.curriculum.penalty_growth**3
    assert envs.env.curriculum.penalty_scale == pytest.approx(grown)


def test_rewards_that_are_no_numbers_are_told():
    def odd(transition, body):
        odd.calls += 1
        return torch.full((2,), float("nan") if odd.calls > 3 else 1.0)

    odd.calls = 0
    envs = H1VectorEnv(2, config=EnvConfig(terms={"odd": RewardTerm(odd, 1.0)}))
    envs.reset(seed=3)
    with pytest.warns(RuntimeWarning, match="rewards are not finite, counted as 0: 2 of odd"):
        for step in range(4):
            _, reward, *_ = envs.step(actions(2, step))
    assert np.isfinite(reward).all()


def test_bad_calls_are_refused():
    one = H1Env()
    one.reset(seed=3)
    with pytest.raises(ConfigError, match=r"the action has the shape \(5,\); give 19 numbers"):
        one.step(np.zeros(5))
    with pytest.raises(ConfigError, match=r"EnvConfig\.count is 0"):
        H1VectorEnv(0)
    with pytest.raises(ConfigError, match="render_mode"):
        H1Env(render_mode="human")
    envs = H1VectorEnv(2)
    with pytest.raises(ConfigError, match=r"seed is \[3, 4\]; give 0 or more, a whole number"):
        envs.reset(seed=[3, 4])  # type: ignore[arg-type]  # gymnasium's own vectors take one for each
    for env in (envs, H1Env()):
        with pytest.raises(ConfigError, match=r"options of reset are \{'reset_mask': .*, but none are known"):
            env.reset(options={"reset_mask": [True, False]})
    with pytest.raises(ConfigError, match="call reset first"):
        envs.step(actions(2))
    with pytest.raises(ConfigError, match="seed is -1"):
        envs.reset(seed=-1)
    envs.reset(seed=3)
    with pytest.raises(ConfigError, match=r"shape \(3, 19\); give \(2, 19\)"):
        envs.step(actions(3))
    assert envs.single_action_space.high[0] == LARGEST_ACTION
