"""Run jobs in this process, in several processes, or on a Dask cluster."""

import concurrent.futures
import multiprocessing
import os
import signal
import threading
import types
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

from hugwbc.errors import ConfigError, needing

Job = TypeVar("Job")
Outcome = TypeVar("Outcome")


class Execution:
    """Where the episodes of an evaluation run: in processes on this machine, or on a Dask cluster.

    Processes and connections are made with the first jobs and serve all later ones, until `close` or the end of a
    `with` block. None of the settings changes a result.
    """

    def __init__(self, workers: int = 1, *, cluster: str | None = None) -> None:
        """Keep the settings; nothing is started yet."""
        if workers < 1:
            raise ConfigError(f"workers is {workers}; give 1 or more")
        self.workers = workers
        self.cluster = cluster
        self._client: Any = None
        self._broken: tuple[type[BaseException], ...] = (concurrent.futures.BrokenExecutor,)
        self._executor: concurrent.futures.Executor | None = None

    def __enter__(self) -> "Execution":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: types.TracebackType | None
    ) -> None:
        self.close(wait=kind is None)

    def close(self, *, wait: bool = True) -> None:
        """End processes and connections; without `wait`, jobs that have not finished are dropped."""
        if self._client is not None:
            self._client.close()  # drops the jobs that are left
        elif self._executor is not None:
            workers = [] if wait else [*self._executor._processes.values()]  # type: ignore[attr-defined]
            self._executor.shutdown(wait=wait, cancel_futures=not wait)
            for worker in workers:
                worker.terminate()
        self._client = self._executor = None

    def run(self, function: Callable[[Job], Outcome], jobs: Sequence[Job]) -> Iterator[Outcome]:
        """Yield the outcome of every job in the order in which the jobs finish.

        With more than one worker or on a cluster the function, the jobs and the outcomes must be picklable.
        """
        if not jobs:
            return
        if self.workers == 1 and self.cluster is None:
            yield from map(function, jobs)
            return
        executor = self._started()
        # Workers inherit this: Ctrl-C, after which they would print their stacks, is for this process, which ends them.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            futures = [executor.submit(function, job) for job in jobs]
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        try:
            for future in concurrent.futures.as_completed(futures):
                yield future.result()
        except self._broken as error:
            self.close(wait=False)
            raise ConfigError(
                f"a worker ended in the middle of an episode: killed, or out of memory ({error}). Finished episodes "
                "are kept where results are stored; run the same again, with fewer workers if memory was short"
            ) from error
        except (Exception, GeneratorExit):  # not after Ctrl-C: `close` cancels them, and Python fails if both do
            for future in futures:
                future.cancel()
            raise

    def _started(self) -> concurrent.futures.Executor:
        if self._executor is None and self.cluster is None:
            context = multiprocessing.get_context("spawn")
            self._executor = concurrent.futures.ProcessPoolExecutor(self.workers, context, _end_with_parent)
        elif self._executor is None:
            self._client, self._broken = connect(str(self.cluster))
            self._executor = self._client.get_executor(pure=False)
        assert self._executor is not None
        return self._executor


def _end_with_parent() -> None:
    """End this worker when its parent process is gone; after a SIGKILL of the parent it would wait for jobs forever."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def connect(address: str) -> tuple[Any, tuple[type[BaseException], ...]]:
    """Return a Dask client of a running scheduler and the exceptions that mean that workers or connections are lost.

    Dask sends functions and arguments as pickles, which can run any code: connect only to a cluster that you trust as
    you trust yourself.
    """
    with needing("cluster", "a cluster"):
        from distributed import Client, KilledWorker
        from distributed.client import FutureCancelledError
        from distributed.comm.core import CommClosedError
    try:
        client = Client(address, timeout="10s", set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise ConfigError(
            f"no Dask scheduler answers at {address} ({error}); valid is tcp://HOST:PORT; start one with "
            "`dask scheduler`, and workers with `dask worker ADDRESS`, each with this version of hugwbc"
        ) from error
    return client, (KilledWorker, FutureCancelledError, CommClosedError, concurrent.futures.CancelledError)
