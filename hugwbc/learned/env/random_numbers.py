"""Random numbers of the environment, on the device of their generator."""

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
