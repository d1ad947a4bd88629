import pathlib
from collections.abc import Callable

from hugwbc.learned.recipe.recipe_difference import content_of, recipe_rows, run_rows
from hugwbc.learned.recipe.recipe_records import Recipe
from hugwbc.learned.recipe.run_folder import RunFolder


def test_the_settings_in_which_two_recipes_differ(make_recipe: Callable[..., Recipe], tiny: str) -> None:
    first = make_recipe().as_dict()
    second = make_recipe(tiny, ("steps: 192", "steps: 192, ppo.gamma: 0.9"), ("seed: 2001", "seed: 2002")).as_dict()
    assert recipe_rows(first, first) == []
    rows = {name: (a, b) for name, a, b in recipe_rows(first, second)}
    assert rows == {"seed": ("2001", "2002"), "gaits: ppo.gamma": ("0.99", "0.9")}


def test_schedules_gates_and_stages_that_are_missing(make_recipe: Callable[..., Recipe], tiny: str) -> None:
    first = make_recipe()
    second = make_recipe(tiny, ("[0.5, 0.1]", "[0.5, 0.2]"), profile="half")
    rows = {name: (a, b) for name, a, b in recipe_rows(first.as_dict(), second.as_dict())}
    assert rows["profile"] == ("", "half") or rows["profile"][1] == "half"
    assert '"values": [0.5, 0.2]' in rows["gaits: ppo.beta (schedule)"][1]
    assert rows["gaits: steps"] == ("192.0", "96.0")


def test_the_shipped_recipes_can_be_compared_by_name() -> None:
    a, run = content_of("h1")
    b, _ = content_of("without-symmetry")
    names = {name for name, _, _ in recipe_rows(a, b)}
    assert run is None and {"gaits: ppo.symmetry", "gaits: steps"} <= names


def test_two_runs_are_compared_by_what_they_came_to(finished: pathlib.Path, tmp_path: pathlib.Path) -> None:
    content, run = content_of(str(finished))
    assert run == RunFolder(finished) and content["name"] == "tiny"
    assert run_rows(run, run) == []
    rows = {name: (a, b) for name, a, b in run_rows(run, RunFolder(tmp_path / "nothing"))}
    assert rows["gaits: outcome"] == ("finished", "-")
    assert rows["figures: single-command walking/E_vx_low"] == ("0.0300", "-")
