"""The training environment on both physics backends: mujoco.batch, and mujoco_warp on warp's CPU device."""

import dataclasses
from typing import Any

import pytest
import torch

from hugwbc.errors import ConfigError
from hugwbc.learned.config import EnvConfig, TrainConfig
from hugwbc.learned.env import humanoid_env as env_module
from hugwbc.learned.env.humanoid_env import HumanoidEnv
from hugwbc.learned.rl.trainer import Trainer

COUNT = 4


@pytest.mark.slow
def test_the_environment_is_the_same_on_both_backends(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mujoco_warp")
    from hugwbc.sim.warp_batch import WarpSimulation

    def on_warp(device: str, count: int, *, threads: int, **others: Any) -> WarpSimulation:
        return WarpSimulation(count, device="cpu", **others)

    config = EnvConfig(count=COUNT, drives="ideal")  # a GPU has no torque-speed limit
    cpu = HumanoidEnv(config, seed=5, threads=1)
    monkeypatch.setattr(env_module, "robots_on", on_warp)
    warp = HumanoidEnv(config, seed=5, threads=1)
    assert isinstance(warp.simulation, WarpSimulation)
    generator = torch.Generator().manual_seed(0)
    for step in range(12):
        action = 0.3 * torch.randn(COUNT, 19, generator=generator)
        if step == 6:
            # One robot comes to its end in both: its reset must leave the others alone.
            cpu.age[2] = warp.age[2] = cpu.config.episode_steps
        a, b = cpu.step(action), warp.step(action)
        torch.testing.assert_close(b.done, a.done)
        torch.testing.assert_close(b.reward, a.reward, atol=1e-3, rtol=0)
        for field in dataclasses.fields(cpu.observe()):
            x, y = (getattr(env.observe(), field.name) for env in (cpu, warp))
            torch.testing.assert_close(y, x, atol=5e-3, rtol=0, msg=lambda m, f=field.name: f"{f}: {m}")


def test_training_without_a_gpu_says_what_is_missing() -> None:
    if torch.cuda.is_available():
        pytest.skip("there is a GPU")
    with pytest.raises(ConfigError, match="--device cpu"):
        Trainer(TrainConfig(device="cuda", env=EnvConfig(count=2)))
