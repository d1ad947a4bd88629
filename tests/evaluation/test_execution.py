import os
import signal
import subprocess
import sys
import threading

import distributed
import pytest

from hugwbc.errors import ConfigError
from hugwbc.evaluation.execution import Execution
from hugwbc.evaluation.experiment import _controller, run_experiment
from hugwbc.evaluation.experiments.random_commands import EXPERIMENT, RandomCommandsSettings
from hugwbc.evaluation.store import Store
from hugwbc.runtime.controllers import ControllerSpec

# Jobs of workers that need not import this module and all that it does.
PROCESS, DEATH = "__import__('os').getpid()", "__import__('os')._exit(1)"


def test_jobs_run_here_or_in_processes_that_stay():
    assert list(Execution().run(abs, [-1, -2])) == [1, 2]
    assert list(Execution(2).run(abs, [])) == []
    with Execution(2) as execution:
        processes = {process for _ in range(2) for process in execution.run(eval, [PROCESS] * 6)}
        assert os.getpid() not in processes and len(processes) <= 2
    with pytest.raises(ConfigError, match="give 1 or more"):
        Execution(0)


def test_a_worker_that_dies_is_an_error_with_a_remedy_and_the_next_jobs_get_new_ones():
    with Execution(2) as execution:
        with pytest.raises(ConfigError, match="run the same again"):
            list(execution.run(eval, ["1", "2", DEATH, "4"]))
        assert sorted(execution.run(eval, ["1", "2"])) == [1, 2]


def test_workers_end_when_the_process_that_they_work_for_is_killed():
    script = (
        "import time; from hugwbc.evaluation.execution import Execution; execution = Execution(2);"
        "print(list(execution.run(abs, [-1, -2])), flush=True); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stdout.readline() in ("[1, 2]\n", "[2, 1]\n")
        process.kill()
        process.communicate(timeout=20)  # the workers have the same standard output: it ends when the last of them does


@pytest.mark.parametrize("begun", [False, True])
def test_ctrl_c_ends_workers_at_once_and_without_their_stacks(begun):
    job = "print(1, flush=True) or __import__('time').sleep(300)" if begun else "__import__('time').sleep(300)"
    said = "" if begun else "threading.Timer(0.2, print, ['1'], {'flush': True}).start()"  # while workers start
    script = f"""import threading
from hugwbc.evaluation.execution import Execution
try:
    with Execution(2) as execution:
        {said}
        list(execution.run(eval, [{job!r}] * 9))
except KeyboardInterrupt:
    print("stopped")"""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "start_new_session": True}
    with subprocess.Popen([sys.executable, "-c", script], **pipes) as process:
        assert process.stdout is not None and process.stdout.readline() == "1\n"
        os.killpg(process.pid, signal.SIGINT)
        printed, errors = process.communicate(timeout=60)
    assert printed.endswith("stopped\n") and errors == ""


def test_each_thread_has_its_own_controller_as_long_as_its_files_stay_the_same():
    spec = ControllerSpec("hold")
    here, there = _controller(spec, "a"), []
    threads = [threading.Thread(target=lambda: there.append(_controller(spec, "a"))) for _ in range(2)]
    for thread in threads:
        thread.start()
        thread.join()
    assert len({id(controller) for controller in (here, *there)}) == 3
    assert _controller(ControllerSpec("hold"), "a") is here and _controller(spec, "b") is not here


@pytest.mark.slow
def test_a_cluster_whose_worker_is_killed_in_mid_run_loses_nothing(tmp_path):
    settings, spec = RandomCommandsSettings(episodes=12, duration=0.6, settle=0.3), ControllerSpec("qp")
    alone = run_experiment(EXPERIMENT, settings, spec)
    options = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "host": "127.0.0.1"}
    killed = []
    with distributed.LocalCluster(**options, dashboard_address=None) as cluster:

        def kill_one(done: float) -> None:
            if not killed:
                killed.append(cluster.workers[0].pid)
                os.kill(killed[0], signal.SIGKILL)

        with Execution(cluster=cluster.scheduler_address) as execution:
            store = Store(tmp_path)
            shared = run_experiment(EXPERIMENT, settings, spec, execution=execution, store=store, on_progress=kill_one)
    assert killed and shared == alone
    (path,) = tmp_path.iterdir()
    assert len(path.read_text().splitlines()) == 1 + 12
