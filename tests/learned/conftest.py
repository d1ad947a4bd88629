import dataclasses

import pytest
import torch

from hugwbc.learned.config import EnvConfig
from hugwbc.learned.env.humanoid_env import HumanoidEnv


@pytest.fixture
def small_env() -> HumanoidEnv:
    torch.set_num_threads(1)
    return HumanoidEnv(dataclasses.replace(EnvConfig(), count=8), seed=3, threads=1)
