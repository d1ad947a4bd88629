"""Learners that are not ours, on the robots of the training: what they are told, and that they learn."""

import contextlib
import dataclasses
import functools
import io
import pathlib
import re

import numpy as np
import pytest
import torch

from hugwbc.gym.h1_env import H1VectorEnv
from hugwbc.gym.rsl_rl_env import GROUPS, H1RslRlEnv
from hugwbc.gym.stable_baselines_env import H1StableBaselinesEnv
from hugwbc.learned.config import EnvConfig
from tests.gym.conftest import actions

HOW_TO = pathlib.Path(__file__).parents[2] / "docs" / "how-to" / "use-gymnasium.md"
SHORT = EnvConfig(episode_steps=3)


class TestRslRl:
    def test_it_is_the_environment_of_the_training(self):
        env, robots = H1RslRlEnv(3, seed=4), H1VectorEnv(3)
        first, info = robots.reset(seed=4)
        np.testing.assert_array_equal(env.get_observations()["policy"], first)
        np.testing.assert_array_equal(env.get_observations()["privileged"], info["critic"])
        for step in range(4):
            seen, reward, done, extras = env.step(torch.from_numpy(actions(3, step)))
            expected, rewards, fell, over, info = robots.step(actions(3, step))
            np.testing.assert_array_equal(seen["policy"], expected)
            np.testing.assert_array_equal(seen["privileged"], info["critic"])
            np.testing.assert_allclose(reward, rewards, rtol=1e-6)
            assert done.tolist() == (fell | over).tolist() and extras["time_outs"].tolist() == over.tolist()
            assert env.episode_length_buf.tolist() == [step + 1] * 3

    def test_last_observations_are_those_before_the_restart(self):
        env, robots = H1RslRlEnv(3, config=SHORT, seed=4), H1VectorEnv(3, config=SHORT)
        robots.reset(seed=4)
        for step in range(3):
            seen, _, done, extras = env.step(torch.from_numpy(actions(3, step)))
            info = robots.step(actions(3, step))[-1]
        assert done.all() and extras["time_outs"].all() and extras["final_robots"].tolist() == [0, 1, 2]
        last = extras["final_observations"]
        np.testing.assert_array_equal(last["policy"], np.stack(list(info["final_obs"])))
        np.testing.assert_array_equal(last["privileged"], np.stack(list(info["final_info"]["critic"])))
        assert not torch.equal(last["policy"], seen["policy"])

    def test_rsl_rl_may_spread_the_ages(self):
        env = H1RslRlEnv(3, config=dataclasses.replace(SHORT, episode_steps=50))
        env.episode_length_buf = torch.tensor([0, 49, 10])
        done = env.step(torch.from_numpy(actions(3)))[2]
        assert done.tolist() == [False, True, False]

    def test_its_ppo_learns_with_it(self):
        from rsl_rl.runners import OnPolicyRunner

        torch.manual_seed(0)
        network = {"class_name": "MLPModel", "hidden_dims": [16], "obs_normalization": True}
        gaussian = {"class_name": "GaussianDistribution", "init_std": 0.3}
        settings = {
            "num_steps_per_env": 4,
            "obs_groups": GROUPS,
            "algorithm": {"class_name": "PPO", "learning_rate": 1e-3, "num_learning_epochs": 1, "num_mini_batches": 1},
            "actor": network | {"distribution_cfg": gaussian},
            "critic": dict(network),
        }
        with contextlib.redirect_stdout(io.StringIO()):
            runner = OnPolicyRunner(H1RslRlEnv(4, config=SHORT), settings)
            before = [parameter.detach().clone() for parameter in runner.alg.actor.parameters()]
            runner.learn(2)
        after = list(runner.alg.actor.parameters())
        assert all(bool(parameter.isfinite().all()) for parameter in after)
        assert not any(torch.equal(old, new) for old, new in zip(before, after, strict=True))

    @pytest.mark.slow
    def test_its_ppo_earns_more_after_200_000_steps(self):
        """The program of docs/how-to/use-gymnasium.md, with the rewards of the steps averaged."""
        found = re.search(r'title="learn_rsl_rl.py"\n(.*?)^```$', HOW_TO.read_text(), re.DOTALL | re.MULTILINE)
        assert found is not None
        rewards: list[float] = []

        def noted(env, actions):
            result = type(env).step(env, actions)
            rewards.append(float(result[1].mean()))
            return result

        built, learning = found[1].split("OnPolicyRunner(env, settings)")
        names: dict = {}
        threads = torch.get_num_threads()
        try:
            with contextlib.redirect_stdout(io.StringIO()):
                exec(built, names)  # what the page shows
                names["env"].step = functools.partial(noted, names["env"])
                names["OnPolicyRunner"](names["env"], names["settings"]).learn(97)
        finally:
            torch.set_num_threads(threads)
        assert learning.startswith(".learn(") and len(rewards) == 97 * 128
        tenth = len(rewards) // 10
        first, last = np.mean(rewards[tenth : 2 * tenth]), np.mean(rewards[-tenth:])
        assert last > 0.03 and last > first


class TestStableBaselines:
    def test_it_is_the_environment_of_the_training(self):
        env, robots = H1StableBaselinesEnv(3, seed=4), H1VectorEnv(3)
        first, info = robots.reset(seed=4)
        np.testing.assert_array_equal(env.reset(), first)
        np.testing.assert_array_equal(env.reset_infos[2]["critic"], info["critic"][2])
        for step in range(4):
            seen, reward, done, infos = env.step(actions(3, step))
            expected, rewards, fell, over, info = robots.step(actions(3, step))
            np.testing.assert_array_equal(seen, expected)
            np.testing.assert_allclose(reward, rewards, rtol=1e-6)
            np.testing.assert_array_equal(infos[1]["critic"], info["critic"][1])
            assert done.tolist() == (fell | over).tolist()

    def test_last_observations_are_those_before_the_restart(self):
        env, robots = H1StableBaselinesEnv(3, config=SHORT, seed=4), H1VectorEnv(3, config=SHORT)
        env.reset()
        robots.reset(seed=4)
        for step in range(3):
            _, _, done, infos = env.step(actions(3, step))
            info = robots.step(actions(3, step))[-1]
        assert done.all()
        for robot, told in enumerate(infos):
            np.testing.assert_array_equal(told["terminal_observation"], info["final_obs"][robot])
            assert told["TimeLimit.truncated"] and told["reason"] == "the time was over"

    def test_a_reset_keeps_the_robots_and_a_seed_builds_others(self):
        env = H1StableBaselinesEnv(2, seed=4)
        env.reset()
        built = env.robots.env
        env.reset()
        assert env.robots.env is built
        env.seed(5)
        env.reset()
        assert env.robots.env is not built and not torch.equal(env.robots.env.mass, built.mass)
        with pytest.raises(AttributeError, match="all robots are one environment"):
            env.set_attr("config", None)
        assert env.get_attr("config") == [env.robots.config] * 2 and env.env_is_wrapped(None, 1) == [False]

    def test_its_ppo_learns_with_it(self):
        from stable_baselines3 import PPO
        from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

        env = VecNormalize(VecMonitor(H1StableBaselinesEnv(4, config=SHORT)), norm_reward=False)
        learner = PPO("MlpPolicy", env, n_steps=4, batch_size=16, n_epochs=1, policy_kwargs={"net_arch": [16]}, seed=0)
        before = [parameter.detach().clone() for parameter in learner.policy.mlp_extractor.parameters()]
        learner.learn(32)
        after = list(learner.policy.mlp_extractor.parameters())
        assert learner.num_timesteps == 32 and all(bool(parameter.isfinite().all()) for parameter in after)
        assert not any(torch.equal(old, new) for old, new in zip(before, after, strict=True))
        assert {told["l"] for told in learner.ep_info_buffer} == {3}, "it hears how episodes went"
