"""Feed-forward of commands: what to request from a policy, so that it executes the command.

A trained policy is often precise but biased: it walks at 1.09 of the commanded speed, or squats two centimetres too
little. Curves that were measured once, linear between knots, take the mean error out. They change only what the network
reads; they use no measurement at run time, so that they cannot make anything unstable, and they cannot take out what
changes from robot to robot.
"""

import numpy as np

from hugwbc.commands import COMMAND_NAMES
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.gait import Gait

LARGEST_CHANGE = {"v_x": 0.3, "v_y": 0.25, "omega": 0.3, "h": 0.06, "p": 0.1, "w": 0.3, "l": 0.15}
"""Largest difference between a command and what is asked for [m/s, m/s, rad/s, m, rad, rad, m]: further away the policy
was never trained. The gait's clock takes f as it is, so that f has no curve."""
Curves = dict[str, dict[str, list[list[float]]]]  # gait -> command -> pairs of command and what to ask for
_MOST_KNOTS = 100


def check_curves(curves: Curves) -> Curves:
    """Return curves: rising commands, and what to ask for, which differs from them by at most `LARGEST_CHANGE`."""
    for label, of_gait in curves.items():
        Gait.parse(label)
        for name, pairs in of_gait.items():
            if name not in LARGEST_CHANGE:
                raise UnknownNameError("command with a curve", name, LARGEST_CHANGE, at=(label,))
            if not 2 <= len(pairs) <= _MOST_KNOTS or any(len(pair) != 2 for pair in pairs):
                raise ConfigError(f"a curve is not 2 to {_MOST_KNOTS} pairs of numbers", at=(label, name))
            knots, asked = np.array(pairs).T
            limit = LARGEST_CHANGE[name]
            if not (np.diff(knots) > 0.0).all() or np.abs(asked - knots).max() > limit + 1e-9:
                raise ConfigError(
                    f"the curve of {label} {name} falls, or changes a command by more than {limit}; give "
                    "rising commands and what to ask for, which is close to them",
                    at=(label, name),
                )
    return curves


class FeedForward:
    """Curves of the requested value, by gait and command; commands without a curve are unchanged."""

    def __init__(self, curves: Curves) -> None:
        """Take curves that `check_curves` admits."""
        self._curves = [
            (int(Gait.parse(label)), COMMAND_NAMES.index(name), *np.array(pairs, dtype=float).T)
            for label, of_gait in curves.items()
            for name, pairs in of_gait.items()
        ]

    def asked(self, command: np.ndarray, gait: np.ndarray) -> np.ndarray:
        """Return what to ask the network for, shape (n, 8).

        Args:
            command: commands, shape (n, 8).
            gait: values of `Gait`, shape (n,).
        """
        if not self._curves:
            return command
        result = command.copy()
        for value, column, knots, asked in self._curves:
            rows = gait == value
            if rows.any():
                result[rows, column] += np.interp(command[rows, column], knots, asked - knots)
        return result
