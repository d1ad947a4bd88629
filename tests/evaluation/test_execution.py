import os

import pytest

from hugwbc.errors import ConfigError, WorkerError
from hugwbc.evaluation.execution import Execution


def _die_at_three(number: int) -> int:
    if number == 3:
        os._exit(1)
    return number


def test_jobs_run_here_or_in_processes_that_stay():
    assert list(Execution().run(abs, [-1, -2])) == [1, 2]
    assert list(Execution(2).run(abs, [])) == []
    with Execution(2) as execution:
        processes = {process for _ in range(2) for process in execution.run(_process, range(6))}
        assert os.getpid() not in processes and len(processes) <= 2
    with pytest.raises(ConfigError, match="give 1 or more"):
        Execution(0)


def _process(number: int) -> int:
    return os.getpid()


def test_a_worker_that_dies_is_an_error_with_a_remedy_and_the_next_jobs_get_new_ones():
    with Execution(2) as execution:
        with pytest.raises(WorkerError, match="run the same again"):
            list(execution.run(_die_at_three, [1, 2, 3, 4]))
        assert sorted(execution.run(_die_at_three, [1, 2])) == [1, 2]


def test_a_cluster_that_is_not_there_is_an_error_with_a_remedy():
    pytest.importorskip("distributed")
    with pytest.raises(WorkerError, match="no Dask scheduler answers at tcp"):
        list(Execution(cluster="tcp://127.0.0.1:9").run(abs, [-1]))
