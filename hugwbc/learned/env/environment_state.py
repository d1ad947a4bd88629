"""The state of a training environment: everything that a bit-exact continuation of a run needs."""

import dataclasses
from typing import Any

import torch

from hugwbc.learned.env.randomization import restore as restore_generator
from hugwbc.learned.env.readings import read

# Tensors of the environment, parts with a state of their own, and arrays of the simulation.
_STATE_TENSORS = ("command", "gait", "phase", "age", "actions", "history", "waist", "posture", "bias")
_STATE_PARTS = ("intervention", "sensors", "loads", "statistics")
_STATE_SIMULATION = ("qpos", "qvel", "ctrl", "warm_start")


Environment = Any  # a `HumanoidEnv`, whose module imports this one


def state_of(env: Environment) -> dict[str, torch.Tensor]:
    """Return everything that a bit-exact continuation needs; some of the tensors are the environment's own."""
    state = {name: getattr(env, name) for name in _STATE_TENSORS}
    state |= {name: getattr(env.simulation, name).clone() for name in _STATE_SIMULATION}
    # Forces belong to the last physics step; position and velocity alone do not give them back.
    state["foot_force"], state["link_force"] = env.readings.foot_force, env.readings.link_force
    state["generator"] = env.generator.get_state()
    for name in _STATE_PARTS:
        state |= {f"{name}.{k}": v for k, v in getattr(env, name).state_dict().items()}
    if env.latency is not None:
        state["targets"] = env.latency.targets
    if env.ground is not None:
        state |= {f"terrain.{k}": v for k, v in env.ground.state_dict().items()}
        state["terrain.footing"] = env.simulation.footing
    levels = env.curriculum.state_dict()
    return state | {f"curriculum.{k}": torch.tensor(v, dtype=torch.float64) for k, v in levels.items()}


def restore(env: Environment, state: dict[str, torch.Tensor]) -> None:
    """Restore what `state_of` returned.

    Args:
        env: the environment, newly built with the settings of the run.
        state: of a run with as many robots. Where its settings of latency, ground or intervention differ from those of
            the environment, the part in question starts afresh.

    Raises:
        KeyError: if a part is missing.
    """
    restore_generator(env.generator, state["generator"])
    state = {name: value.to(env.simulation.device) for name, value in state.items()}
    for name in _STATE_TENSORS:
        setattr(env, name, state[name].clone())
    prefixed: dict[str, dict[str, torch.Tensor]] = {name: {} for name in ("curriculum", "terrain", *_STATE_PARTS)}
    for key, value in state.items():
        group, _, name = key.partition(".")
        if name:
            prefixed[group][name] = value
    env.restore_levels({name: value.tolist() for name, value in prefixed["curriculum"].items()})
    for name in _STATE_PARTS:
        getattr(env, name).load_state_dict(prefixed[name])
    env.arm_gains.update(env.intervention.active * env.curriculum.alpha)
    # Write twice: `forward` needs the state, and changes the solver's warm start, which must be the stored one.
    _write_simulation(env, state)
    env.simulation.forward(torch.arange(env.count, device=env.simulation.device))
    if "footing" in prefixed["terrain"]:
        env.simulation.restore_footing(prefixed["terrain"]["footing"])
    _write_simulation(env, state)
    forces = {name: state[name].clone() for name in ("foot_force", "link_force")}
    if env.latency is not None:
        # If the stored run had another latency or none, pretend that the current target has acted for ever.
        targets, kept = env.latency.targets, state.get("targets")
        targets[:] = kept if kept is not None and kept.shape == targets.shape else env.simulation.ctrl
    if env.ground is not None:
        env.ground.load_state_dict(prefixed["terrain"])
    env.readings = dataclasses.replace(read(env.simulation, env.ground), **forces)
    if env.ground is not None:
        env.begin_episodes(env.ground.lost(env.readings.position[:, :2]).nonzero().squeeze(1))


def _write_simulation(env: Environment, state: dict[str, torch.Tensor]) -> None:
    for name in _STATE_SIMULATION:
        getattr(env.simulation, name)[:] = state[name]
