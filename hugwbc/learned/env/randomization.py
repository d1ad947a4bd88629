"""Per-robot model parameters, drawn once: friction, masses and their centres, joint gains, strength, offset; pushes."""

import numpy as np
import torch

from hugwbc.learned.config import RandomizationConfig
from hugwbc.sim.batch import BatchSimulation

_UNCHANGED = (1.0, 1.0)


def randomize(
    simulation: BatchSimulation,
    config: RandomizationConfig,
    rng: np.random.Generator,
    damping_factor: np.ndarray | float = 1.0,
) -> np.ndarray:
    """Draw the parameters of every robot of a batch.

    Args:
        simulation: the batch; its model fields become per-robot.
        config: the ranges.
        rng: of the draws.
        damping_factor: of each joint's PD, before the draws, shape (19,).

    Returns:
        Friction coefficient of each robot, shape (count,).
    """
    batch, model, count = simulation.batch, simulation.model, simulation.count
    floor = model.geom("floor").id
    own = np.arange(model.ngeom) != floor
    friction = rng.uniform(*config.friction, count)
    sliding = batch.expand("geom_friction")[:, :, 0]
    sliding[:, own] = friction[:, None]
    # MuJoCo takes the larger of two coefficients: the floor's must not exceed the robot's.
    sliding[:, floor] = np.minimum(sliding[:, floor], friction)
    torso = model.body("torso_link").id
    batch.expand("body_mass")[:, torso] += rng.uniform(*config.torso_mass, count)
    batch.expand("body_ipos")[:, torso] += rng.uniform(-config.torso_centre, config.torso_centre, (count, 3))
    stiffness = rng.uniform(*config.gains, (count, model.nu))
    damping = damping_factor * rng.uniform(*config.gains, (count, model.nu))
    _scale_actuators(simulation, stiffness, damping)
    # What is off by default is drawn last, so that it changes nothing else's draw.
    _randomize_links(simulation, config, rng)
    _randomize_motors(simulation, config, rng)
    batch.set_const()
    return friction


def _scale_actuators(simulation: BatchSimulation, stiffness: np.ndarray, damping: np.ndarray) -> None:
    """Multiply the PD law tau = kp (target - q) - kd dq, factors of shape (count, 19)."""
    simulation.batch.expand("actuator_gainprm")[:, :, 0] *= stiffness
    bias = simulation.batch.expand("actuator_biasprm")
    bias[:, :, 1] *= stiffness
    bias[:, :, 2] *= damping


def _randomize_links(simulation: BatchSimulation, config: RandomizationConfig, rng: np.random.Generator) -> None:
    batch, shape = simulation.batch, (simulation.count, simulation.model.nbody)
    if config.link_mass != _UNCHANGED:
        factor = rng.uniform(*config.link_mass, shape)
        batch.expand("body_mass")[:] *= factor
        batch.expand("body_inertia")[:] *= factor[..., None]
    if config.link_centre > 0.0:
        shift = rng.uniform(-config.link_centre, config.link_centre, (*shape, 3))
        batch.expand("body_ipos")[:, 1:] += shift[:, 1:]  # the world has no mass


def _randomize_motors(simulation: BatchSimulation, config: RandomizationConfig, rng: np.random.Generator) -> None:
    shape = (simulation.count, simulation.model.nu)
    if config.strength != _UNCHANGED:
        factor = rng.uniform(*config.strength, shape)
        _scale_actuators(simulation, factor, factor)
    if config.offset > 0.0:
        stiffness = simulation.batch.expand("actuator_gainprm")[:, :, 0]
        bias = simulation.batch.expand("actuator_biasprm")
        bias[:, :, 0] += stiffness * rng.uniform(-config.offset, config.offset, shape)


def push(simulation: BatchSimulation, config: RandomizationConfig, generator: torch.Generator) -> None:
    """Change the horizontal velocity of the pelvis of some robots, before a control step.

    Args:
        simulation: the batch.
        config: how often and how much.
        generator: of the draws.
    """
    pushed = torch.rand(simulation.count, generator=generator) < 1.0 / config.push_interval
    ids = pushed.nonzero().squeeze(1)
    if ids.numel():
        kick = (2.0 * torch.rand((ids.numel(), 2), generator=generator) - 1.0) * config.push_velocity
        simulation.qvel[ids.numpy(), :2] += kick.numpy()
