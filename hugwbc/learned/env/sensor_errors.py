"""Errors of the sensors in training: the arena's noise, biases and offsets, in tensors for all robots."""

import dataclasses
import functools

import torch

from hugwbc.learned.env.random_numbers import rand, randn
from hugwbc.learned.env.readings import Readings
from hugwbc.sim.sensors import ROBOT


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
        """Draw the factors of the robots; their errors are zero until `reset`.

        Args:
            count: number of robots.
            joints: number of joints.
            scale: smallest and largest factor.
            generator: source of the draws.
        """
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
        """Return the readings with the errors of the sensors in what a policy observes."""
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
