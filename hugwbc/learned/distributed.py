"""Training in several processes: sums and means over the processes of a torchrun job, and requests to stop.

A single process exchanges nothing. Ctrl-C, SIGTERM and SIGHUP ask for a stop, and the work ends where it can save.
"""

import contextlib
import ctypes
import glob
import importlib.util
import logging
import os
import pathlib
import signal
import threading
import time
from collections.abc import Iterable, Iterator
from typing import Any

import torch
from torch import distributed as dist

from hugwbc.errors import ConfigError

_AGAIN = 0.2  # [s] after a signal, within which its repetitions are the same request
_GPU_FILES = "/dev/nvidia[0-9]*"  # one for each GPU, whether torch is built for it or not
_PR_SET_PDEATHSIG = 1  # option of Linux's prctl: which signal a process gets when its parent ends

_log = logging.getLogger(__name__)


@contextlib.contextmanager
def process_group() -> Iterator[None]:
    """Join the job that torchrun started, if any, and leave it at the end; SIGTERM comes if torchrun is killed."""
    joined = int(os.environ.get("WORLD_SIZE", "1")) > 1 and not dist.is_initialized()
    if joined:
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
        dist.init_process_group("cpu:gloo,cuda:nccl" if torch.cuda.is_available() else "gloo")
    try:
        yield
    finally:
        if joined:
            dist.destroy_process_group()


def rank() -> int:
    """Return the number of this process among all, from 0; process 0 leads: it evaluates, logs and prints."""
    return dist.get_rank() if dist.is_initialized() else 0


def local_rank() -> int:
    """Return the number of this process on its machine."""
    return int(os.environ.get("LOCAL_RANK", "0"))


def claim_device(wish: str) -> str:
    """Return the device of this process for a value of `TrainConfig.device`, and select it if it is a GPU.

    If "auto" falls back to the processor although there is a GPU, a warning says what is lacking.

    Raises:
        ConfigError: if "cuda" is asked for and a GPU for each process or MuJoCo Warp is lacking.
    """
    if wish not in ("auto", "cuda"):
        return wish
    gpus, on_this_machine = torch.cuda.device_count(), int(os.environ.get("LOCAL_WORLD_SIZE", "1"))
    lacking = {
        "an NVIDIA GPU for each process, and torch built for it": gpus < on_this_machine,
        "MuJoCo Warp: pip install 'hugwbc[gpu]'": importlib.util.find_spec("mujoco_warp") is None,
    }
    needed = [need for need, lacks in lacking.items() if lacks]
    lack = f"device cuda needs {' and '.join(needed)}; found {gpus} GPUs"
    if needed and wish == "auto":
        if rank() == 0 and (gpus or glob.glob(_GPU_FILES)):
            _log.warning("%s. This training uses the processor alone", lack)
        return "cpu"
    if needed:
        raise ConfigError(f"{lack}. Or use --device cpu")
    torch.cuda.set_device(local_rank())
    return f"cuda:{local_rank()}"


def size() -> int:
    """Return the number of processes."""
    return dist.get_world_size() if dist.is_initialized() else 1


def rank_path(path: pathlib.Path) -> pathlib.Path:
    """Return the path of this process's version of a file: the given one in process 0, with the rank in the others."""
    return path.with_stem(f"{path.stem}-rank{rank()}") if rank() else path


def barrier() -> None:
    """Wait until all processes are here."""
    if size() > 1:
        dist.barrier()


def total(value: torch.Tensor) -> torch.Tensor:
    """Return the sum of a tensor over all processes."""
    if size() > 1:
        value = value.clone()
        dist.all_reduce(value)
    return value


def mean(value: torch.Tensor) -> torch.Tensor:
    """Return the mean of a tensor over all processes."""
    return total(value) / size() if size() > 1 else value


def anywhere(flag: bool) -> bool:
    """Return whether a flag is set in any process; all processes get the same answer."""
    return bool(total(torch.tensor(float(flag))) > 0.0)


def average_gradients(parameters: Iterable[torch.nn.Parameter]) -> None:
    """Replace every gradient by its mean over all processes, in one exchange."""
    if size() == 1:
        return
    gradients = [parameter.grad for parameter in parameters if parameter.grad is not None]
    means = mean(torch.cat([gradient.flatten() for gradient in gradients]))
    for gradient, part in zip(gradients, means.split([gradient.numel() for gradient in gradients]), strict=True):
        gradient.copy_(part.view_as(gradient))


class StoppedError(Exception):
    """The work was asked to stop."""


class Stop:
    """The request to stop; the work checks it between its steps."""

    def __init__(self) -> None:
        self.requested = False  # whether the work was asked to stop

    def check(self) -> None:
        """End the work with a `StoppedError` on request."""
        if self.requested:
            raise StoppedError


@contextlib.contextmanager
def stopped_by_signals() -> Iterator[Stop]:
    """Let SIGINT, SIGTERM and SIGHUP ask for a stop instead of ending the process.

    A signal that comes a second time has its usual effect, which mostly ends the process. Repetitions within `_AGAIN`
    seconds are the same request, since a launcher that is killed sends a signal for each of its threads. SIGTERM after
    SIGINT is no repetition either: torchrun sends both to its processes on one Ctrl-C. In a thread other than the main
    one, where Python handles no signals, nothing changes.

    Yields:
        The request to stop.
    """
    stop, previous, asked = Stop(), dict[int, Any](), dict[int, float]()

    def request(number: int, _frame: object) -> None:
        stop.requested = True
        if time.monotonic() - asked.setdefault(number, time.monotonic()) > _AGAIN:
            signal.signal(number, previous.pop(number))
            signal.raise_signal(number)

    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if signal.getsignal(number) is signal.SIG_IGN:  # such as SIGHUP under nohup
                continue
            previous[number] = signal.signal(number, request)
    try:
        yield stop
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
