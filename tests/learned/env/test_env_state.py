import dataclasses

import numpy as np
import pytest
import torch

from hugwbc.learned.config import EnvConfig
from hugwbc.learned.env.humanoid_env import HumanoidEnv


def run(env: HumanoidEnv, steps: int, seed: int = 0) -> None:
    generator = torch.Generator().manual_seed(seed)
    for _ in range(steps):
        env.step(0.3 * torch.randn((env.count, 19), generator=generator))


def test_restored_run_continues_bit_for_bit() -> None:
    config = dataclasses.replace(EnvConfig(), count=8)
    straight = HumanoidEnv(config, seed=5, threads=1)
    run(straight, 20, seed=1)
    state = {name: value.clone() for name, value in straight.state_dict().items()}
    resumed = HumanoidEnv(config, seed=5, threads=1)
    resumed.load_state_dict(state)
    for env in (straight, resumed):
        run(env, 20, seed=2)
    assert np.array_equal(straight.simulation.qpos, resumed.simulation.qpos)
    assert torch.equal(straight.observe().critic, resumed.observe().critic)


def test_a_state_that_lacks_a_part_is_told(small_env: HumanoidEnv) -> None:
    state = small_env.state_dict()
    del state["history"]
    with pytest.raises(KeyError, match="history"):
        small_env.load_state_dict(state)
