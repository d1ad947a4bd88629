import csv
import dataclasses
import gc
import itertools
import json
import math
import os
import pathlib
import shutil
import signal
import weakref

import pytest
import torch

from hugwbc.errors import ConfigError, PolicyFileError
from hugwbc.learned.config import (
    CurriculumConfig,
    EnvConfig,
    LoadConfig,
    PPOConfig,
    RandomizationConfig,
    RewardTerm,
    Schedule,
    TerrainConfig,
    TrainConfig,
)
from hugwbc.learned.env.readings import StepResult
from hugwbc.learned.policy import checkpoint, load_policy
from hugwbc.learned.policy.network_files import SNAPSHOT_FILE
from hugwbc.learned.policy.records import LOG_NAME, settings_record
from hugwbc.learned.rl.continuation import differences
from hugwbc.learned.rl.evaluator import Evaluator
from hugwbc.learned.rl.trainer import CHECKPOINT_NAME, Trainer, train

# The curricula move from the first iteration, so that their state matters for a resumed run.
CURRICULUM = CurriculumConfig(
    steps=64, warm_up_iterations=0, alpha_interval=1, linear_threshold=0.0, angular_threshold=0.0
)
ENV = EnvConfig(count=16, curriculum=CURRICULUM)
PPO = PPOConfig(horizon=4, epochs=2, minibatches=2)


def config(out: pathlib.Path, iterations: int, **changes: object) -> TrainConfig:
    changes = {"evaluation_steps": 0} | changes
    return TrainConfig(out=out, steps=iterations * 64, threads=1, env=ENV, ppo=PPO, **changes)


LATE = RandomizationConfig(latency=(0.0, 0.02))
SETTINGS = [
    {"curriculum": dataclasses.replace(ENV.curriculum, speed_interval=2, steps=96), "intervention": "motion"},
    {"loads": LoadConfig(4.0, 40.0, 60.0, hand_interval=0.05, trunk_interval=0.05), "episode_steps": 4},
    {"terrain": TerrainConfig(roughness=0.02, start_level=3), "randomization": LATE},
]
EVALUATE = {"evaluation_steps": 128, "evaluation_robots": 8, "evaluation_seconds": 0.1}


def run(settings: TrainConfig) -> Trainer:
    return train(settings, lambda row, gates: None)


def test_resumed_run_equals_an_uninterrupted_one(tmp_path: pathlib.Path) -> None:
    averaged = {"average_steps": 256.0}
    straight = run(config(tmp_path / "a", 6, **averaged))
    # Evaluations in between must leave no trace.
    run(config(tmp_path / "b", 3, **averaged, **EVALUATE))
    resumed = run(config(tmp_path / "b", 6, resume=True, **averaged, **EVALUATE))
    assert resumed.iteration == straight.iteration == 6
    for a, b in zip(straight.product.parameters(), resumed.product.parameters(), strict=True):
        assert torch.equal(a, b)
    for (name, a), b in zip(straight.ppo.network.named_parameters(), resumed.ppo.network.parameters(), strict=True):
        assert torch.equal(a, b), name
    assert resumed.env.curriculum.state_dict() == straight.env.curriculum.state_dict()
    assert straight.env.curriculum.alpha > 0.0
    for name, value in straight.env.state_dict().items():
        assert torch.equal(value, resumed.env.state_dict()[name]), name


def test_the_policy_that_is_given_out_is_an_average_over_steps(tmp_path: pathlib.Path) -> None:
    trainer = Trainer(config(tmp_path, 2, average_steps=256.0))
    before = torch.cat([p.detach().flatten() for p in trainer.product.parameters()])
    expected = before
    for _ in range(2):  # of 64 steps each
        trainer.iterate()
        expected = 0.75 * expected + 0.25 * torch.cat([p.detach().flatten() for p in trainer.ppo.network.parameters()])
    product = torch.cat([p.detach().flatten() for p in trainer.product.parameters()])
    assert torch.allclose(product, expected, atol=1e-6) and not torch.allclose(product, before, atol=1e-4)
    trainer.save()
    continued = Trainer(config(tmp_path / "next", 3, start_from=tmp_path / SNAPSHOT_FILE))
    weights = zip(continued.ppo.network.actor.parameters(), trainer.product.actor.parameters(), strict=True)
    assert all(torch.equal(a, b) for a, b in weights)


def test_the_level_of_the_ground_is_in_every_row_of_a_log(tmp_path: pathlib.Path) -> None:
    env = dataclasses.replace(ENV, terrain=TerrainConfig(roughness=0.02, start_level=3))
    for iterations in (2, 4):
        run(dataclasses.replace(config(tmp_path, iterations, resume=iterations > 2), env=env))
    rows = list(csv.DictReader((tmp_path / LOG_NAME).open()))
    assert [float(row["terrain_level"]) >= 0.0 for row in rows] == [True] * 4
    assert [path.name for path in tmp_path.glob("metrics*")] == [LOG_NAME]


def test_files_of_a_run(tmp_path: pathlib.Path) -> None:
    run(config(tmp_path, 2))
    rows = list(csv.DictReader((tmp_path / LOG_NAME).open()))
    assert [int(row["iteration"]) for row in rows] == [1, 2]
    assert float(rows[-1]["steps"]) == 128
    session = json.loads((tmp_path / "sessions.jsonl").read_text().splitlines()[0])
    assert {"mujoco", "torch"} <= set(session["versions"])
    assert load_policy(tmp_path).training["steps"] == 128


def test_snapshot_is_small_and_resumable(tmp_path: pathlib.Path) -> None:
    trainer = run(config(tmp_path, 2))
    slim = tmp_path / SNAPSHOT_FILE
    assert slim.stat().st_size < 3e6
    resumed = Trainer(config(tmp_path / "other", 3, start_from=slim))
    assert resumed.iteration == 2
    assert torch.equal(resumed.ppo.network.log_std, trainer.ppo.network.log_std)
    assert resumed.env.curriculum.alpha == trainer.env.curriculum.alpha
    resumed.run(lambda row, gates: None)
    assert resumed.iteration == 5, "steps count from where the run began"


def test_a_snapshot_that_reads_other_terms_is_refused(tmp_path: pathlib.Path) -> None:
    """Terms of equal size would take each other's weights."""

    def reading(folder: str, *names: str, **changes: object) -> TrainConfig:
        env = dataclasses.replace(ENV, observations=names)
        return dataclasses.replace(config(tmp_path / folder, 1, **changes), env=env)

    Trainer(reading("one", "joint_position")).save()
    start = {"start_from": tmp_path / "one" / SNAPSHOT_FILE}
    for names in (("joint_velocity",), ("joint_position", "joint_velocity"), ()):
        with pytest.raises(ConfigError, match=r"reads joint_position besides .*; name the same"):
            Trainer(reading("other", *names, **start))
    assert Trainer(reading("other", "joint_position", **start)).iteration == 0


def test_another_feed_forward_than_that_of_the_start_is_told(tmp_path: pathlib.Path) -> None:
    env = dataclasses.replace(config(tmp_path, 1).env, swing_gain=1.0)
    run(dataclasses.replace(config(tmp_path, 1), env=env))
    told: list[str] = []
    start = {"start_from": tmp_path / SNAPSHOT_FILE}
    train(config(tmp_path / "other", 2, **start), lambda row, gates: None, told.append)
    assert len(told) == 1 and "was trained with --env.swing-gain 1;" in told[0]
    assert Trainer(dataclasses.replace(config(tmp_path / "same", 2, **start), env=env)).remark == ""
    # Of a schedule, the value at the end counts.
    rising = {"schedules": {"env.swing_gain": Schedule({0: 0.0, 64: 0.5})}}
    run(config(tmp_path / "rising", 1, **rising))
    assert Trainer(config(tmp_path / "rising", 2, resume=True, **rising)).remark == ""
    start = {"start_from": tmp_path / "rising" / SNAPSHOT_FILE}
    assert "with --env.swing-gain 0.5;" in Trainer(config(tmp_path / "other", 2, **start)).remark


def test_all_that_changes_how_a_policy_moves_is_told() -> None:
    metadata = {"config": settings_record(TrainConfig()), "steps": 0}
    path = pathlib.Path("mine")
    assert differences(metadata, dataclasses.replace(ENV, ground="soft"), path) == ""
    other = EnvConfig(
        timestep=0.004,
        substeps=5,
        action_scale=0.3,
        yaw_action_factor=1,
        yaw_damping_factor=1,
        waist_rate=0,
        squat_gain=1,
        swing_gain=1,
    )
    said = differences(metadata, other, path)
    moved = metadata | {"curriculum": {"rule.squat_gain": 1.2}}
    assert "with --env.squat-gain 1.2;" in differences(moved, ENV, path), "a rule has moved it"
    assert differences(moved, dataclasses.replace(ENV, squat_gain=1.2), path) == ""
    assert said.count("--env.") == 8 and "--env.substeps 4" in said and "--env.timestep 0.005" in said


def test_best_policy_by_evaluation_is_kept(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scores = iter([3.0, 4.0, 1.0, 2.0, 2.0])
    monkeypatch.setattr(Evaluator, "run", lambda self, actor: {"evaluation/score": next(scores)})
    run(config(tmp_path, 3, **EVALUATE))
    assert load_policy(tmp_path / "best").training["iteration"] == 2
    # The best survives a resumption: 1.0 is better, 2.0 afterwards is not.
    trainer = run(config(tmp_path, 7, resume=True, **EVALUATE))
    assert trainer.best == {"evaluation/score": 1.0, "iteration": 4, "steps": 256}
    best = load_policy(tmp_path / "best").training
    assert best["iteration"] == 4 and best["evaluation"]["evaluation/score"] == 1.0
    assert load_policy(tmp_path).training["iteration"] == 7
    other = Trainer(config(tmp_path / "other", 8, start_from=tmp_path / "best" / SNAPSHOT_FILE))
    assert other.iteration == 4 and other.best == {}


def test_scores_on_other_ground_do_not_compare(tmp_path: pathlib.Path) -> None:
    rough = {"schedules": {"env.terrain.roughness": Schedule({0: 0.0, 192: 0.02}, "steps")}, **EVALUATE}
    assert run(config(tmp_path, 2, **rough)).best
    assert Trainer(config(tmp_path, 2, resume=True, **rough)).best
    assert Trainer(config(tmp_path, 4, resume=True, **rough)).best == {}


def test_a_run_that_is_cut_off_agrees_with_its_best_policy(tmp_path: pathlib.Path, monkeypatch) -> None:
    scores = iter([1.0, 5.0, 3.0])
    monkeypatch.setattr(Evaluator, "run", lambda self, actor: {"evaluation/score": next(scores)})

    def cut_off(row: dict[str, float], gates: dict[str, str]) -> None:
        if row["iteration"] == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(config(tmp_path, 9, **EVALUATE), cut_off)
    resume = config(tmp_path, 4, resume=True, **EVALUATE)
    trainer = Trainer(resume)
    assert trainer.iteration == trainer.best["iteration"] == 2 and trainer.best["evaluation/score"] == 1.0
    shutil.rmtree(tmp_path / "best")
    assert run(resume).best["iteration"] == 4, "any policy is better than none"
    assert load_policy(tmp_path / "best").training["iteration"] == 4


def test_a_training_that_is_over_gives_its_robots_back_at_once(tmp_path: pathlib.Path) -> None:
    """A recipe makes one trainer for each stage: those that wait for the garbage collector fill the memory."""
    gc.disable()
    try:
        trainer = Trainer(config(tmp_path, 1))
        trainer.run(lambda row, gates: None)
        env = weakref.ref(trainer.env)
        del trainer
        assert env() is None
    finally:
        gc.enable()


def test_a_bad_minibatch_is_skipped_and_the_run_goes_on(tmp_path: pathlib.Path) -> None:
    trainer = Trainer(config(tmp_path, 4))
    step = trainer.env.step

    def broken(action: torch.Tensor) -> StepResult:
        result = step(action)
        result.reward[3] = float("nan")
        return result

    weight = next(trainer.ppo.network.actor.parameters())
    before = weight.detach().clone()
    trainer.env.step = broken
    trainer.iterate()
    assert trainer.ppo.skipped == PPO.epochs * PPO.minibatches
    assert torch.equal(weight, before)
    trainer.env.step = step
    row = trainer.iterate()
    assert row["skipped"] == 4 and not torch.equal(weight, before)


def test_a_reward_of_the_users_that_becomes_infinite_is_told(tmp_path: pathlib.Path) -> None:
    mine = torch.ones(ENV.count)
    env = dataclasses.replace(ENV, terms={"mine": RewardTerm(lambda t, body: mine, 1.0)})
    trainer = Trainer(dataclasses.replace(config(tmp_path, 2), env=env))
    trainer.iterate()
    assert "rewards" not in trainer.env.curriculum.gates
    mine[:3] = math.inf
    trainer.iterate()
    assert trainer.env.curriculum.gates["rewards"] == "not finite, counted as 0: 12 of mine", "3 robots, 4 steps"


def test_the_reward_in_the_log_is_what_the_robots_got(tmp_path: pathlib.Path) -> None:
    """The bootstrapped values that follow a time-out are not part of it."""
    trainer = Trainer(config(tmp_path, 1))
    got, step = [], trainer.env.step

    def observed(action: torch.Tensor) -> StepResult:
        trainer.env.age[:] = ENV.episode_steps - 1
        result = step(action)
        assert int(result.truncated.sum()) > 8
        got.append(result.reward.clone())
        return result

    trainer.env.step = observed
    torch.nn.init.constant_(list(trainer.ppo.network.critic.parameters())[-1], 50.0)
    assert trainer.iterate()["reward"] == pytest.approx(float(torch.stack(got).mean()))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_run_after_its_iteration_with_a_checkpoint(tmp_path: pathlib.Path, number: int) -> None:
    handler = signal.getsignal(number)
    trainer = train(config(tmp_path, 9), lambda row, gates: os.kill(os.getpid(), number))
    assert trainer.iteration == 1 and signal.getsignal(number) is handler
    assert Trainer(config(tmp_path, 9, resume=True)).iteration == 1


def test_a_run_ends_when_its_time_is_over(tmp_path: pathlib.Path) -> None:
    assert run(config(tmp_path, 9, hours=1e-9)).iteration == 0
    assert (tmp_path / CHECKPOINT_NAME).exists()


def test_the_progress_is_that_of_the_session_by_steps_or_by_hours(tmp_path, monkeypatch):
    seen: list[float] = []
    train(config(tmp_path, 2), lambda row, gates: seen.append(row["progress"]))
    train(config(tmp_path, 4, resume=True), lambda row, gates: seen.append(row["progress"]))
    assert seen == [0.5, 1.0, 0.5, 1.0]
    seconds = itertools.count()
    monkeypatch.setattr("hugwbc.learned.rl.trainer.time.monotonic", lambda: float(next(seconds)))
    train(config(tmp_path, 999, resume=True, hours=40 / 3600), lambda row, gates: seen.append(row["progress"]))
    assert seen[4] > 2 / 40 and seen[4:] == sorted(seen[4:]) and seen[-1] > 0.8


def test_the_critic_learns_alone_at_first_if_asked(tmp_path: pathlib.Path) -> None:
    trainer = Trainer(config(tmp_path, 9, critic_warm_up=1))
    moved = []
    for _ in range(2):
        before = {name: value.clone() for name, value in trainer.ppo.network.state_dict().items()}
        trainer.iterate()
        after = trainer.ppo.network.state_dict()
        moved.append({name.split(".")[0] for name, value in before.items() if not torch.equal(after[name], value)})
    # The schedule bounds the exploration std all the while.
    assert moved == [{"critic", "log_std"}, {"actor", "critic", "log_std"}]


@pytest.mark.parametrize("changes", SETTINGS)
def test_curricula_ground_latency_and_hops_are_resumed_bit_for_bit(tmp_path: pathlib.Path, changes: dict) -> None:
    mixed = dataclasses.replace(ENV.command, resample_steps=3, hopping_fraction=0.2)
    env = dataclasses.replace(ENV, command=mixed, flip_probability=0.2, **{"episode_steps": 10, **changes})

    def go(folder: str, iterations: int, *, resume: bool = False) -> Trainer:
        return run(dataclasses.replace(config(tmp_path / folder, iterations, resume=resume), env=env))

    straight = go("a", 4)
    go("b", 1)
    go("b", 3, resume=True)
    resumed = go("b", 4, resume=True).env.state_dict()
    for name, value in straight.env.state_dict().items():
        assert torch.equal(value, resumed[name]), name


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_training_without_a_gpu_says_what_is_missing(tmp_path: pathlib.Path) -> None:
    with pytest.raises(ConfigError, match="--device cpu"):
        Trainer(config(tmp_path, 1, device="cuda"))


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    """The folder of a run of one iteration."""
    folder = tmp_path_factory.mktemp("finished")
    run(config(folder, 1))
    return folder


def test_another_number_of_robots_is_refused(finished: pathlib.Path, tmp_path: pathlib.Path) -> None:
    start = config(tmp_path, 2, start_from=finished / CHECKPOINT_NAME)
    other = dataclasses.replace(start, env=dataclasses.replace(ENV, count=8))
    with pytest.raises(PolicyFileError, match=r"--env\.count 16"):
        Trainer(other)


def test_a_run_that_starts_from_a_checkpoint_has_the_draws_of_its_own_seed(finished, tmp_path: pathlib.Path) -> None:
    start = config(tmp_path, 2, start_from=finished / CHECKPOINT_NAME)
    one, other = (Trainer(dataclasses.replace(start, seed=seed)) for seed in (2001, 2002))
    assert torch.equal(one.env.simulation.qpos, other.env.simulation.qpos)
    assert not torch.equal(one.env.generator.get_state(), other.env.generator.get_state())
    assert not torch.equal(one.generator.get_state(), other.generator.get_state())
    again = Trainer(dataclasses.replace(start, seed=2001))
    assert again.iterate()["reward"] == one.iterate()["reward"] != other.iterate()["reward"]


def test_a_run_is_resumed_with_its_own_settings(finished: pathlib.Path) -> None:
    same = config(finished, 2, resume=True)
    assert Trainer(dataclasses.replace(same, threads=2, save_interval=7)).iteration == 1
    rewards = dataclasses.replace(ENV.rewards, feet_slip=-0.5)
    for change in ({"seed": 2009}, {"env": dataclasses.replace(ENV, rewards=rewards, squat_gain=0.5)}):
        with pytest.raises(ConfigError, match=r"seed|env\.squat_gain .*env\.rewards\.feet_slip"):
            Trainer(dataclasses.replace(same, **change))
    with pytest.raises(ConfigError, match=r"schedules\.ppo\.lam\.shape nothing \(here steps\)"):
        Trainer(dataclasses.replace(same, schedules={"ppo.lam": Schedule({0: 0.9}, "steps")}))


@pytest.mark.parametrize(
    ("tensors", "entries", "message"),
    [
        ({}, {"iteration": None}, "lacks a readable"),
        ({}, {"seconds": "soon"}, "lacks a readable"),
        ({}, {"curriculum": None}, "lacks a readable 'curriculum'"),
        ({"env.qpos": torch.zeros(16, 25)}, {}, "Continue from its snapshot"),
        ({"memory.rows": torch.zeros(1)}, {}, "odd holds 'memory'"),
    ],
)
def test_a_file_of_another_state_is_refused(tmp_path: pathlib.Path, finished, tensors, entries, message) -> None:
    """A checkpoint, or the snapshot where the message is of one."""
    snapshot = "curriculum" in message or "odd" in message
    path = tmp_path / ("odd" if snapshot else CHECKPOINT_NAME)
    old, metadata = checkpoint.load_file(finished / (SNAPSHOT_FILE if snapshot else CHECKPOINT_NAME), "checkpoint")
    kept = {name: value for name, value in (metadata | entries).items() if value is not None}
    checkpoint.save_file(path, old | tensors, "checkpoint", kept)
    with pytest.raises(PolicyFileError, match=message):
        Trainer(config(tmp_path, 2, **({"start_from": path} if snapshot else {"resume": True})))


def test_schedules_begin_with_the_run_and_survive_a_resumption(tmp_path: pathlib.Path) -> None:
    """Ground that becomes rough in the middle needs new robots, which go on where the others were."""
    run(config(tmp_path / "start", 3))
    start = tmp_path / "start" / SNAPSHOT_FILE
    schedules = {
        "env.terrain.roughness": Schedule({0: 0.0, 128: 0.02}, "steps"),
        "env.command.hopping_fraction": Schedule({0: 0.0, 64: 0.2}, "steps"),
        "ppo.std_limit": Schedule({0: 0.5, 256: 0.3}, "geometric"),
    }

    def go(folder: str, iterations: int, *, resume: bool = False) -> Trainer:
        first = {"resume": True} if resume else {"start_from": start}
        return run(config(tmp_path / folder, iterations, schedules=schedules, **first))

    straight = go("a", 4)
    assert straight.iteration == 7 and straight.run_steps == 256 and straight.env.ground is not None
    assert float(straight.ppo.network.exploration().exp().max()) < 0.36
    go("b", 1)
    go("b", 2, resume=True)
    resumed = go("b", 4, resume=True)
    for name, value in straight.env.state_dict().items():
        assert torch.equal(value, resumed.env.state_dict()[name]), name


def test_a_run_does_not_go_on_with_another_robot(tmp_path: pathlib.Path) -> None:
    """Of the same name, whose table has changed meanwhile."""
    run(config(tmp_path, 1))
    tensors, metadata = checkpoint.load_file(tmp_path / CHECKPOINT_NAME, "checkpoint")
    checkpoint.save_file(tmp_path / CHECKPOINT_NAME, tensors, "checkpoint", metadata | {"robot": "0123"})
    with pytest.raises(ConfigError, match="another content of the table of h1"):
        Trainer(config(tmp_path, 2, resume=True))
