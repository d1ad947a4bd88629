"""Settings of the training robots: differences from their description, loads, and gains of moved arms."""

import math
from collections.abc import Callable
from typing import Annotated

import numpy as np
import tyro

from hugwbc.learned.config.checks import require, require_finite
from hugwbc.robot import Robot
from hugwbc.settings import settings


@settings
class RandomizationConfig:
    """Model parameters of each robot, drawn once, and disturbances. Factors multiply the nominal value."""

    friction: tuple[float, float] = (0.4, 1.5)
    """Sliding friction of the robot's geometry."""
    mass: tuple[float, float] = (0.84, 1.06)
    """Factor on the masses and inertias of all links together. From 59.3 kg it reaches the 51.65 kg of the earlier
    description with room below."""
    torso_mass: tuple[float, float] = (-1.0, 3.0)
    """Mass added to the torso, which has 18 kg [kg]."""
    torso_centre: float = 0.03
    """Half-width of the shift of the torso's centre of mass along each axis [m]."""
    gains: tuple[float, float] = (0.9, 1.1)
    """Factor on the stiffness of each joint and, independently, on its damping."""
    link_mass: tuple[float, float] = (0.9, 1.1)
    """Factor on the mass and inertia of each link by itself (the authors: 0.8 to 1.2)."""
    link_centre: float = 0.01
    """Half-width of the shift of each link's centre of mass along each axis [m] (the authors: 0.01)."""
    strength: tuple[float, float] = (0.9, 1.1)
    """Factor on the torque of each joint before its limit applies (the authors: 0.8 to 1.2)."""
    offset: float = 0.01
    """Half-width of the error of each joint's position target [rad] (the authors: 0.02)."""
    drive_friction: tuple[float, float] = (0.5, 1.5)
    """Factor on the Coulomb and viscous friction of each real drive."""
    latency: tuple[float, float] = (0.0, 0.02)
    """Time from an action to its effect [s], one value per robot, rounded to physics steps. It stands for the age of
    the readings, which is 10 ms in the arena, and for the delay of the drives, which is 2 ms."""
    push_velocity: float = 0.5
    """Half-width of a push, which changes the horizontal velocity of the pelvis [m/s]."""
    push_interval: int = 400
    """Mean number of control steps between two pushes of a robot."""
    noise: float = 0.0
    """Scale of the paper's observation noise; 1 is the paper's (angular velocity 0.2, gravity 0.05, q 0.01, dq 1.5)."""
    sensing: tuple[float, float] = (0.0, 1.5)
    """Factor on the sensor errors of the arena (`hugwbc.sim.sensors.ROBOT`: noise, biases and offsets of encoders,
    joint speeds, gyro and attitude), one value per robot; 0 for the true state."""
    functions: Annotated[tuple[Callable[..., object], ...], tyro.conf.Suppress] = ()
    """Functions that change the models further, given the `BatchSimulation` and a generator of random numbers; for
    settings written in Python."""

    @classmethod
    def off(cls, friction: float = 0.8) -> "RandomizationConfig":
        """Return settings under which all robots are as described, sense their true state and are never pushed.

        Args:
            friction: sliding friction of all robots.
        """
        one = (1.0, 1.0)
        none = (0.0, 0.0)
        return cls(
            friction=(friction, friction),
            mass=one,
            torso_mass=none,
            torso_centre=0.0,
            gains=one,
            link_mass=one,
            link_centre=0.0,
            strength=one,
            offset=0.0,
            drive_friction=one,
            latency=none,
            push_velocity=0.0,
            sensing=none,
        )

    def __post_init__(self) -> None:
        """Check the ranges."""
        may_vanish = ("latency", "drive_friction", "sensing")
        for name in ("friction", "gains", "mass", "link_mass", "strength", *may_vanish):
            low, high = getattr(self, name)
            least = "at least 0" if name in may_vanish else "above 0"
            valid = low >= 0.0 if name in may_vanish else low > 0.0
            require(valid and low <= high < math.inf, f"randomization.{name}", (low, high), f"low and high, {least}")
        low, high = self.torso_mass
        require(-10.0 <= low <= high < math.inf, "randomization.torso_mass", (low, high), "low and high, at least -10")
        for name in ("torso_centre", "push_velocity", "noise", "link_centre", "offset"):
            value = getattr(self, name)
            require(0.0 <= value < math.inf, f"randomization.{name}", value, "0 or a positive number")
        require(self.push_interval >= 1, "randomization.push_interval", self.push_interval, "at least 1")


@settings
class LoadConfig:
    """What hands carry and what pulls and pushes the robot; the largest values, from which training draws downwards.

    Robots of the agile group and hopping ones carry nothing and are not pulled. A schedule makes a curriculum of it.
    """

    payload: float = 0.0
    """Largest mass in each hand [kg], drawn for each hand at the start of an episode."""
    hand_force: float = 0.0
    """Largest force on each hand, in any direction [N]. It acts on either or both hands and begins at once."""
    trunk_force: float = 0.0
    """Largest horizontal force on the trunk [N]."""
    loaded_share: float = 0.7
    """Share of the episodes with a payload."""
    hand_interval: float = 5.0
    """Mean time between the end of a force on the hands and the next one [s]."""
    hand_time: tuple[float, float] = (0.2, 5.0)
    """Shortest and longest time for which a force on the hands acts [s]."""
    trunk_interval: float = 8.0
    """Mean time between the end of a force on the trunk and the next one [s]."""
    trunk_time: tuple[float, float] = (0.2, 1.2)
    """Shortest and longest time for which a force on the trunk acts [s]."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_finite(self, "loads.")
        for name in ("payload", "hand_force", "trunk_force"):
            require(getattr(self, name) >= 0.0, f"loads.{name}", getattr(self, name), "0 or a positive number")
        for name in ("hand_interval", "trunk_interval"):
            require(getattr(self, name) > 0.0, f"loads.{name}", getattr(self, name), "a positive time")
        for name in ("hand_time", "trunk_time"):
            low, high = getattr(self, name)
            require(0.0 < low <= high, f"loads.{name}", (low, high), "shortest and longest, above 0")
        require(0.0 <= self.loaded_share <= 1.0, "loads.loaded_share", self.loaded_share, "0 to 1")


@settings
class ArmServoGains:
    """Gains of the arms while they are under external control.

    They are those of the arm servo that moves them when a policy runs, whose stiffness the maker's teleoperation of the
    H1 has. Its feed-forward torque is left out: the sag without it is 2 degrees, and the pelvis bears the same weight.
    """

    stiffness: float = 140.0
    """Of every arm joint [N*m/rad]."""
    shoulder_damping: float = 10.0
    """Of shoulder pitch and roll [N*m*s/rad]."""
    distal_damping: float = 3.0
    """Of shoulder yaw and elbow [N*m*s/rad]."""

    def __post_init__(self) -> None:
        """Check the gains."""
        require_finite(self, "arm_servo.")
        for name, value in vars(self).items():
            require(value >= 0.0, f"arm_servo.{name}", value, "0 or a positive number")

    def of(self, robot: Robot) -> tuple[np.ndarray, np.ndarray]:
        """Return stiffness and damping of the arm joints of a robot, shape (8,) each."""
        distal = np.array([name.endswith(("shoulder_yaw_joint", "elbow_joint")) for name in robot.arm_names])
        stiffness = np.full(distal.shape, self.stiffness)
        return stiffness, np.where(distal, self.distal_damping, self.shoulder_damping)
