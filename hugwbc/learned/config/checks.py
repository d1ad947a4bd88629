"""Checks that the groups of settings share: ranges, finite numbers, seeds, speeds."""

import math

from hugwbc.commands import command_ranges
from hugwbc.errors import ConfigError
from hugwbc.gait import Gait


def require(condition: bool, name: str, value: object, valid: str) -> None:
    """Refuse a value unless a condition holds.

    Args:
        condition: what must hold.
        name: name of the setting, as in its flag.
        value: value of the setting.
        valid: valid values, in words.
    """
    if not condition:
        raise ConfigError(f"{name} = {value}; valid: {valid}. Change that option")


def require_finite(settings: object, prefix: str = "") -> None:
    """Refuse NaN and infinity in any number of a dataclass; training would show them hours later, if at all."""
    for name, value in vars(settings).items():
        numbers = [number for number in (value if isinstance(value, tuple) else (value,)) if isinstance(number, float)]
        require(all(map(math.isfinite, numbers)), f"{prefix}{name}", value, "finite")


def require_seed(seed: int) -> None:
    """Refuse a seed that a random number generator would not accept."""
    require(0 <= seed < 2**63, "seed", seed, "0 or more, below 2^63")


def require_speed(speed: float) -> None:
    """Refuse a largest v_x [m/s] that lies outside of the range of commands."""
    fastest = command_ranges(Gait.WALKING)["v_x"].finishing[1]
    require(0.0 < speed <= fastest, "max_speed", speed, f"above 0, up to {fastest:g} m/s")
