"""Settings of the training robots: differences from their description, and loads."""

from collections.abc import Callable
from typing import Annotated, TypeVar

import tyro
from pydantic import AfterValidator, Field, ValidationInfo

from hugwbc.errors import ConfigError
from hugwbc.settings import Count, NotNegative, Positive, Share, refusing, settings

_Number = TypeVar("_Number")


def _ascending(ends: tuple[float, float], info: ValidationInfo) -> tuple[float, float]:
    if ends[0] > ends[1]:
        raise ConfigError(f"{info.field_name} is {ends[0]:g} to {ends[1]:g}; give low and high")
    return ends


Ascending = Annotated[tuple[_Number, _Number], AfterValidator(refusing(_ascending))]
Range = Ascending[Positive]


@settings
class RandomizationConfig:
    """Model parameters of each robot, drawn once, and disturbances. Factors multiply the nominal value."""

    friction: Range = (0.4, 1.5)
    """Sliding friction of the robot's geometry."""
    mass: Range = (0.84, 1.06)
    """Factor on the masses and inertias of all links together. From 59.3 kg it reaches the 51.65 kg of the earlier
    description with room below."""
    torso_mass: Ascending[Annotated[float, Field(ge=-10)]] = (-1.0, 3.0)
    """Mass added to the torso, which has 18 kg [kg]."""
    torso_centre: NotNegative = 0.03
    """Half-width of the shift of the torso's centre of mass along each axis [m]."""
    gains: Range = (0.9, 1.1)
    """Factor on the stiffness of each joint and, independently, on its damping."""
    link_mass: Range = (0.9, 1.1)
    """Factor on the mass and inertia of each link by itself (the authors: 0.8 to 1.2)."""
    link_centre: NotNegative = 0.01
    """Half-width of the shift of each link's centre of mass along each axis [m] (the authors: 0.01)."""
    strength: Range = (0.9, 1.1)
    """Factor on the torque of each joint before its limit applies (the authors: 0.8 to 1.2)."""
    offset: NotNegative = 0.01
    """Half-width of the error of each joint's position target [rad] (the authors: 0.02)."""
    drive_friction: Ascending[NotNegative] = (0.5, 1.5)
    """Factor on the Coulomb and viscous friction of each real drive."""
    latency: Ascending[NotNegative] = (0.0, 0.02)
    """Time from an action to its effect [s], one value per robot, rounded to physics steps. It stands for the age of
    the readings, which is 10 ms in the arena, and for the delay of the drives, which is 2 ms."""
    push_velocity: NotNegative = 0.5
    """Half-width of a push, which changes the horizontal velocity of the pelvis [m/s]."""
    push_interval: Count = 400
    """Mean number of control steps between two pushes of a robot."""
    sensing: Ascending[NotNegative] = (0.0, 1.5)
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


@settings
class LoadConfig:
    """Payloads of the hands, and forces on hands and trunk: the largest values that training draws.

    Hopping robots and those of the agile group have none. Schedules of these settings make a curriculum.
    """

    payload: NotNegative = 0.0
    """Largest mass in each hand [kg], drawn for each hand at the start of an episode."""
    hand_force: NotNegative = 0.0
    """Largest force on each hand, in any direction [N]. It acts on either or both hands and begins at once."""
    trunk_force: NotNegative = 0.0
    """Largest horizontal force on the trunk [N]."""
    loaded_share: Share = 0.7
    """Share of the episodes with a payload."""
    hand_interval: Positive = 5.0
    """Mean time between the end of a force on the hands and the next one [s]."""
    hand_time: Range = (0.2, 5.0)
    """Shortest and longest time for which a force on the hands acts [s]."""
    trunk_interval: Positive = 8.0
    """Mean time between the end of a force on the trunk and the next one [s]."""
    trunk_time: Range = (0.2, 1.2)
    """Shortest and longest time for which a force on the trunk acts [s]."""
