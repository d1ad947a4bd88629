"""Feed-forward of commands: what to ask a policy for, so that it executes what was commanded.

A trained policy is often precise but biased: it walks at 1.09 of the commanded speed, or squats two centimetres too
little. Curves that were measured once, linear between knots, take the mean error out. They change only what the network
reads; they use no measurement at run time, so that they cannot make anything unstable, and they cannot take out what
changes from robot to robot.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from hugwbc.commands import COMMAND_NAMES
from hugwbc.errors import PolicyFileError
from hugwbc.gait import Gait

KEY = "feed_forward"  # entry of a policy's contract
LARGEST_CHANGE = {"v_x": 0.3, "v_y": 0.25, "omega": 0.3, "h": 0.06, "p": 0.1, "w": 0.3, "l": 0.15}
"""Largest difference between a command and what is asked for [m/s, m/s, rad/s, m, rad, rad, m]: further away the policy
was never trained. The gait's clock takes f as it is, so that f has no curve."""
Curves = Mapping[str, Mapping[str, list[list[float]]]]  # gait -> command -> pairs of command and what to ask for
_MOST_KNOTS = 100


class FeedForward:
    """Curves of what to ask for, by gait and command; commands without a curve stay as they are."""

    def __init__(self, curves: Curves) -> None:
        """Read curves: pairs of command and what to ask for, by label of the gait and name of the command.

        Raises:
            ValueError: if a name is unknown, or a curve is not a list of finite pairs with rising commands whose
                values differ by at most `LARGEST_CHANGE`.
        """
        self._curves: list[tuple[int, int, np.ndarray, np.ndarray]] = []
        for label, of_gait in curves.items():
            gait = {gait.label: int(gait) for gait in Gait}.get(label)
            if gait is None or not isinstance(of_gait, Mapping):
                raise ValueError(f"{label!r} is not the curves of a gait")
            for name, pairs in of_gait.items():
                if name not in LARGEST_CHANGE:
                    raise ValueError(f"{name!r} cannot have a curve")
                if not isinstance(pairs, list) or not 2 <= len(pairs) <= _MOST_KNOTS:
                    raise ValueError(f"the curve of {label} {name} does not have 2 to {_MOST_KNOTS} knots")
                points = np.array(pairs, dtype=float)
                if points.shape != (len(pairs), 2) or not np.isfinite(points).all():
                    raise ValueError(f"the curve of {label} {name} is not pairs of finite numbers")
                knots, asked = points.T
                if not (np.diff(knots) > 0.0).all() or np.abs(asked - knots).max() > LARGEST_CHANGE[name] + 1e-9:
                    raise ValueError(f"the curve of {label} {name} does not rise, or is too far from the commands")
                self._curves.append((gait, COMMAND_NAMES.index(name), knots, asked - knots))

    def asked(self, command: np.ndarray, gait: np.ndarray) -> np.ndarray:
        """Return what to ask the network for, shape (n, 8).

        Args:
            command: commands, shape (n, 8).
            gait: values of `Gait`, shape (n,).
        """
        if not self._curves:
            return command
        result = command.copy()
        for value, column, knots, change in self._curves:
            rows = gait == value
            if rows.any():
                result[rows, column] += np.interp(command[rows, column], knots, change)
        return result


def of_contract(metadata: Mapping[str, Any], origin: object = "the policy") -> FeedForward:
    """Return the feed-forward of a policy's contract; one that changes nothing if it has none.

    Raises:
        PolicyFileError: if it is malformed.
    """
    curves = metadata.get(KEY, {})
    try:
        if not isinstance(curves, Mapping):
            raise ValueError("it is not a mapping")
        return FeedForward(curves)
    except (ValueError, TypeError) as error:
        raise PolicyFileError(
            f"{origin} has an unreadable feed-forward: {error}; use a file as hugwbc wrote it"
        ) from error
