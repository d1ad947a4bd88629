"""NumPy arrays and torch tensors: training and deployment share formulas that take either and return the same kind."""

from collections.abc import Callable
from typing import Any

import numpy as np

Array = Any  # a NumPy array or a torch tensor
Place = Callable[[np.ndarray], Array]  # what makes constants arrays of the kind, and on the device, of the arguments


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
