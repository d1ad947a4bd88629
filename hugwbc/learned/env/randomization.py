"""Domain randomisation: per-robot model parameters and action latency, drawn once, and pushes.

Parameters are friction, masses and their centres, gains, strength and offset of the joints.
"""

import numpy as np
import torch

from hugwbc.learned.config import RandomizationConfig
from hugwbc.learned.env.random_numbers import rand
from hugwbc.sim.batch import RobotBatch

_UNCHANGED = (1.0, 1.0)


def randomize(
    simulation: RobotBatch,
    config: RandomizationConfig,
    rng: np.random.Generator,
    damping_factor: np.ndarray | float = 1.0,
) -> np.ndarray:
    """Draw the model parameters of every robot of a batch.

    Args:
        simulation: the batch; its model fields become per-robot.
        config: the ranges.
        rng: source of the draws.
        damping_factor: factor on the damping of each joint's PD before the draws, shape (joints,).

    Returns:
        Friction coefficient of each robot, shape (count,).
    """
    model, count, put = simulation.model, simulation.count, simulation.tensor
    floor = model.geom("floor").id
    friction = rng.uniform(*config.friction, count)
    sliding = simulation.expand("geom_friction")[:, :, 0]
    # A contact has the larger of its two coefficients: a floor of 1 would hide every robot below it.
    lowered = torch.minimum(sliding[:, floor], put(friction))
    sliding[:] = put(friction)[:, None]
    sliding[:, floor] = lowered
    torso = model.body(simulation.robot.trunk).id
    simulation.expand("body_mass")[:, torso] += put(rng.uniform(*config.torso_mass, count))
    shift = rng.uniform(-config.torso_centre, config.torso_centre, (count, 3))
    simulation.expand("body_ipos")[:, torso] += put(shift)
    stiffness = rng.uniform(*config.gains, (count, model.nu))
    damping = damping_factor * rng.uniform(*config.gains, (count, model.nu))
    _scale_actuators(simulation, stiffness, damping)
    # Draw last what can be switched off: all other draws then stay as they are.
    _randomize_links(simulation, config, rng)
    _randomize_motors(simulation, config, rng)
    _randomize_drives(simulation, config, rng)
    for function in config.functions:
        function(simulation, rng)
    simulation.set_const()
    return friction


def _scale_actuators(simulation: RobotBatch, stiffness: np.ndarray, damping: np.ndarray) -> None:
    """Scale kp and kd of the PD law tau = kp (target - q) - kd dq by factors of shape (count, joints)."""
    simulation.expand("actuator_gainprm")[:, :, 0] *= simulation.tensor(stiffness)
    bias = simulation.expand("actuator_biasprm")
    bias[:, :, 1] *= simulation.tensor(stiffness)
    bias[:, :, 2] *= simulation.tensor(damping)


def _randomize_links(simulation: RobotBatch, config: RandomizationConfig, rng: np.random.Generator) -> None:
    count, bodies = simulation.count, simulation.model.nbody
    for spread, shape in ((config.mass, (count, 1)), (config.link_mass, (count, bodies))):
        if spread != _UNCHANGED:
            factor = simulation.tensor(rng.uniform(*spread, shape))
            simulation.expand("body_mass")[:] *= factor
            simulation.expand("body_inertia")[:] *= factor[..., None]
    if config.link_centre > 0.0:
        shift = rng.uniform(-config.link_centre, config.link_centre, (count, bodies, 3))
        simulation.expand("body_ipos")[:, 1:] += simulation.tensor(shift)[:, 1:]  # the world has no mass


def _randomize_motors(simulation: RobotBatch, config: RandomizationConfig, rng: np.random.Generator) -> None:
    shape = (simulation.count, simulation.model.nu)
    if config.strength != _UNCHANGED:
        factor = rng.uniform(*config.strength, shape)
        _scale_actuators(simulation, factor, factor)
    if config.offset > 0.0:
        stiffness = simulation.expand("actuator_gainprm")[:, :, 0]
        bias = simulation.expand("actuator_biasprm")
        # tau = kp (target + offset - q) - kd dq: an offset of the target is a constant torque of kp offset.
        bias[:, :, 0] += stiffness * simulation.tensor(rng.uniform(-config.offset, config.offset, shape))


def _randomize_drives(simulation: RobotBatch, config: RandomizationConfig, rng: np.random.Generator) -> None:
    """Scale the Coulomb and viscous friction of every drive, if the drives have friction."""
    columns = simulation.layout.qvel
    friction = simulation.model.dof_frictionloss[columns][6:]
    if config.drive_friction != _UNCHANGED and friction.any():
        factor = simulation.tensor(rng.uniform(*config.drive_friction, (simulation.count, friction.size)))
        for name in ("dof_frictionloss", "dof_damping"):
            simulation.expand(name)[:, columns][:, 6:] *= factor


def push(simulation: RobotBatch, config: RandomizationConfig, generator: torch.Generator) -> torch.Tensor:
    """Change the horizontal velocity of the pelvis of random robots before a control step.

    Returns which robots were pushed, shape (n,), bool.

    Args:
        simulation: the batch.
        config: frequency and size of the pushes.
        generator: source of the draws.
    """
    pushed = rand(generator, simulation.count) < 1.0 / config.push_interval
    ids = pushed.nonzero().squeeze(1)
    if ids.numel():
        simulation.qvel[ids, :2] += (2.0 * rand(generator, ids.numel(), 2) - 1.0) * config.push_velocity
    return pushed & (config.push_velocity > 0.0)


class Latency:
    """Action latency: joint targets take effect some physics steps later, with a delay per robot.

    Attributes:
        targets: last joint targets, newest first [rad], shape (control steps kept, n, joints).
    """

    def __init__(self, delay: np.ndarray, substeps: int, simulation: RobotBatch) -> None:
        """Start without targets; call `reset` before the first step.

        Args:
            delay: delay of each robot [physics steps], shape (n,).
            substeps: physics steps in a control step.
            simulation: the robots.
        """
        # How many control steps ago the target was given that acts in each physics step, shape (substeps, n).
        age = np.maximum(-((np.arange(substeps)[:, None] - delay) // substeps), 0)
        self._simulation, self._age = simulation, torch.as_tensor(age, device=simulation.device)
        self._robots = torch.arange(len(delay), device=simulation.device)
        self.targets = simulation.ctrl.new_zeros(1 + int(age.max()), *simulation.ctrl.shape)

    def reset(self, robots: torch.Tensor, target: torch.Tensor) -> None:
        """Fill the past of robots (indices) with one target [rad], shape (k, joints)."""
        self.targets[:, robots] = target.to(self.targets)

    def step(self) -> torch.Tensor:
        """Advance the physics by a control step; `ctrl` holds the newest target.

        Returns:
            Whether each robot diverged, shape (n,), bool.
        """
        simulation = self._simulation
        self.targets = torch.cat((simulation.ctrl[None], self.targets[:-1]))
        diverged = simulation.step(len(self._age), self.targets[self._age, self._robots])
        simulation.ctrl[:] = self.targets[0]
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
