"""Training on a GPU, where there is none."""

import pytest
import torch

from hugwbc.errors import ConfigError
from hugwbc.learned.config import EnvConfig, TrainConfig
from hugwbc.learned.rl.trainer import Trainer


def test_training_without_a_gpu_says_what_is_missing() -> None:
    if torch.cuda.is_available():
        pytest.skip("there is a GPU")
    with pytest.raises(ConfigError, match="--device cpu"):
        Trainer(TrainConfig(device="cuda", env=EnvConfig(count=2)))
