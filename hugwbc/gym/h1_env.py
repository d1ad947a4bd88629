"""The training environment of the learned policy for gymnasium: joint targets at 50 Hz in, its observations out."""

import dataclasses
import warnings
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from hugwbc.errors import ConfigError
from hugwbc.gym import check_no_options
from hugwbc.learned.config import EnvConfig
from hugwbc.learned.env import HumanoidEnv
from hugwbc.learned.policy.critic_observations import Observation
from hugwbc.learned.policy.terms import ACTION, COMMAND, HISTORY, further_terms, size_of
from hugwbc.numeric import floats
from hugwbc.robot import load_robot
from hugwbc.sim.engine import check_seed

LARGEST_ACTION = 10.0  # 2.5 rad of joint target at the default scale, more than any joint needs
_LARGEST = 1e4  # bound of every number of an observation
_LAST_SEED = 2**31 - 1


def _spaces(config: EnvConfig) -> tuple[spaces.Box, spaces.Box]:
    """Return the spaces of a robot's actions and of its observations, including terms besides the paper's."""
    robot = load_robot(config.robot)
    seen = (*HISTORY, *COMMAND, *further_terms(config.observations, robot))
    bounds = ((ACTION, LARGEST_ACTION), (seen, _LARGEST))
    action, observation = (
        spaces.Box(-largest, largest, (size_of(parts, robot),), np.float32) for parts, largest in bounds
    )
    return action, observation


class H1VectorEnv(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """Many H1s at once in `HumanoidEnv`, without a loop over them in Python.

    Robots whose episode has ended begin the next one in the same step. `info["final_obs"]` then has the last
    observation of the episode that ended, for bootstrapping. Sizes are those of an H1 with the paper's observations.

    Attributes:
        config: the settings.
        joints: number of joints, and of an action's numbers.
        env: the training environment; None before the first `reset`.
    """

    metadata = {"render_modes": [], "render_fps": 50, "autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012

    def __init__(
        self,
        num_envs: int = 1,
        *,
        config: EnvConfig | None = None,
        threads: int = 1,
        curriculum: bool = True,
        render_mode: str | None = None,
    ) -> None:
        """Set up spaces; the robots are built by `reset`.

        Args:
            num_envs: number of robots.
            config: settings of the environment; its `count` gives way to `num_envs`. None for those of the training.
            threads: threads of the simulation.
            curriculum: whether levels of noise, speed and penalties rise as in the training; otherwise they stay as
                they begin.
            render_mode: None; there is nothing to render.
        """
        if render_mode is not None:
            raise ConfigError(f"render_mode is {render_mode!r}; give None")
        self.config = dataclasses.replace(config or EnvConfig(), count=num_envs)
        self.num_envs, self.render_mode = num_envs, render_mode
        self.single_action_space, self.single_observation_space = _spaces(self.config)
        self.joints = len(load_robot(self.config.robot).joint_names)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.env: HumanoidEnv | None = None
        self._threads, self._curriculum = threads, curriculum
        self._steps = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode of every robot.

        Args:
            seed: of all random numbers. With a seed the robots are rebuilt, with other masses, frictions and delays;
                without one, they stay the same, and so do the levels of the curricula.
            options: none are known, so that others than None and {} are refused.

        Returns:
            Observations, shape (num_envs, 333), and `info` with "critic", the privileged observations of the training.
        """
        check_no_options(options)
        if seed is not None:
            check_seed(seed)
        super().reset(seed=seed)
        if self.env is None or seed is not None:
            drawn = int(self.np_random.integers(_LAST_SEED)) if seed is None else seed
            self.env = HumanoidEnv(self.config, seed=drawn, threads=self._threads)
            self._steps = 0
        # The training starts episodes at random ages; here all start together.
        self.env.begin_episodes(torch.arange(self.num_envs))
        observation = self.env.observe()
        return _actor(observation), {"critic": _rows(observation.critic)}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Advance all robots by 20 ms.

        Args:
            actions: outputs of a policy, shape (num_envs, joints): joint targets relative to the nominal pose, in
                `config.action_scales` [rad]. NaN counts as 0, and what is beyond `LARGEST_ACTION` is clamped.

        Returns:
            Observations after the step, or of a new episode where one has ended, shape (num_envs, 333); rewards, falls
            and time-outs, shape (num_envs,); and `info`: "critic", and where an episode has ended "final_obs" and
            "final_info" with "critic" and "reason", with the masks "_final_obs" and "_final_info".
        """
        env = self.env
        if env is None:
            raise ConfigError("there is no episode; call reset first")
        result = env.step(torch.from_numpy(self._admitted(actions)))
        self._steps += self.num_envs
        size = self.config.curriculum.steps
        for _ in range((self._steps // size - (self._steps - self.num_envs) // size) * self._curriculum):
            env.update_curriculum()
        if faults := env.statistics.faults():
            warnings.warn(f"rewards are {faults}", RuntimeWarning, stacklevel=2)
        observation = env.observe()
        fell, truncated, done = (ends.numpy() for ends in (result.terminated, result.truncated, result.done))
        info: dict[str, Any] = {"critic": _rows(observation.critic)}
        if done.any():
            info |= self._last(result.final, done, truncated)
        return _actor(observation), result.reward.numpy().astype(np.float64), fell, truncated, info

    def _admitted(self, actions: np.ndarray) -> np.ndarray:
        """Return finite actions within the space."""
        shape = (self.num_envs, self.joints)
        given = floats(actions, shape)
        if given is None:
            raise ConfigError(
                f"the actions have the shape {getattr(actions, 'shape', 'unknown')}; give {shape} numbers"
            )
        return np.nan_to_num(given).clip(-LARGEST_ACTION, LARGEST_ACTION).astype(np.float32)

    def _last(self, final: Observation, done: np.ndarray, truncated: np.ndarray) -> dict[str, Any]:
        """Return the last observations of the episodes that have ended, in the places of their robots."""
        last, critic = np.full(self.num_envs, None, dtype=object), np.full(self.num_envs, None, dtype=object)
        reason = np.full(self.num_envs, None, dtype=object)
        for place, row, privileged in zip(np.flatnonzero(done), _actor(final), _rows(final.critic), strict=True):
            last[place], critic[place] = row, privileged
            reason[place] = "the time was over" if truncated[place] else "the robot fell"
        ended = {"critic": critic, "_critic": done, "reason": reason, "_reason": done}
        return {"final_obs": last, "_final_obs": done, "final_info": ended, "_final_info": done}

    def close_extras(self, **kwargs: Any) -> None:  # noqa: ANN401  the signature of gymnasium
        """Let go of the robots."""
        self.env = None


class H1Env(gymnasium.Env[np.ndarray, np.ndarray]):
    """One robot of `H1VectorEnv`."""

    metadata = {"render_modes": [], "render_fps": 50}  # noqa: RUF012  as gymnasium declares it

    def __init__(
        self, *, config: EnvConfig | None = None, curriculum: bool = True, render_mode: str | None = None
    ) -> None:
        """Set up spaces; arguments as of `H1VectorEnv`."""
        self._robots = H1VectorEnv(1, config=config, curriculum=curriculum, render_mode=render_mode)
        self.render_mode = render_mode
        robot = self._robots
        self.action_space, self.observation_space = robot.single_action_space, robot.single_observation_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode; see `H1VectorEnv.reset`.

        Returns:
            The observation, shape (333,), and `info` with "critic".
        """
        super().reset(seed=seed)
        observation, info = self._robots.reset(seed=seed, options=options)
        return observation[0], {"critic": info["critic"][0]}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Advance by 20 ms; see `H1VectorEnv.step`.

        Returns:
            Observation, reward, whether the robot fell, whether the time was over, and `info` with "critic" and at the
            end "reason".
        """
        given = floats(action, (self._robots.joints,))
        if given is None:
            shape = getattr(action, "shape", "unknown")
            raise ConfigError(f"the action has the shape {shape}; give {self._robots.joints} numbers")
        observation, reward, fell, over, info = self._robots.step(given[None])
        shown = {"critic": info["critic"][0]}
        last = observation[0]
        if "final_obs" in info:
            last = info["final_obs"][0]
            shown |= {name: info["final_info"][name][0] for name in ("critic", "reason")}
        return last, float(reward[0]), bool(fell[0]), bool(over[0]), shown

    def close(self) -> None:
        """Let go of the robot."""
        self._robots.close()


def _actor(observation: Observation) -> np.ndarray:
    """Return what the policy reads: history and command, shape (k, 333)."""
    return _rows(torch.cat((observation.history, observation.command), dim=1))


def _rows(tensor: torch.Tensor) -> np.ndarray:
    """Return a tensor as an array of its own; a diverged robot's NaN becomes 0."""
    return np.clip(np.nan_to_num(tensor.numpy(), nan=0.0, posinf=_LARGEST, neginf=-_LARGEST), -_LARGEST, _LARGEST)
