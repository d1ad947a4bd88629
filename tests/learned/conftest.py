import dataclasses
from collections.abc import Iterator

import pytest
import torch

from hugwbc.learned.config import EnvConfig
from hugwbc.learned.env.humanoid_env import HumanoidEnv


@pytest.fixture(autouse=True)
def same_torch() -> Iterator[None]:
    """Give each test the same random numbers, whichever ran before, and one thread."""
    before = torch.get_num_threads()
    torch.manual_seed(0)
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture
def small_env() -> HumanoidEnv:
    return HumanoidEnv(dataclasses.replace(EnvConfig(), count=8), seed=3, threads=1)
