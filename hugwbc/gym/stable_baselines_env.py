"""The robots of `hugwbc/H1-v0` for the learners of stable-baselines3 (extra `[sb3]`)."""

from collections.abc import Iterable, Sequence
from typing import Any

import gymnasium
import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from hugwbc.gym.h1_env import H1VectorEnv
from hugwbc.learned.config import EnvConfig

LARGEST_ACTION = 4.0  # 1 rad of joint target; learners of bounded spaces start with a std of 1


class H1StableBaselinesEnv(VecEnv):
    """Many H1s as stable-baselines3's `VecEnv`; robots whose episode has ended begin the next one in the same step.

    `infos` has "critic" for each robot, and where an episode has ended "terminal_observation", "critic_at_the_end",
    "TimeLimit.truncated" and "reason". `VecMonitor` of stable-baselines3 adds return and length of the episodes.

    Attributes:
        robots: the environment within.
    """

    def __init__(
        self,
        num_envs: int,
        *,
        config: EnvConfig | None = None,
        seed: int = 0,
        threads: int = 1,
        curriculum: bool = True,
    ) -> None:
        """Set up the robots, which `reset` builds from a seed; other arguments as of `H1VectorEnv`."""
        self.robots = H1VectorEnv(num_envs, config=config, threads=threads, curriculum=curriculum)
        space = self.robots.single_action_space
        actions = gymnasium.spaces.Box(-LARGEST_ACTION, LARGEST_ACTION, space.shape, np.float32)
        super().__init__(num_envs, self.robots.single_observation_space, actions)
        self._seed: int | None = seed
        self._actions = np.zeros((num_envs, *actions.shape), dtype=np.float32)

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Let the next `reset` build the robots from a seed; None keeps the present one."""
        self._seed = self._seed if seed is None else seed
        return [seed] * self.num_envs

    def reset(self) -> np.ndarray:
        """Begin an episode of every robot; return the observations, shape (n, 333)."""
        seen, info = self.robots.reset(seed=self._seed)
        self._seed = None  # the robots stay the same at the next reset
        self.reset_infos = [{"critic": row} for row in info["critic"]]
        return seen

    def step_async(self, actions: np.ndarray) -> None:
        """Take the actions, shape (n, joints), of the next step."""
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Advance all robots by 20 ms; see `H1VectorEnv.step`.

        Returns:
            Observations (n, 333), rewards (n,), ends of episodes (n,), and what the class says of each robot.
        """
        seen, reward, fell, over, info = self.robots.step(self._actions)
        done = fell | over
        infos: list[dict[str, Any]] = [{"critic": row} for row in info["critic"]]
        for robot in np.flatnonzero(done):
            infos[robot] |= {
                "terminal_observation": info["final_obs"][robot],
                "TimeLimit.truncated": bool(over[robot]),
                "reason": info["final_info"]["reason"][robot],
                "critic_at_the_end": info["final_info"]["critic"][robot],
            }
        return seen, reward.astype(np.float32), done, infos

    def close(self) -> None:
        """Let go of the robots."""
        self.robots.close()

    def get_attr(self, attr_name: str, indices: int | Iterable[int] | None = None) -> list[Any]:
        """Return an attribute of the environment within, once for each robot."""
        return [getattr(self.robots, attr_name)] * len(self._indices(indices))

    def set_attr(self, attr_name: str, value: Any, indices: int | Iterable[int] | None = None) -> None:  # noqa: ANN401
        """Refuse to change one robot's attribute: all robots are one environment."""
        raise AttributeError(f"{attr_name} cannot be set: all robots are one environment; give it a config instead")

    def env_method(
        self,
        method_name: str,
        *method_args: Any,  # noqa: ANN401
        indices: int | Iterable[int] | None = None,
        **method_kwargs: Any,  # noqa: ANN401
    ) -> list[Any]:
        """Call a method of the environment within, once; return its result for each robot."""
        result = getattr(self.robots, method_name)(*method_args, **method_kwargs)
        return [result] * len(self._indices(indices))

    def env_is_wrapped(
        self, wrapper_class: type[gymnasium.Wrapper[Any, Any, Any, Any]], indices: int | Iterable[int] | None = None
    ) -> list[bool]:
        """Return False for each robot: none has a wrapper of its own."""
        return [False] * len(self._indices(indices))

    def _indices(self, indices: int | Iterable[int] | None) -> list[int]:
        return [int(index) for index in self._get_indices(indices)]
