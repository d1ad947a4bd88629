import contextlib
import os
import pathlib
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator

import pytest
import torch
from safetensors.torch import load_file, save_file

from hugwbc.errors import ConfigError
from hugwbc.learned import distributed
from hugwbc.learned.distributed import Stop, StoppedError, stopped_by_signals
from hugwbc.learned.policy import checkpoint, load_policy

NUMBERS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
# What every process runs: its share of the stored samples, one update, one move of the curricula.
LEARN = """
import sys
import torch
from safetensors.torch import load_file, save_file
from hugwbc.learned import distributed
from hugwbc.learned.config import CurriculumConfig, EnvConfig, PPOConfig
from hugwbc.learned.env.humanoid_env import HumanoidEnv
from hugwbc.learned.policy.critic_observations import Observation
from hugwbc.learned.rl.ppo import PPO, Rollout
from hugwbc.robot import load_robot

torch.set_num_threads(1)
with distributed.process_group():
    samples = load_file(sys.argv[1])
    # Every second robot: each process gets as many of the agile group, which comes first, as of the other.
    share = slice(distributed.rank(), None, distributed.size())
    samples = {name: value[:, share] for name, value in samples.items()}
    horizon, count = samples["reward"].shape
    curriculum = CurriculumConfig(warm_up_iterations=0, alpha_interval=1, linear_threshold=0.5, angular_threshold=0.5)
    env = HumanoidEnv(EnvConfig(count=count, curriculum=curriculum), seed=distributed.rank(), threads=1)
    for _ in range(1000):  # until the running mean has forgotten its start
        env.statistics.note_gate("alpha", samples["tracking"][0], torch.ones(count, dtype=torch.bool))
    env.update_curriculum()
    torch.set_default_dtype(torch.float64)
    torch.manual_seed(0)
    config = PPOConfig(horizon=horizon, epochs=3, minibatches=1, target_kl=1e-4)
    learner = PPO(config, load_robot(), torch.Generator().manual_seed(distributed.rank()))
    newest = Observation(*(samples[name][-1] for name in ("history", "command", "critic", "estimate")))
    learner._rollout = Rollout.empty(horizon, newest, 19)
    for name in samples.keys() - {"tracking"}:
        getattr(learner.rollout, name)[:] = samples[name]
    losses = learner.update(newest)
    result = {name: value.detach() for name, value in learner.network.named_parameters()}
    result |= {name: torch.tensor(losses[name]) for name in ("kl", "learning_rate")}
    result["alpha"] = torch.tensor(env.curriculum.alpha)
    save_file(result, f"{sys.argv[2]}-{distributed.rank()}")
"""


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def learn(*words: object, rank: int = 0, processes: int = 1, port: int = 0) -> subprocess.Popen[str]:
    """Start `LEARN` as one of several processes, as torchrun would."""
    place = {"RANK": rank, "LOCAL_RANK": rank, "WORLD_SIZE": processes, "MASTER_ADDR": "127.0.0.1"}
    place |= {"MASTER_PORT": port, "OMP_NUM_THREADS": 1}
    environment = os.environ | {name: str(value) for name, value in place.items()}
    return subprocess.Popen([sys.executable, "-c", LEARN, *map(str, words)], env=environment)


def python(*words: object, processes: int = 1) -> str:
    launcher = ["-m", "torch.distributed.run", "--standalone", f"--nproc-per-node={processes}"] if processes > 1 else []
    command = [sys.executable, *launcher, *map(str, words)]
    result = subprocess.run(command, capture_output=True, text=True, env=os.environ | {"OMP_NUM_THREADS": "1"})
    assert result.returncode == 0, result.stderr
    return result.stdout


def test_two_processes_learn_as_one(tmp_path: pathlib.Path) -> None:
    torch.manual_seed(1)
    horizon, count = 6, 8
    sizes = {"history": 315, "command": 18, "critic": 122, "estimate": 6, "action": 19, "mean": 19, "tracking": 2}
    samples = {name: torch.randn(horizon, count, size, dtype=torch.float64) for name, size in sizes.items()}
    samples |= {name: torch.randn(horizon, count, dtype=torch.float64) for name in ("log_prob", "value", "reward")}
    samples["log_prob"] -= 40.0
    samples["done"] = torch.rand(horizon, count) < 0.2
    samples["group"] = torch.randint(4, (horizon, count))  # gaits, in which advantages are standardised
    # Above the thresholds on average over all robots, below them in the first process's share alone.
    samples["tracking"] = torch.full((horizon, count, 2), 0.8)
    samples["tracking"][:, ::2] = 0.3
    save_file(samples, tmp_path / "samples")
    port = free_port()
    workers = [learn(tmp_path / "samples", tmp_path / "two", rank=rank, processes=2, port=port) for rank in range(2)]
    workers.append(learn(tmp_path / "samples", tmp_path / "one"))
    assert not any([worker.wait(300.0) for worker in workers])
    one = load_file(tmp_path / "one-0")
    for rank in range(2):
        two = load_file(tmp_path / f"two-{rank}")
        for name, value in one.items():
            torch.testing.assert_close(two[name], value, atol=1e-6, rtol=0)
    assert one["alpha"].item() == pytest.approx(0.01)
    assert one["learning_rate"].item() != pytest.approx(3e-4), "the KL divergence must have moved the rate"


@pytest.mark.slow
def test_processes_train_save_and_resume_together(tmp_path: pathlib.Path) -> None:
    words = ["-m", "hugwbc.cli", "train", "--env.count", 4, "--ppo.horizon", 8, "--threads", 1, "--out", tmp_path]
    words += ["--evaluation-steps", 128, "--evaluation-robots", 4, "--evaluation-seconds", 0.1]
    output = python(*words, "--steps", 128, "--processes", 2)
    assert "stopped after 2 iterations, 128 steps" in output and output.count("stopped") == 1
    python(*words, "--steps", 256, "--resume", "--processes", 2)
    assert load_policy(tmp_path).training["iteration"] == 4
    assert load_policy(tmp_path / "best").training["iteration"] in (2, 4)
    own, metadata = checkpoint.load_file(tmp_path / "checkpoint-rank1.safetensors", "robots")
    common, _ = checkpoint.load_file(tmp_path / "checkpoint.safetensors", "checkpoint")
    assert metadata["iteration"] == 4
    assert not torch.equal(own["env.history"], common["env.history"]), "each process has robots of its own"
    with pytest.raises(AssertionError, match="give --processes 2"):
        python(*words, "--steps", 384, "--resume")
    (tmp_path / "checkpoint-rank1.safetensors").unlink()
    assert "begin new episodes" in python(*words, "--steps", 384, "--resume", "--processes", 2)


def trainers(folder: pathlib.Path) -> list[int]:
    """Return the processes whose command names a folder."""
    lines = {path.parent.name: path for path in pathlib.Path("/proc").glob("[0-9]*/cmdline")}
    found = []
    for number, path in lines.items():
        with contextlib.suppress(OSError):  # it has ended meanwhile
            found += [int(number)] if str(folder).encode() in path.read_bytes() else []
    return found


def wait_for(condition: Callable[[], bool], seconds: float = 120.0) -> None:
    """Wait until a condition holds, and fail if it takes too long."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "took too long"
        time.sleep(0.2)


@pytest.mark.slow
@pytest.mark.parametrize("sent", [signal.SIGKILL, signal.SIGTERM])
def test_processes_save_and_end_with_the_one_that_started_them(tmp_path: pathlib.Path, sent: signal.Signals) -> None:
    words = ["train", "--env.count", 4, "--ppo.horizon", 8, "--threads", 1, "--out", tmp_path, "--steps", 1e6]
    words += ["--evaluation-steps", 0, "--processes", 2]
    command = [sys.executable, "-m", "hugwbc.cli", *map(str, words)]
    launcher = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    log = tmp_path / "metrics.csv"
    try:
        wait_for(lambda: log.exists() and len(log.read_text().splitlines()) > 3)
        launcher.send_signal(sent)
        wait_for(lambda: not trainers(tmp_path))
    finally:
        for number in trainers(tmp_path):
            os.kill(number, signal.SIGKILL)
    rows = log.read_text().splitlines()
    assert load_policy(tmp_path).training["iteration"] == int(rows[-1].partition(",")[0]) == len(rows) - 1
    assert launcher.wait(60.0) == (130 if sent is signal.SIGTERM else -sent)


def test_one_process_exchanges_nothing() -> None:
    value = torch.tensor([1.0, 3.0])
    assert distributed.size() == 1 and distributed.rank() == 0
    assert distributed.mean(value) is value and distributed.total(value) is value
    assert distributed.anywhere(True) and not distributed.anywhere(False)


@pytest.mark.parametrize("gpus", [0, 1])
def test_a_gpu_that_stays_idle_is_told(monkeypatch, tmp_path: pathlib.Path, caplog, gpus: int) -> None:
    """Also one that torch does not see."""
    monkeypatch.setattr(torch.cuda, "device_count", lambda: gpus)
    monkeypatch.setattr("importlib.util.find_spec", lambda *_: None)
    monkeypatch.setattr(distributed, "_GPU_FILES", str(tmp_path / "nvidia[0-9]*"))
    assert distributed.claim_device("cpu") == distributed.claim_device("auto") == "cpu"
    assert len(caplog.messages) == gpus
    (tmp_path / "nvidia0").touch()
    caplog.clear()
    assert distributed.claim_device("auto") == "cpu"
    assert len(caplog.messages) == 1 and "hugwbc[gpu]" in caplog.text and f"found {gpus} GPUs" in caplog.text
    with pytest.raises(ConfigError, match="--device cpu"):
        distributed.claim_device("cuda")


def test_each_process_but_the_first_has_files_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    path = pathlib.Path("runs") / "checkpoint.safetensors"
    assert distributed.rank_path(path) == path
    monkeypatch.setattr(distributed, "rank", lambda: 2)
    assert distributed.rank_path(path) == pathlib.Path("runs") / "checkpoint-rank2.safetensors"


@pytest.fixture
def ctrl_c_interrupts() -> Iterator[None]:
    """Let SIGINT raise: a shell without job control makes its background processes ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_each_signal_asks_once_and_then_does_what_it_did(ctrl_c_interrupts, monkeypatch) -> None:
    before, clock = [signal.getsignal(number) for number in NUMBERS], [5.0]
    monkeypatch.setattr(distributed.time, "monotonic", lambda: clock[0])
    with stopped_by_signals() as stop:
        stop.check()
        os.kill(os.getpid(), signal.SIGINT)
        assert stop.requested
        with pytest.raises(StoppedError):
            stop.check()
        os.kill(os.getpid(), signal.SIGTERM)  # the other signal of one Ctrl-C under torchrun
        os.kill(os.getpid(), signal.SIGINT)  # of another thread of a launcher that was killed
        clock[0] += 0.3
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
        assert signal.getsignal(signal.SIGINT) == before[NUMBERS.index(signal.SIGINT)]
    assert [signal.getsignal(number) for number in NUMBERS] == before


def test_work_in_a_thread_is_not_asked() -> None:
    before = [signal.getsignal(number) for number in NUMBERS]
    seen: list[Stop] = []

    def work() -> None:
        with stopped_by_signals() as stop:
            assert [signal.getsignal(number) for number in NUMBERS] == before
            seen.append(stop)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert [stop.requested for stop in seen] == [False]
