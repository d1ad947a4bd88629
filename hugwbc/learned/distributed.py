"""Several processes that learn as one: means over the ranks of a torchrun job; with one, nothing is exchanged."""

import contextlib
import os
import pathlib
from collections.abc import Iterable, Iterator

import torch
from torch import distributed as dist


@contextlib.contextmanager
def process_group(backend: str) -> Iterator[None]:
    """Join the job that torchrun started, if any, and leave it at the end.

    Args:
        backend: torch's name; "gloo" for tensors on the CPU, "nccl" for CUDA, or one for either.
    """
    joined = int(os.environ.get("WORLD_SIZE", "1")) > 1 and not dist.is_initialized()
    if joined:
        dist.init_process_group(backend)
    try:
        yield
    finally:
        if joined:
            dist.destroy_process_group()


def rank() -> int:
    """Number of this process, 0 for the one that writes files and prints."""
    return dist.get_rank() if dist.is_initialized() else 0


def local_rank() -> int:
    """Number of this process on its machine."""
    return int(os.environ.get("LOCAL_RANK", "0"))


def size() -> int:
    """Number of processes."""
    return dist.get_world_size() if dist.is_initialized() else 1


def own_path(path: pathlib.Path) -> pathlib.Path:
    """A file's name in this process: the first one's is as given."""
    return path.with_stem(f"{path.stem}-rank{rank()}") if rank() else path


def total(value: torch.Tensor) -> torch.Tensor:
    """Sum of a tensor over all processes."""
    if size() > 1:
        value = value.clone()
        dist.all_reduce(value)
    return value


def mean(value: torch.Tensor) -> torch.Tensor:
    """Mean of a tensor over all processes."""
    return total(value) / size() if size() > 1 else value


def anywhere(flag: bool) -> bool:
    """Whether a flag is set in any process: all of them get the same answer."""
    return bool(total(torch.tensor(float(flag))) > 0.0)


def average_gradients(parameters: Iterable[torch.nn.Parameter]) -> None:
    """Replace every gradient by its mean over all processes, in one exchange."""
    if size() == 1:
        return
    gradients = [parameter.grad for parameter in parameters if parameter.grad is not None]
    means = mean(torch.cat([gradient.flatten() for gradient in gradients]))
    for gradient, part in zip(gradients, means.split([gradient.numel() for gradient in gradients]), strict=True):
        gradient.copy_(part.view_as(gradient))


def standardised(values: torch.Tensor) -> torch.Tensor:
    """Values minus their mean, over their standard deviation; both are those of all processes together.

    Args:
        values: as many in every process.
    """
    centred = values - mean(values.mean())
    variance = total(centred.square().sum()) / (size() * values.numel() - 1)
    return centred / (variance.sqrt() + 1e-8)
