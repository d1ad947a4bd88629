"""Random numbers on the device of their generator."""

import zlib

import torch


def rand(generator: torch.Generator, *shape: int, dtype: torch.dtype = torch.float32) -> torch.Tensor:
    """Draw uniform numbers in [0, 1)."""
    return torch.rand(shape, generator=generator, device=generator.device, dtype=dtype)


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


def restore(generator: torch.Generator, state: torch.Tensor) -> None:
    """Continue from the state of a generator; from that of another kind of device, begin with a seed made of it."""
    if state.shape == generator.get_state().shape:
        generator.set_state(state)
    else:
        generator.manual_seed(zlib.crc32(state.numpy().tobytes()))
