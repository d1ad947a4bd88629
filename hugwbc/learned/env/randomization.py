"""Domain randomisation: model parameters and action latency of each robot, pushes, errors of the sensors.

Parameters are friction, masses and their centres, and gains, strength, offset and drive friction of the joints.
"""

import dataclasses
import functools
import zlib

import numpy as np
import torch

from hugwbc.errors import ConfigError
from hugwbc.learned.config import RandomizationConfig
from hugwbc.learned.env.readings import Readings
from hugwbc.sim.batch import RobotBatch
from hugwbc.sim.sensors import ROBOT

_UNCHANGED = (1.0, 1.0)

# Random numbers, on the device of their generator ------------------------------------------------------------------


def rand(generator: torch.Generator, *shape: int) -> torch.Tensor:
    """Draw uniform numbers in [0, 1)."""
    return torch.rand(shape, generator=generator, device=generator.device)


def randn(generator: torch.Generator, *shape: int) -> torch.Tensor:
    """Draw normal numbers."""
    return torch.randn(shape, generator=generator, device=generator.device)


def randint(generator: torch.Generator, high: int, *shape: int) -> torch.Tensor:
    """Draw whole numbers from 0 to high - 1."""
    return torch.randint(high, shape, generator=generator, device=generator.device)


def uniform(
    generator: torch.Generator, count: int, low: float | torch.Tensor, high: float | torch.Tensor
) -> torch.Tensor:
    """Draw uniform numbers between `low` and `high`, shape (count,)."""
    return low + rand(generator, count) * (high - low)


def symmetric(generator: torch.Generator, *shape: int) -> torch.Tensor:
    """Draw uniform numbers in [-1, 1)."""
    return 2.0 * rand(generator, *shape) - 1.0


def restore(generator: torch.Generator, state: torch.Tensor) -> None:
    """Set the state of a generator; a state from another kind of device serves as a seed."""
    if state.shape == generator.get_state().shape:
        generator.set_state(state)
    else:
        generator.manual_seed(zlib.crc32(state.numpy().tobytes()))


# Models ---------------------------------------------------------------------------------------------------------------


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

    Raises:
        ConfigError: if `torso_mass` could take away all mass of the trunk.
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
    trunk = float(model.body_mass[torso])
    if config.torso_mass[0] <= -trunk:
        raise ConfigError(
            f"torso_mass begins at {config.torso_mass[0]:g} kg, and the trunk of {simulation.robot.name} weighs "
            f"{trunk:.2f} kg; begin above {-trunk:.2f} kg"
        )
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

    Returns:
        Which robots were pushed, shape (n,), bool.
    """
    pushed = rand(generator, simulation.count) < 1.0 / config.push_interval
    ids = pushed.nonzero().squeeze(1)
    if ids.numel():
        simulation.qvel[ids, :2] += symmetric(generator, ids.numel(), 2) * config.push_velocity
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
        # Age of the target that acts in each physics step [control steps], shape (substeps, n).
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


class SensorErrors:
    """What sensors add to the true state: white noise, and offsets and biases that stay for an episode.

    They are those of the profile `ROBOT`, times a factor of each robot. Walks of the biases are left out: over an
    episode they are a tenth of the biases. The age of the readings is part of the latency of the actions.

    Attributes:
        scale: factor of each robot, shape (n, 1).
        encoder_offset: error of the joints' zero positions [rad], shape (n, joints).
        gyro_bias: [rad/s], shape (n, 3).
        tilt_bias: error of the attitude about the pelvis's axes [rad], shape (n, 3).
    """

    def __init__(self, count: int, joints: int, scale: tuple[float, float], generator: torch.Generator) -> None:
        """Draw the factors of the robots; offsets and biases are zero until `reset`."""
        self._generator = generator
        low, high = scale
        self.active = high > 0.0
        zeros = functools.partial(torch.zeros, count, device=generator.device)
        self.scale = low + (high - low) * rand(generator, count, 1) if self.active else zeros(1)
        self.encoder_offset, self.gyro_bias, self.tilt_bias = zeros(joints), zeros(3), zeros(3)

    def reset(self, robots: torch.Tensor) -> None:
        """Draw the offsets and biases of a new episode for robots (indices)."""
        if not self.active:
            return
        p, scale, count = ROBOT, self.scale[robots], robots.numel()
        self.encoder_offset[robots] = scale * self._normal(p.encoder_offset, count, self.encoder_offset.shape[1])
        self.gyro_bias[robots] = scale * self._normal(p.gyro_bias, count, 3)
        self.tilt_bias[robots] = scale * self._normal(p.attitude_bias, count, 3)

    def sensed(self, readings: Readings) -> Readings:
        """Return the readings with sensor errors in q, dq, angular velocity and gravity, which a policy observes."""
        if not self.active:
            return readings
        p, scale = ROBOT, self.scale
        count, joints = readings.q.shape
        tilt = self.tilt_bias + scale * self._normal(p.attitude, count, 3)
        gravity = readings.gravity + torch.linalg.cross(tilt, readings.gravity)
        return dataclasses.replace(
            readings,
            q=readings.q + self.encoder_offset + scale * self._normal(p.encoder, count, joints),
            dq=readings.dq + scale * self._normal(p.joint_velocity, count, joints),
            angular_velocity=readings.angular_velocity + self.gyro_bias + scale * self._normal(p.gyro, count, 3),
            gravity=torch.nn.functional.normalize(gravity, dim=1),
        )

    def _normal(self, deviation: float, rows: int, columns: int) -> torch.Tensor:
        return deviation * randn(self._generator, rows, columns)

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Return everything that a resumed run needs; the factors are drawn again from the seed."""
        return {"encoder_offset": self.encoder_offset, "gyro_bias": self.gyro_bias, "tilt_bias": self.tilt_bias}

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore what `state_dict` returned."""
        for name, value in state.items():
            setattr(self, name, value.clone())
