"""Domain randomisation: per-robot model parameters and action latency, drawn once, and pushes.

Parameters are friction, masses and their centres, gains, strength and offset of the joints.
"""

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
    """Draw the model parameters of every robot of a batch.

    Args:
        simulation: the batch; its model fields become per-robot.
        config: the ranges.
        rng: source of the draws.
        damping_factor: factor on the damping of each joint's PD before the draws, shape (19,).

    Returns:
        Friction coefficient of each robot, shape (count,).
    """
    batch, model, count = simulation.batch, simulation.model, simulation.count
    floor = model.geom("floor").id
    bodies = np.arange(model.ngeom) != floor
    friction = rng.uniform(*config.friction, count)
    sliding = batch.expand("geom_friction")[:, :, 0]
    sliding[:, bodies] = friction[:, None]
    # A contact has the larger of its two coefficients: a floor of 1 would hide every robot below it.
    sliding[:, floor] = np.minimum(sliding[:, floor], friction)
    torso = model.body("torso_link").id
    batch.expand("body_mass")[:, torso] += rng.uniform(*config.torso_mass, count)
    batch.expand("body_ipos")[:, torso] += rng.uniform(-config.torso_centre, config.torso_centre, (count, 3))
    stiffness = rng.uniform(*config.gains, (count, model.nu))
    damping = damping_factor * rng.uniform(*config.gains, (count, model.nu))
    _scale_actuators(simulation, stiffness, damping)
    # Draw last what can be switched off: all other draws then stay as they are.
    _randomize_links(simulation, config, rng)
    _randomize_motors(simulation, config, rng)
    _randomize_drives(simulation, config, rng)
    for function in config.functions:
        function(simulation, rng)
    batch.set_const()
    return friction


def _scale_actuators(simulation: BatchSimulation, stiffness: np.ndarray, damping: np.ndarray) -> None:
    """Scale kp and kd of the PD law tau = kp (target - q) - kd dq by factors of shape (count, 19)."""
    simulation.batch.expand("actuator_gainprm")[:, :, 0] *= stiffness
    bias = simulation.batch.expand("actuator_biasprm")
    bias[:, :, 1] *= stiffness
    bias[:, :, 2] *= damping


def _randomize_links(simulation: BatchSimulation, config: RandomizationConfig, rng: np.random.Generator) -> None:
    batch, shape = simulation.batch, (simulation.count, simulation.model.nbody)
    if config.mass != _UNCHANGED:
        factor = rng.uniform(*config.mass, simulation.count)
        batch.expand("body_mass")[:] *= factor[:, None]
        batch.expand("body_inertia")[:] *= factor[:, None, None]
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
        # tau = kp (target + offset - q) - kd dq: an offset of the target is a constant torque of kp offset.
        bias[:, :, 0] += stiffness * rng.uniform(-config.offset, config.offset, shape)


def _randomize_drives(simulation: BatchSimulation, config: RandomizationConfig, rng: np.random.Generator) -> None:
    """Scale the Coulomb and viscous friction of every drive, if the drives have friction."""
    columns = simulation.layout.qvel
    friction = simulation.model.dof_frictionloss[columns][6:]
    if config.drive_friction != _UNCHANGED and friction.any():
        factor = rng.uniform(*config.drive_friction, (simulation.count, friction.size))
        for name in ("dof_frictionloss", "dof_damping"):
            simulation.batch.expand(name)[:, columns][:, 6:] *= factor


def push(simulation: BatchSimulation, config: RandomizationConfig, generator: torch.Generator) -> torch.Tensor:
    """Change the horizontal velocity of the pelvis of random robots before a control step.

    Returns which robots were pushed, shape (n,), bool.

    Args:
        simulation: the batch.
        config: frequency and size of the pushes.
        generator: source of the draws.
    """
    pushed = torch.rand(simulation.count, generator=generator) < 1.0 / config.push_interval
    ids = pushed.nonzero().squeeze(1)
    if ids.numel():
        kick = (2.0 * torch.rand((ids.numel(), 2), generator=generator) - 1.0) * config.push_velocity
        simulation.qvel[ids.numpy(), :2] += kick.numpy()
    return pushed & (config.push_velocity > 0.0)


class Latency:
    """Action latency: joint targets take effect some physics steps later, with a delay per robot.

    Attributes:
        delay: delay of each robot [physics steps], shape (n,).
        targets: last joint targets, newest first [rad], shape (control steps kept, n, 19).
    """

    def __init__(self, delay: np.ndarray, substeps: int, joints: int) -> None:
        """Start without targets; call `reset` before the first step.

        Args:
            delay: delay of each robot [physics steps], shape (n,).
            substeps: physics steps in a control step.
            joints: number of joints.
        """
        self.delay = delay
        self._substeps = substeps
        self._robots = np.arange(len(delay))
        kept = 1 + int(self._age(0).max())
        self.targets = torch.zeros(kept, len(delay), joints, dtype=torch.float64)

    def _age(self, substep: int) -> np.ndarray:
        """Return how many control steps ago the target was given that acts in this physics step, shape (n,)."""
        return np.maximum(-((substep - self.delay) // self._substeps), 0)

    def reset(self, robots: np.ndarray, target: np.ndarray) -> None:
        """Fill the past of robots (indices) with one target [rad], shape (k, 19)."""
        self.targets[:, robots] = torch.from_numpy(target).to(self.targets.dtype)

    def step(self, simulation: BatchSimulation) -> np.ndarray:
        """Advance the physics by a control step; `simulation.ctrl` holds the newest target.

        Returns:
            Whether each robot diverged, shape (n,), bool.
        """
        newest = torch.from_numpy(simulation.ctrl.copy())
        self.targets = torch.cat((newest[None], self.targets[:-1]))
        targets = self.targets.numpy()
        acting = [targets[self._age(substep), self._robots] for substep in range(self._substeps)]
        diverged = simulation.step(self._substeps, np.stack(acting))
        simulation.ctrl[:] = targets[0]
        return diverged


def draw_delays(
    count: int, latency: tuple[float, float], timestep: float, rng: np.random.Generator
) -> np.ndarray | None:
    """Draw the delays of robots in whole physics steps, shape (count,); None if latency is off.

    Args:
        count: number of robots.
        latency: shortest and longest delay [s].
        timestep: time step of the physics [s].
        rng: source of the draws.
    """
    if latency[1] == 0.0:
        return None
    return np.round(rng.uniform(*latency, count) / timestep).astype(int)
