"""The robots of `hugwbc/H1-v0` for the learners of rsl_rl (extra `[rsl-rl]`)."""

from typing import Any

import numpy as np
import torch
from rsl_rl.env import VecEnv
from tensordict import TensorDict

from hugwbc.gym.h1_env import H1VectorEnv
from hugwbc.learned.config import EnvConfig

GROUPS = {"actor": ["policy"], "critic": ["privileged"]}
"""`obs_groups` of a runner's configuration: the critic sees what the simulation knows."""


class H1RslRlEnv(VecEnv):
    """Many H1s as rsl_rl's `VecEnv`; robots whose episode has ended begin the next one in the same step.

    Observations are a TensorDict of "policy", shape (n, 333), and "privileged", shape (n, 122) on a plane. The extras
    of a step have "time_outs", shape (n,), bool, and if episodes have ended "final_robots", their indices (k,), and
    "final_observations", their last observations. rsl_rl does not read these: after a time-out it bootstraps with the
    value of the observation before the last step.

    Attributes:
        robots: the environment within.
        num_envs, num_actions, max_episode_length, episode_length_buf, device, cfg: as rsl_rl names them.
    """

    def __init__(
        self,
        num_envs: int,
        *,
        config: EnvConfig | None = None,
        seed: int = 0,
        threads: int = 1,
        curriculum: bool = True,
        device: str = "cpu",
    ) -> None:
        """Build the robots from a seed; arguments as of `H1VectorEnv`, and the device of the tensors to and fro."""
        self.robots = H1VectorEnv(num_envs, config=config, threads=threads, curriculum=curriculum)
        self.num_envs, self.num_actions, self.device = num_envs, self.robots.joints, device
        self.cfg = self.robots.config
        self.max_episode_length = self.cfg.episode_steps
        seen, info = self.robots.reset(seed=seed)
        self._seen = self._observations(seen, info["critic"])

    @property
    # rsl_rl may write to it.
    def episode_length_buf(self) -> torch.Tensor:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Steps since the start of each episode, shape (n,)."""
        return self._env.age.to(self.device)

    @episode_length_buf.setter
    def episode_length_buf(  # pyright: ignore[reportIncompatibleVariableOverride]
        self, steps: torch.Tensor
    ) -> None:
        self._env.age = steps.to(self._env.age)

    @property
    def _env(self) -> Any:  # noqa: ANN401  torch's environment, built by the first reset
        return self.robots.env

    def _observations(self, policy: np.ndarray, privileged: np.ndarray) -> TensorDict:
        groups = {"policy": torch.from_numpy(policy), "privileged": torch.from_numpy(privileged)}
        return TensorDict(groups, [len(policy)]).to(self.device)

    def get_observations(self) -> TensorDict:
        """Return the present observations."""
        return self._seen

    def step(self, actions: torch.Tensor) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict[str, Any]]:
        """Advance all robots by 20 ms; see `H1VectorEnv.step`.

        Args:
            actions: shape (n, joints).

        Returns:
            Observations, rewards (n,), ends of episodes (n,), and what the class says.
        """
        seen, reward, fell, over, info = self.robots.step(actions.detach().cpu().numpy())
        self._seen = self._observations(seen, info["critic"])
        extras: dict[str, Any] = {"time_outs": torch.from_numpy(over).to(self.device)}
        done = fell | over
        if done.any():
            last = np.stack(list(info["final_obs"][done])), np.stack(list(info["final_info"]["critic"][done]))
            extras["final_robots"] = torch.from_numpy(np.flatnonzero(done)).to(self.device)
            extras["final_observations"] = self._observations(*last)
        rewards = torch.from_numpy(reward.astype(np.float32)).to(self.device)
        return self._seen, rewards, torch.from_numpy(done).to(self.device), extras
