import dataclasses
import functools
import json
import math
import pathlib
from collections.abc import Callable
from typing import Any

import pytest
import torch

from hugwbc.errors import RecipeError
from hugwbc.learned.policy import checkpoint
from hugwbc.learned.recipe import training_stage
from hugwbc.learned.recipe.recipe_file import load_recipe
from hugwbc.learned.recipe.recipe_records import Recipe
from hugwbc.learned.recipe.recipe_run import RunOptions, run_recipe
from hugwbc.learned.recipe.run_folder import RunFolder
from hugwbc.learned.recipe.training_stage import log_means
from hugwbc.learned.rl.evaluator import Evaluator
from hugwbc.learned.rl.trainer import Trainer
from tests.learned.recipe.conftest import FakeServices

ALONE = """
seed: 2001
measure: {robots: 4, seconds: 0.1}
stages:
  warm:
    kind: train
    every: 32
    settings: {threads: 1, env.count: 8, steps: 32, ppo.horizon: 4, ppo.minibatches: 1, ppo.epochs: 1}
  gaits:
    kind: train
    inputs: {start_from: warm}
    every: 32
    settings: {threads: 1, env.count: 8, steps: 192, ppo.horizon: 4, ppo.minibatches: 1, ppo.epochs: 1}
"""
GAITS = "    settings: {threads: 1, env.count: 8, steps: 192,"


def alone(make_recipe: Callable[..., Recipe], extra: str = "", profile: str | None = None) -> Recipe:
    return make_recipe(ALONE, (GAITS, f"{extra}{GAITS}"), profile=profile)


def fix_scores(patch: pytest.MonkeyPatch, *values: float) -> None:
    left, real = iter(values), Evaluator.run
    patch.setattr(Evaluator, "run", lambda self, actor: real(self, actor) | {"evaluation/score": next(left)})


def record_configs(patch: pytest.MonkeyPatch, configs: list[Any]) -> None:
    class Seen(Trainer):
        def __init__(self, config: Any) -> None:
            configs.append(config)
            super().__init__(config)

    patch.setattr(training_stage, "Trainer", Seen)


@pytest.fixture
def scores(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Return a function that fixes the scores of the measurements; `warm` has the first one."""
    return functools.partial(fix_scores, monkeypatch)


@pytest.fixture
def configs(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Return the settings of every trainer that is made."""
    seen: list[Any] = []
    record_configs(monkeypatch, seen)
    return seen


def run(recipe: Recipe, out: pathlib.Path, services: Any, **more: Any) -> None:
    assert run_recipe(recipe, RunOptions(out), services, **more)


def test_a_schedule_is_read_at_every_segment(
    tmp_path: pathlib.Path, make_recipe: Callable[..., Recipe], services: Any, configs: list[Any]
) -> None:
    run(alone(make_recipe, "    schedules: {ppo.beta: {linear: [0.5, 0.0]}}\n"), tmp_path / "run", services)
    mine = [config for config in configs if "gaits" in str(config.out)]
    betas = [config.ppo.beta for config in mine]
    assert betas == pytest.approx([0.5, 0.4, 0.3, 0.2, 0.1, 0.0])
    # Between measurements the trainer follows the ramp by itself.
    assert mine[0].at(32 + 96).ppo.beta == pytest.approx(0.25)
    # Steps are counted on from the snapshot that the stage started from.
    assert [config.steps for config in configs] == [32, 64, 96, 128, 160, 192, 224]


def test_a_policy_is_measured_with_the_squats_that_it_has_learned_with(
    tmp_path: pathlib.Path, make_recipe: Callable[..., Recipe], services: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    gains, real = [], Evaluator.run

    def noted(self: Evaluator, actor: Any) -> dict[str, float]:
        gains.append(self._env.config.squat_gain)
        return real(self, actor)

    monkeypatch.setattr(Evaluator, "run", noted)
    run(alone(make_recipe, "    schedules: {env.squat_gain: {steps: {0: 0, 0.5: 1}}}\n"), tmp_path / "run", services)
    _, *gaits = gains
    assert gaits == [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]


def test_a_gated_schedule_moves_on_with_the_figures(
    tmp_path: pathlib.Path,
    make_recipe: Callable[..., Recipe],
    services: Any,
    configs: list[Any],
    scores: Callable[..., None],
) -> None:
    scores(9.0, 9.0, 1.0, 9.0, 1.0, 1.0, 1.0)
    gated = "    schedules: {ppo.beta: {gated: [0.5, 0.25, 0.125], when: {evaluation/score: below 2}}}\n"
    run(alone(make_recipe, gated), tmp_path / "run", services)
    assert [config.ppo.beta for config in configs if "gaits" in str(config.out)] == [0.5, 0.5, 0.25, 0.25, 0.125, 0.125]


def test_a_gate_ends_a_stage_and_its_best_checkpoint_goes_on(
    tmp_path: pathlib.Path, make_recipe: Callable[..., Recipe], services: Any, scores: Callable[..., None]
) -> None:
    scores(9.0, 3.0, 1.5, 1.8)
    gate = "    gates: [{do: next, when: {evaluation/score: below 2}, times: 2}]\n"
    run(alone(make_recipe, gate), tmp_path / "run", services)
    record = RunFolder(tmp_path / "run").records()["gaits"]
    assert (record.outcome, record.steps, record.spent.steps) == ("finished", 64, 96)
    assert [(one.reason, one.steps) for one in record.discarded] == [("after the best checkpoint", 32)]
    _, metadata = checkpoint.load_file(tmp_path / "run" / "stages" / "gaits" / "snapshot.safetensors", "checkpoint")
    assert metadata["steps"] == 32 + 64


def test_the_last_checkpoint_goes_on_if_the_recipe_says_so(
    tmp_path: pathlib.Path, make_recipe: Callable[..., Recipe], services: Any, scores: Callable[..., None]
) -> None:
    scores(9.0, *range(1, 7))
    run(alone(make_recipe, "    keep: last\n"), tmp_path / "run", services)
    record = RunFolder(tmp_path / "run").records()["gaits"]
    assert (record.steps, record.discarded) == (192, ())


BACK = """    gates: [{do: back, when: {evaluation/score: above 2 best}, times: 2, at_most: 1,
            change: {ppo.target_kl: times 0.5, ppo.entropy_weight: 0}}]
"""


@dataclasses.dataclass
class Returned:
    """A run whose training goes back to its best checkpoint, that after 64 steps, and then on to the end."""

    folder: RunFolder
    lines: list[str]
    configs: list[Any]
    starts: list[tuple[Any, Any]]  # what a branch started from, and as what


@pytest.fixture(scope="module")
def returned(tmp_path_factory: pytest.TempPathFactory) -> Returned:
    """Return one run for all tests that only read it."""
    folder = tmp_path_factory.mktemp("returned")
    (folder / "tiny.yaml").write_text(ALONE.replace(GAITS, f"{BACK}{GAITS}"))
    out = Returned(RunFolder(folder / "run"), [], [], [])
    write = training_stage._write_start

    def seen(source: pathlib.Path, target: pathlib.Path) -> None:
        write(source, target)
        out.starts.append((checkpoint.load_file(source, "checkpoint"), checkpoint.load_file(target, "checkpoint")))

    torch.set_num_threads(1)
    with pytest.MonkeyPatch.context() as patch:
        fix_scores(patch, 9.0, 2.0, 1.0, 5.0, 6.0, 1.2, 0.9, 0.8, 0.7)  # worse after 96 and 128 steps
        record_configs(patch, out.configs)
        patch.setattr(training_stage, "_write_start", seen)
        run(load_recipe(folder / "tiny.yaml"), folder / "run", FakeServices(), say=out.lines.append)
    return out


def test_a_return_to_the_best_checkpoint_is_another_branch_and_is_counted(returned: Returned) -> None:
    record = returned.folder.records()["gaits"]
    assert record.steps == 192 and record.spent.steps == 192 + 64
    (discarded,) = record.discarded
    assert discarded.steps == 64 and "evaluation/score > 2 best in 2 measurements" in discarded.reason
    assert record.seeds == (2001, 2002)
    branch = [config for config in returned.configs if "branch-1" in str(config.out)]
    assert [config.steps - 32 for config in branch] == [96, 128, 160, 192]
    assert {(config.seed, config.ppo.target_kl, config.ppo.entropy_weight) for config in branch} == {(2002, 0.01, 0.0)}
    assert any("back to 64 steps" in line for line in returned.lines)


def test_the_branch_starts_from_the_best_network_with_robots_of_its_own(returned: Returned) -> None:
    ((best, best_record), (start, start_record)) = returned.starts[0]
    assert best_record == start_record and best_record["steps"] == 32 + 64
    assert all(torch.equal(best[name], tensor) for name, tensor in start.items())
    assert any(name.startswith("optimiser.") for name in start)
    assert not any(name.startswith("env.") or name == "generator" for name in start)


def test_too_many_returns_give_a_stage_up(
    tmp_path: pathlib.Path, make_recipe: Callable[..., Recipe], services: Any, scores: Callable[..., None]
) -> None:
    scores(9.0, 1.0, 5.0, 6.0, 7.0, 8.0)
    with pytest.raises(RecipeError, match=r"given up after 1 returns.*score 1.* is in .*best.*--redo changed"):
        run(alone(make_recipe, BACK), tmp_path / "run", services)
    best = tmp_path / "run" / "stages" / "gaits" / "best"
    assert (best / "policy.safetensors").exists()
    # The same command says the same, without training.
    with pytest.raises(RecipeError, match="given up after 1 returns"):
        run(alone(make_recipe, BACK), tmp_path / "run", services)


def test_a_return_takes_gated_schedules_back_as_well(
    tmp_path: pathlib.Path,
    make_recipe: Callable[..., Recipe],
    services: Any,
    configs: list[Any],
    scores: Callable[..., None],
) -> None:
    # The level rises after the second measurement, which is the best; then it gets worse, and back.
    scores(9.0, 4.0, 1.5, 1.9, 6.0, 6.0, 1.9, 1.9, 1.9, 1.9)
    gated = "    schedules: {ppo.beta: {gated: [0.5, 0.25, 0.125], when: {evaluation/score: below 2}}}\n"
    run(alone(make_recipe, gated + BACK), tmp_path / "run", services)
    branches = [[c.ppo.beta for c in configs if f"gaits/branch-{i}" in str(c.out)] for i in (0, 1)]
    assert branches == [[0.5, 0.5, 0.25, 0.125, 0.125], [0.5, 0.25, 0.125, 0.125]]


@pytest.mark.parametrize("choice", ["skip", "best"])
def test_a_stage_that_is_given_up_can_be_skipped_or_end_with_its_best(
    tmp_path: pathlib.Path, make_recipe: Callable[..., Recipe], services: Any, scores: Callable[..., None], choice: str
) -> None:
    scores(9.0, 3.0, 2.0, 8.0)
    extra = f"    if_given_up: {choice}\n    gates: [{{do: stop, when: {{evaluation/score: above 5}}}}]\n"
    run(alone(make_recipe, extra), tmp_path / "run", services)
    records = RunFolder(tmp_path / "run").records()
    record = records["gaits"]
    stages = tmp_path / "run" / "stages"
    mine, before = (
        checkpoint.load_file(stages / name / "snapshot.safetensors", "checkpoint")[0] for name in ("gaits", "warm")
    )
    same = all(torch.equal(before[name], mine[name]) for name in before)
    if choice == "skip":
        assert record.outcome == "skipped" and same and record.steps == 0
        assert (stages / "gaits" / "policy.safetensors").exists()
    else:
        assert record.outcome == "kept best" and not same and record.steps == 64
    assert record.spent.steps == 96 and sum(one.steps for one in record.discarded) == 96 - record.steps


def test_a_learner_that_diverges_is_given_up_with_its_best_checkpoint_kept(
    tmp_path: pathlib.Path, make_recipe: Callable[..., Recipe], services: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    iterate = Trainer.iterate

    def exploding(self: Trainer) -> dict[str, float]:
        row = iterate(self)
        if self.steps > 96:
            with torch.no_grad():
                next(self.ppo.network.critic.parameters()).fill_(math.nan)
        return row

    monkeypatch.setattr(Trainer, "iterate", exploding)
    with pytest.raises(RecipeError, match=r"the learner diverged: its network is not finite.*lower learning rate"):
        run(alone(make_recipe), tmp_path / "run", services)
    network, _ = checkpoint.load_file(
        tmp_path / "run" / "stages" / "gaits" / "best" / "snapshot.safetensors", "checkpoint"
    )
    assert all(bool(torch.isfinite(tensor).all()) for tensor in network.values())


def test_updates_that_are_all_skipped_are_a_divergence(
    tmp_path: pathlib.Path, make_recipe: Callable[..., Recipe], services: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from hugwbc.learned.rl.ppo import PPO

    monkeypatch.setattr(PPO, "_descend", lambda self, loss: False)
    recipe = make_recipe(ALONE, ("every: 32", "every: 96"), ("steps: 32", "steps: 96"))
    with pytest.raises(RecipeError, match=r"warm is given up: the learner diverged: 100 % of its updates"):
        run(recipe, tmp_path / "run", services)


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        ("    score: evaluation/scor\n", r"unknown figure 'evaluation/scor'\. Did you mean 'evaluation/score'"),
        ("    gates: [{do: stop, when: {evaluation/fall: above 1}}]\n", r"Did you mean 'evaluation/falls'"),
        ("    gates: [{do: stop, when: {rewards: below -9}}]\n", r"unknown figure 'rewards'\. Did you mean 'reward'"),
    ],
)
def test_a_figure_that_nobody_measures_is_refused_at_once(
    tmp_path: pathlib.Path, make_recipe: Callable[..., Recipe], services: Any, extra: str, message: str
) -> None:
    with pytest.raises(RecipeError, match=message):
        run(alone(make_recipe, extra), tmp_path / "run", services)
    spent = RunFolder(tmp_path / "run").spent().steps
    assert spent == (64 if "rewards" in extra else 32)  # the training's own figures are known after a segment


def test_the_state_of_another_version_is_refused(
    tmp_path: pathlib.Path, make_recipe: Callable[..., Recipe], services: Any
) -> None:
    recipe = alone(make_recipe)
    run(dataclasses.replace(recipe, stages=recipe.stages[:1]), tmp_path / "run", services)
    place = tmp_path / "run" / "stages" / "warm"
    (place / "record.json").unlink()
    (place / "state.json").write_text(json.dumps({"segment": 1}))
    with pytest.raises(RecipeError, match=r"written by another version.*--redo warm"):
        run(dataclasses.replace(recipe, stages=recipe.stages[:1]), tmp_path / "run", services)


def test_the_critic_learns_alone_at_the_begin_of_the_stage_only(
    tmp_path: pathlib.Path, make_recipe: Callable[..., Recipe], services: Any, configs: list[Any]
) -> None:
    recipe = make_recipe(ALONE, ("steps: 192,", "steps: 192, critic_warm_up: 2,"))
    run(recipe, tmp_path / "run", services)
    assert [config.critic_warm_up for config in configs if "gaits" in str(config.out)] == [2, 1, 0, 0, 0, 0]


def test_means_of_a_log_over_some_iterations(tmp_path: pathlib.Path) -> None:
    (tmp_path / "metrics.csv").write_text(
        "iteration,steps,reward,skipped,kl\n3,9,1.0,0,\n4,12,2.0,1,\n5,15,4.0,3,\n6,18,50.0,9,\n"
    )
    (tmp_path / "metrics-until-2.csv").write_text("iteration,reward\n1,7.0\n2,9.0\n")
    means = log_means(tmp_path, 3, 5)
    assert means["reward"] == 3.0 and means["skipped updates"] == 2.0 and math.isnan(means["kl"])
    assert "steps" not in means
    assert log_means(tmp_path, 1, 2)["reward"] == 9.0
    assert log_means(tmp_path, 6, 6) == {}
