import pathlib
import re
from collections.abc import Callable
from typing import Any

import pytest

from hugwbc.errors import RecipeError, UnknownNameError
from hugwbc.learned.recipe.recipe_file import load_recipe
from hugwbc.learned.recipe.recipe_reader import shipped_recipes
from hugwbc.learned.recipe.recipe_records import Recipe, Stage
from hugwbc.learned.recipe.stage_gates import Times

BASE = """seed: 2001
stages:
  warm:
    kind: train
    every: 1e6
    settings:
      steps: 2e6
      ppo.beta: 0.5
  gaits:
    kind: train
    inputs: {start_from: warm}
    every: 1e6
    settings: {steps: 4e6}
    schedules:
      ppo.beta: {linear: [0.5, 0.1]}
    gates:
      - {do: back, when: {evaluation/score: above 2 best}, change: {ppo.target_kl: times 0.5}}
  table:
    kind: evaluate
    inputs: {policy: gaits}
    tables: [{protocol: single-command, gait: walking}]
profiles:
  smoke: {train: {steps: 1e5, every: 5e4}}
"""


def read(tmp_path: pathlib.Path, text: str, **options: Any) -> Recipe:
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    return load_recipe(path, **options)


def test_a_recipe_is_read(tmp_path: pathlib.Path) -> None:
    recipe = read(tmp_path, BASE)
    assert (recipe.name, recipe.seed) == ("mine", 2001)
    warm, gaits, table = recipe.stages
    assert warm.config().ppo.beta == 0.5 and warm.segments == 2
    assert gaits.inputs == {"start_from": "warm"} and gaits.parents() == ["warm"]
    assert gaits.gates[0].change == {"ppo.target_kl": Times(0.5)}
    assert gaits.config(0.5).ppo.beta == pytest.approx(0.3)
    assert gaits.config(changes={"ppo.target_kl": Times(0.5)}).ppo.target_kl == pytest.approx(0.01)
    assert table.tables == ({"protocol": "single-command", "gait": "walking"},)


def test_a_profile_changes_the_stages_that_it_names(tmp_path: pathlib.Path) -> None:
    recipe = read(tmp_path, BASE, profile="smoke")
    assert [stage.work for stage in recipe.stages] == [1e5, 1e5, 0.0] and recipe.profile == "smoke"
    with pytest.raises(UnknownNameError, match=r"unknown profile 'smok'. Did you mean 'smoke'"):
        read(tmp_path, BASE, profile="smok")


def edited(old: str, new: str) -> str:
    assert old in BASE, old
    return BASE.replace(old, new)


MISTAKES = [
    ("ppo.beta: 0.5", "ppo.bta: 0.5", 8, r"unknown setting 'ppo\.bta'\. Did you mean 'ppo\.beta'\?"),
    ("ppo.beta: 0.5", "ppo.beta: much", 8, r"'much' is not a number"),
    ("ppo.beta: 0.5", "ppo.beta: -1", 8, r"stage warm: ppo\.beta = -1\.0; valid: 0 or a positive number"),
    ("ppo.beta: 0.5", "ppo.epochs: 1.5", 8, r"1\.5 is not a whole number"),
    ("ppo.beta: 0.5", "ppo.mixed_precision: 1", 8, r"'1' is neither true nor false"),
    ("ppo.beta: 0.5", "env.intervention: noisy", 8, r"unknown value 'noisy'\. Did you mean 'noise'"),
    ("ppo.beta: 0.5", "env.randomization.gains: [1]", 8, r"expected a list of 2 values, found 1"),
    ("ppo.beta: 0.5", "env.randomization.gains: [1.2, 0.9]", 8, r"randomization\.gains = \(1\.2, 0\.9\)"),
    ("ppo.beta: 0.5", "env.robot: h2", 8, r"stage warm: unknown robot 'h2'"),
    ("ppo.beta: 0.5", "resume: true", 8, r"'resume' is set by the run of the recipe"),
    ("ppo.beta: 0.5", "start_from: x.safetensors", 8, r"'start_from' is a file; name the stage that writes it"),
    ("ppo.beta: 0.5", "env.command.walking_fraction: 0.9", 8, r"stage warm: command\.standing_fraction \+ .*at most 1"),
    ("kind: train\n    every: 1e6\n    settings:", "kind: training\n    settings:", 4, r"of stage 'training'"),
    ("    every: 1e6\n    settings:\n", "    evry: 1\n    settings:\n", 5, r"field 'evry'. Did you mean 'every'"),
    ("    every: 1e6\n    settings:\n", "    every: -1\n    settings:\n", 5, r"every is -1; give a number of steps"),
    ("    every: 1e6\n    settings:\n", "    every: 100\n    settings:\n", 5, r"an iteration alone has [0-9]+"),
    ("seed: 2001", "seed: 3", 1, r"seed = 3; valid: a seed of training, 2000 to 2999"),
    ("seed: 2001", "sed: 2001", 1, r"unknown recipe field 'sed'\. Did you mean 'seed'"),
    ("start_from: warm", "start_from: worm", 11, r"unknown stage 'worm'\. Did you mean 'warm'"),
    ("start_from: warm", "start_from: table", 11, r"'table' comes later; move it before"),
    ("start_from: warm", "start: warm", 11, r"unknown input of a stage of kind train 'start'"),
    ("start_from: warm", "start_from: warm/starts.safetensors", 11, r"warm does not write starts\.safetensors"),
    ("    inputs: {policy: gaits}\n", "", 18, r"the input 'policy' is missing"),
    ("{linear: [0.5, 0.1]}", "{linear: [0.5, -0.1]}", 15, r"stage gaits: ppo\.beta = -0\.1"),
    ("{linear: [0.5, 0.1]}", "{linear: [0.5]}", 15, r"linear has 1 values; give two"),
    ("{linear: [0.5, 0.1]}", "{liner: [0.5, 0.1]}", 15, r"a schedule has one of linear, cosine"),
    ("{linear: [0.5, 0.1]}", "{linear: [0.5, 0.1], until: 1}", 15, r"of shape linear 'until'"),
    ("{linear: [0.5, 0.1]}", "{steps: {0.5: 1}}", 15, r"the first one must be at 0"),
    ("{linear: [0.5, 0.1]}", "{gated: [1, 2], when: {a: soon}}", 15, r"'soon' is not a condition on a; write below"),
    ("ppo.beta: {linear: [0.5, 0.1]}", "env.count: {linear: [512, 1024]}", 15, r"robots cannot change within"),
    ("do: back", "do: stay", 17, r"unknown action of a gate 'stay'\. .*next, back, stop"),
    ("times 0.5", "times half", 17, r"'times half' is not a factor; write times 0\.5"),
    ("ppo.target_kl: times 0.5", "ppo.target_k: times 0.5", 17, r"unknown setting 'ppo\.target_k'"),
    ("ppo.target_kl: times 0.5", "ppo.target_kl: -1", 17, r"ppo\.target_kl = -1"),
    ("above 2 best", "about 2", 17, r"'about 2' is not a condition on evaluation/score; write below 0\.02"),
    ("{protocol: single-command, gait: walking}", "{gait: walking}", 21, r"the table names no protocol"),
    ("    tables: [{protocol: single-command, gait: walking}]\n", "", 18, r"stage table has no tables"),
    ("    tables:", "    gates: []\n    tables:", 21, r"kind train; table is of kind evaluate"),
    ("stages:\n", "stages:\n  a b: {kind: train}\n", 3, r"'a b' cannot be a stage's name"),
    ("seed: 2001", "seed: 2001\nseed: 2002", 2, r"'seed' is given twice in recipe"),
    ("seed: 2001", "settings: {env.robt: h1}", 1, r"unknown setting 'env\.robt'\. Did you mean 'env\.robot'"),
    ("seed: 2001", "settings: {handover: 0.5}", 1, r"no stage of this recipe has the setting 'handover'"),
    ("seed: 2001", "measure: {robots: 0}", 1, r"robots = 0; valid: a positive integer"),
    ("seed: 2001", "rates: {train: -3}", 1, r"train: -3 is not a speed above 0"),
    ("seed: 2001", "parent: h3", 1, r"unknown recipe 'h3'.*h1"),
    ("seed: 2001", "budget: 0", 1, r"budget is 0; give a factor"),
    ("seed: 2001", "without: [wram]", 1, r"unknown stage 'wram'\. Did you mean 'warm'"),
    ("seed: 2001", "changes: {trian: {}}", 1, r"unknown stage 'trian'\. Did you mean 'train'"),
    ("seed: 2001", "changes: {train: {ppo.bta: 0}}", 1, r"unknown setting 'ppo\.bta'"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "line", "message"), MISTAKES, ids=[new[:40] for _, new, _, _ in MISTAKES])
def test_a_mistake_is_reported_with_its_line_and_what_is_valid(
    tmp_path: pathlib.Path, old: str, new: str, line: int, message: str
) -> None:
    with pytest.raises(RecipeError) as caught:
        read(tmp_path, edited(old, new))
    text = str(caught.value)
    assert re.search(message, text), text
    assert re.search(rf"mine\.yaml:{line}:\d+: ", text), text


def test_all_mistakes_are_reported_at_once(tmp_path: pathlib.Path) -> None:
    text = edited("ppo.beta: 0.5", "ppo.bta: 0.5").replace("do: back", "do: bak").replace("start_from: warm", "x: warm")
    with pytest.raises(RecipeError, match=r"3 mistakes in the recipe .*mine\.yaml") as caught:
        read(tmp_path, text)
    assert len(str(caught.value).splitlines()) == 4


def test_a_table_that_cannot_be_run_is_reported_with_its_line(tmp_path: pathlib.Path, services: Any) -> None:
    with pytest.raises(RecipeError, match=r"mine\.yaml:21:25: unknown protocol 'single'"):
        read(tmp_path, edited("protocol: single-command", "protocol: single"), check_table=services.check_table)


@pytest.mark.parametrize(
    "text", ["", "- a\n- b\n", "stages: 3\n", "a: [\n", "? [x]\n: 3\n", "!!python/object:os.system {}\n"]
)
def test_files_that_are_no_recipes_are_refused(tmp_path: pathlib.Path, text: str) -> None:
    with pytest.raises(RecipeError, match=r"mine\.yaml"):
        read(tmp_path, text)


def test_a_name_that_is_no_recipe_lists_those_that_are() -> None:
    with pytest.raises(UnknownNameError, match=r"unknown recipe 'h9'\. .*h1, without-intervention"):
        load_recipe("h9")


def test_a_recipe_that_skips_needs_something_to_pass_on(tmp_path: pathlib.Path) -> None:
    with pytest.raises(RecipeError, match="there is nothing to pass on"):
        read(
            tmp_path,
            edited("    every: 1e6\n    settings:\n", "    every: 1e6\n    if_given_up: skip\n    settings:\n"),
        )


# Differences


def child(tmp_path: pathlib.Path, text: str) -> Recipe:
    (tmp_path / "mine.yaml").write_text(BASE)
    (tmp_path / "other.yaml").write_text(f"parent: mine\n{text}")
    return load_recipe(tmp_path / "other.yaml")


def test_a_child_says_what_differs(tmp_path: pathlib.Path) -> None:
    other = child(tmp_path, "changes: {train: {ppo.beta: 0}, gaits: {steps: 8e6, gates: []}}\nseed: 2009\n")
    assert other.name == "other" and other.seed == 2009
    # A constant replaces the parent's schedule.
    assert [stage.config(1.0).ppo.beta for stage in other.stages[:2]] == [0.0, 0.0]
    assert other.stage("gaits").schedules == {} and other.stage("gaits").gates == ()
    assert [stage.work for stage in other.stages[:2]] == [2e6, 8e6]


def test_a_child_without_a_stage_goes_without_its_results(tmp_path: pathlib.Path) -> None:
    other = child(tmp_path, "without: [warm]\nbudget: 0.5\n")
    assert [stage.name for stage in other.stages] == ["gaits", "table"]
    gaits = other.stage("gaits")
    assert gaits.inputs == {} and gaits.work == 2e6 and gaits.segments == 4


def test_a_mistake_of_a_child_is_in_the_childs_file(tmp_path: pathlib.Path) -> None:
    with pytest.raises(RecipeError, match=r"other\.yaml:2:19: unknown setting 'ppo\.bta'"):
        child(tmp_path, "changes: {train: {ppo.bta: 0}}\n")
    with pytest.raises(RecipeError, match=r"other\.yaml:2:19: stage warm: ppo\.beta = -1"):
        child(tmp_path, "changes: {train: {ppo.beta: -1}}\n")


def test_a_recipe_cannot_be_its_own_ancestor(tmp_path: pathlib.Path) -> None:
    (tmp_path / "a.yaml").write_text("parent: b\n")
    (tmp_path / "b.yaml").write_text("parent: a\n")
    with pytest.raises(RecipeError, match="more than five generations"):
        load_recipe(tmp_path / "a.yaml")


def test_digests_follow_what_is_done_and_not_the_words(tmp_path: pathlib.Path) -> None:
    first = read(tmp_path, BASE)
    worded = read(tmp_path, "about: Other words.\n" + BASE)
    changed = read(tmp_path, edited("[0.5, 0.1]", "[0.5, 0.2]"))
    assert first.digest == worded.digest != changed.digest
    assert first.stage_digest("warm") == changed.stage_digest("warm")
    # What rests on a changed stage has changed as well.
    assert all(first.stage_digest(name) != changed.stage_digest(name) for name in ("gaits", "table"))


# Shipped recipes


def trainings(recipe: Recipe) -> list[Stage]:
    return [stage for stage in recipe.stages if stage.kind == "train"]


def test_all_shipped_recipes_are_valid_in_every_profile() -> None:
    assert {"h1", "without-qp", "without-symmetry", "without-intervention"} <= set(shipped_recipes())
    from hugwbc.evaluation.recipe_services import RecipeServices

    for name in shipped_recipes():
        for profile in (None, "smoke"):
            recipe = load_recipe(name, profile=profile, check_table=RecipeServices().check_table)
            assert recipe.stages[-1].kind == "export"


@pytest.mark.parametrize(
    ("name", "holds"),
    [
        ("without-qp", lambda recipe: all(stage.kind != "imitate" for stage in recipe.stages)),
        (
            "without-symmetry",
            lambda recipe: {s.config().ppo.symmetry for s in recipe.stages if s.kind == "train"} == {"none"},
        ),
        (
            "without-intervention",
            lambda recipe: all(s.config().env.intervention == "none" for s in trainings(recipe)),
        ),
    ],
)
def test_the_ablations_do_what_their_names_say(name: str, holds: Callable[[Recipe], bool]) -> None:
    recipe, whole = load_recipe(name), load_recipe("h1")
    assert holds(recipe) and not holds(whole)
    steps = {stage.name: stage.work for stage in trainings(whole)}
    assert all(stage.work == 0.25 * steps[stage.name] for stage in trainings(recipe))
