"""Numbers of other libraries where they enter: lists, NumPy's and torch's of any width, decimals and fractions."""

import math
from collections.abc import Collection, Mapping
from typing import Any, TypeVar

import numpy as np

Record = TypeVar("Record")
Shape = tuple[int, ...]
JOINTS: Shape = (-1,)
"""One number for each joint: the fields of a record that have this shape agree in their length, whatever it is."""
_FLOAT = np.dtype(float)


def floats(value: Any, shape: Shape) -> np.ndarray | None:  # noqa: ANN401  whatever arrives
    """Return a value as an array of floats; None if it is none of that shape, or does not fit into floats.

    An array of floats is returned as it is. Texts and truth values are no numbers. Never raises.
    """
    if type(value) is np.ndarray and value.dtype is _FLOAT and value.shape == shape:
        return value
    return _array(value, shape, "iufO", float)


def flags(value: Any, shape: Shape) -> np.ndarray | None:  # noqa: ANN401  whatever arrives
    """Return a value as an array of truth values, likewise; numbers count as true unless they are 0."""
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


def number(value: Any) -> float | None:  # noqa: ANN401  whatever arrives
    """Return a value as a float; None if it is no single number. Never raises."""
    if type(value) is float:
        return value
    array = floats(value, ())
    return None if array is None else float(array)


def changed(record: Record, **fields: Any) -> Record:  # noqa: ANN401  whatever the fields are
    """Return a copy of a dataclass's instance with other fields: `dataclasses.replace` in a quarter of its time."""
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
    """Convert the fields of a frozen dataclass to floats of their shapes; what is none becomes NaN, to be noticed.

    None stays where it is optional. Of vectors of joints, the longest tells how many joints there are.
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
