"""How the episodes of a training environment start in recorded motion, and how that is recorded."""

from typing import TYPE_CHECKING

import torch

from hugwbc.learned.env.starts import COLUMNS

if TYPE_CHECKING:
    from hugwbc.learned.env.humanoid_env import HumanoidEnv

_OF_ENV = ("command", "gait", "phase", "history", "waist")
_OF_SIMULATION = ("qpos", "qvel")


def start_in_motion(env: "HumanoidEnv", robots: torch.Tensor) -> torch.Tensor:
    """Let some of the robots that have just been set up standing start in recorded motion of their gait instead.

    They start where they stand, under the command and with the history of the record.

    Args:
        env: with the record.
        robots: indices, shape (k,).

    Returns:
        Indices of the robots that do; none without a record.
    """
    if env.starts is None:
        return robots[:0]
    having, state = env.starts.draw(env.gait[robots], env.config.starts_share, env.generator)
    moving = robots[having]
    if not moving.numel():
        return moving
    for name in _OF_ENV:
        getattr(env, name)[moving] = state[name]
    env.actions[:, moving] = state["actions"].transpose(0, 1)
    ids, simulation = moving.numpy(), env.simulation
    qpos = state["qpos"].numpy().copy()
    qpos[:, :2] = simulation.qpos[ids, :2]
    if env.ground is not None:  # recorded on a plane
        qpos[:, 2] += simulation.qpos[ids, 2] - env.nominal_qpos[2]
    simulation.qpos[ids], simulation.qvel[ids] = qpos, state["qvel"].numpy()
    target = env.body.nominal + env.action_scale * env.actions[0, moving]
    target[:, env.body.waist] += env.waist[moving]
    simulation.ctrl[ids] = target.numpy()
    if env.latency is not None:
        env.latency.reset(ids, target.numpy())
    simulation.forward(ids)
    if env.held_foot is not None:
        env.held_foot.restart(moving, env.age[moving], hopping=True)
    return moving


def recorded(env: "HumanoidEnv", robots: torch.Tensor) -> dict[str, torch.Tensor]:
    """The present state of some robots (indices), as `hugwbc.learned.env.starts.COLUMNS` has it."""
    columns = {name: getattr(env, name)[robots] for name in _OF_ENV}
    columns["actions"] = env.actions[:, robots].transpose(0, 1)
    columns |= {name: torch.from_numpy(getattr(env.simulation, name)[robots.numpy()]) for name in _OF_SIMULATION}
    return {name: columns[name] for name in COLUMNS}
