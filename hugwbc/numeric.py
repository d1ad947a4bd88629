"""Numbers of other libraries where they enter: lists, NumPy's and torch's of any width, decimals and fractions.

And formulas that take NumPy arrays or torch tensors and return the same kind, for training and deployment alike.
"""

import math
from collections.abc import Callable, Collection, Mapping
from typing import Any, TypeVar

import numpy as np

Record = TypeVar("Record")
U = TypeVar("U")
Array = Any  # a NumPy array or a torch tensor
Place = Callable[[np.ndarray], Array]  # turns a constant into an array of the kind and device of the arguments
Shape = tuple[int, ...]
JOINTS: Shape = (-1,)
"""One number for each joint: the fields of a record that have this shape agree in their length, whatever it is."""
_FLOAT = np.dtype(float)


def floats(value: Any, shape: Shape) -> np.ndarray | None:  # noqa: ANN401  whatever arrives
    """Return a value as an array of floats; None if it has another shape, or does not fit into floats.

    An array of floats is returned as it is. Texts and truth values are no numbers. Never raises.
    """
    if type(value) is np.ndarray and value.dtype is _FLOAT and value.shape == shape:
        return value
    return _array(value, shape, "iufO", float)


def flags(value: Any, shape: Shape) -> np.ndarray | None:  # noqa: ANN401  whatever arrives
    """Return a value as an array of truth values; None if its shape or kind differs. 0 is false."""
    if type(value) is np.ndarray and value.dtype == bool and value.shape == shape:
        return value
    return _array(value, shape, "biuf", bool)


def _array(value: Any, shape: Shape, kinds: str, to: type) -> np.ndarray | None:  # noqa: ANN401  whatever arrives
    try:
        # NumPy takes None for NaN, and truth values among numbers for numbers.
        if value is None or (
            "b" not in kinds and isinstance(value, list | tuple) and any(x is True or x is False for x in value)
        ):
            return None
        array = np.asarray(value.detach().cpu() if hasattr(value, "detach") else value)
        return array.astype(to) if array.dtype.kind in kinds and array.shape == shape else None
    except Exception:  # the code of somebody else may raise anything
        return None


def frozen(values: Any) -> np.ndarray:  # noqa: ANN401  numbers
    """Return numbers as a read-only array of floats of its own."""
    array = np.array(values, dtype=float)
    array.setflags(write=False)
    return array


def number(value: Any) -> float | None:  # noqa: ANN401  whatever arrives
    """Return a value as a float; None if it is no single number. Never raises."""
    if type(value) is float:
        return value
    array = floats(value, ())
    return None if array is None else float(array)


def changed(record: Record, **fields: Any) -> Record:  # noqa: ANN401  whatever the fields are
    """Return a copy of a dataclass's instance with other fields, of a class without keyword-only fields."""
    kind: Any = type(record)
    now = vars(record)  # may hold more, such as cached properties
    return kind(**{name: fields[name] if name in fields else now[name] for name in kind.__match_args__})


def _length(value: Any) -> int:  # noqa: ANN401  whatever arrives
    """Return the length of a vector of numbers; 1 for anything else."""
    if type(value) is np.ndarray and value.dtype is _FLOAT:
        return value.size if value.ndim == 1 else 1
    try:
        size = len(value)
    except Exception:  # the code of somebody else may raise anything
        return 1
    return 1 if floats(value, (size,)) is None else size


def keep_floats(record: object, shapes: Mapping[str, Shape], optional: Collection[str] = ()) -> None:
    """Convert the fields of a frozen dataclass to floats of their shapes; what cannot be converted becomes NaN.

    None stays in an optional field. The longest vector of joints tells how many joints there are.
    """
    fields = record.__dict__
    vectors = [fields[name] for name in shapes if shapes[name] is JOINTS and fields[name] is not None]
    joints = (max(map(_length, vectors), default=1),)
    for name in shapes:
        value, shape = fields[name], shapes[name]
        shape = joints if shape is JOINTS else shape
        if value is None and name in optional:
            continue
        if not shape:
            if type(value) is not float:
                converted = number(value)
                fields[name] = math.nan if converted is None else converted
        elif type(value) is not np.ndarray or value.dtype is not _FLOAT or value.shape != shape:
            array = floats(value, shape)
            fields[name] = np.full(shape, np.nan) if array is None else array


def namespace(array: Array) -> Any:  # noqa: ANN401  a module
    """Return the module with the functions of an array: torch for a tensor, else NumPy."""
    if type(array).__module__.startswith("torch"):
        import torch

        return torch
    return np


def double(array: Array) -> Array:
    """Return an array in double precision."""
    return np.asarray(array, dtype=float) if namespace(array) is np else array.double()


def single(array: Array) -> Array:
    """Return an array in single precision, which networks read."""
    return np.asarray(array, dtype=np.float32) if namespace(array) is np else array.float()


def whole(array: Array) -> Array:
    """Return numbers without their fractions, to index with."""
    return array.astype(int) if namespace(array) is np else array.long()


def minimum_jerk(u: U, distance: U | float = 1.0) -> U:
    """Return `distance` times s(u) = 10 u^3 - 15 u^4 + 6 u^5, the minimum-jerk blend (Flash and Hogan, 1985).

    It leads from one value to another with velocity and acceleration zero at both ends. It takes numbers, NumPy arrays
    or torch tensors.

    Args:
        u: the part of the time that has passed, from 0 to 1.
        distance: what the blend covers in all, broadcast with `u`.
    """
    return distance * u**3 * (10.0 - 15.0 * u + 6.0 * u**2)  # type: ignore[operator,return-value]


def smooth_step(u: float) -> float:
    """Return s(u) of `minimum_jerk`, with 0 before u = 0 and 1 after u = 1."""
    return minimum_jerk(min(max(u, 0.0), 1.0))


def smooth_rate(u: float) -> float:
    """Return the derivative of `smooth_step`."""
    u = min(max(u, 0.0), 1.0)
    return 30.0 * (u * (1.0 - u)) ** 2
