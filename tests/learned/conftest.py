import dataclasses
import importlib.metadata
import sys
import types

import pytest
import torch

from hugwbc.learned.config import EnvConfig
from hugwbc.learned.env.humanoid_env import HumanoidEnv


@pytest.fixture
def small_env() -> HumanoidEnv:
    torch.set_num_threads(1)
    return HumanoidEnv(dataclasses.replace(EnvConfig(), count=8), seed=3, threads=1)


@pytest.fixture
def install(monkeypatch):
    """The function that puts objects into a module and registers them in a group, as an installed package would."""

    def install(module: str, group: str, found: dict[str, object]) -> None:
        made = types.ModuleType(module)
        vars(made).update(found)
        monkeypatch.setitem(sys.modules, module, made)
        entries = [importlib.metadata.EntryPoint(name, f"{module}:{name}", group) for name in found]
        monkeypatch.setattr(importlib.metadata, "entry_points", lambda group: [e for e in entries if e.group == group])

    return install
