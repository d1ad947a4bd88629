"""What a checkpoint holds of a training environment, so that a resumed run goes on bit for bit."""

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
import torch

from hugwbc.learned.env.action_latency import Latency
from hugwbc.learned.env.readings import read

if TYPE_CHECKING:
    from hugwbc.learned.env.humanoid_env import HumanoidEnv
    from hugwbc.sim.batch import BatchSimulation

_TENSORS = ("command", "gait", "phase", "age", "actions", "history", "waist")
_GROUPS = ("intervention", "curriculum", "terrain", "held_foot")
_SIMULATION = ("qpos", "qvel", "ctrl", "warm_start")


def state_of(env: "HumanoidEnv") -> dict[str, torch.Tensor]:
    """Everything that a resumed run needs, as tensors; some of them are the environment's own."""
    state = {name: getattr(env, name) for name in _TENSORS}
    state["tracking"] = env.statistics.tracking
    state |= {name: torch.from_numpy(getattr(env.simulation, name).copy()) for name in _SIMULATION}
    # Forces belong to the last physics step; they cannot be had again from the state alone.
    state["foot_force"], state["link_force"] = env.readings.foot_force, env.readings.link_force
    state["generator"] = env.generator.get_state()
    state |= {f"intervention.{k}": v for k, v in env.intervention.state_dict().items()}
    if env.latency is not None:
        state["targets"] = env.latency.targets
    if env.held_foot is not None:
        state |= {f"held_foot.{k}": v for k, v in env.held_foot.state_dict().items()}
    if env.ground is not None:
        state |= {f"terrain.{k}": v for k, v in env.ground.state_dict().items()}
        state["terrain.footing"] = torch.from_numpy(env.simulation.footing)
    levels = env.curriculum.state_dict()
    return state | {f"curriculum.{k}": torch.tensor(v, dtype=torch.float64) for k, v in levels.items()}


def restore(env: "HumanoidEnv", state: dict[str, torch.Tensor]) -> None:
    """Put back what `state_of` gave.

    Args:
        env: with as many robots.
        state: of a run with the same settings, or with others of latency, ground or intervention: what does not fit
            them starts anew.

    Raises:
        KeyError: if a part is missing.
    """
    for name in _TENSORS:
        setattr(env, name, state[name].clone())
    env.statistics.tracking = state["tracking"].clone()
    env.generator.set_state(state["generator"])
    prefixed: dict[str, dict[str, torch.Tensor]] = {name: {} for name in _GROUPS}
    for key, value in state.items():
        group, _, name = key.partition(".")
        if name:
            prefixed[group][name] = value
    env.intervention.load_state_dict(prefixed["intervention"])
    env.curriculum.load_state_dict({name: value.tolist() for name, value in prefixed["curriculum"].items()})
    # Twice: the first write gives `forward` its state, the second undoes its change of the warm start.
    _write(env.simulation, state)
    env.simulation.forward(np.arange(env.count))
    if "footing" in prefixed["terrain"]:
        env.simulation.restore_footing(prefixed["terrain"]["footing"].numpy())
    _write(env.simulation, state)
    forces = {name: state[name].clone() for name in ("foot_force", "link_force")}
    if env.latency is not None:
        _restore_latency(env.latency, state.get("targets"), env.simulation.ctrl)
    if env.held_foot is not None and prefixed["held_foot"]:
        env.held_foot.load_state_dict(prefixed["held_foot"])
    if env.ground is not None:
        env.ground.load_state_dict(prefixed["terrain"])
    env.readings = dataclasses.replace(read(env.simulation, env.ground), **forces)
    if env.ground is not None:
        env.begin_episodes(env.ground.lost(env.readings.position[:, :2]).nonzero().squeeze(1))


def _restore_latency(latency: Latency, targets: torch.Tensor | None, ctrl: np.ndarray) -> None:
    if targets is not None and targets.shape == latency.targets.shape:
        latency.targets = targets.clone()
    else:  # a run without latency, or with another
        latency.reset(np.arange(len(ctrl)), ctrl.copy())


def _write(simulation: "BatchSimulation", state: dict[str, torch.Tensor]) -> None:
    for name in _SIMULATION:
        getattr(simulation, name)[:] = state[name].numpy()
