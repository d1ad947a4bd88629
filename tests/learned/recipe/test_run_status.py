import json
import pathlib
import shutil

import pytest

from hugwbc.errors import RecipeError
from hugwbc.learned.recipe.run_status import status_of


def test_the_status_of_a_finished_run(finished: pathlib.Path) -> None:
    status = status_of(finished)
    assert [stage.state for stage in status.stages] == ["finished"] * 6
    assert status.left == "finished" and status.sessions == 1 and status.newest.endswith("finished")
    gaits = status.stages[1]
    assert gaits.spent.steps == 192 and status.spent.steps == 192 and status.spent.core_hours > 0.0


def test_the_status_of_a_run_in_the_middle(finished: pathlib.Path) -> None:
    shutil.rmtree(finished / "stages" / "policy")
    (finished / "stages" / "merged" / "record.json").unlink()
    session = finished / "sessions" / "0001.json"
    session.write_text(json.dumps(json.loads(session.read_text()) | {"ended": None}))
    status = status_of(finished)
    states = {stage.name: stage.state for stage in status.stages}
    assert states["merged"] == "begun" and states["policy"] == "waits"
    assert "merged (100 %)" in status.left and "policy (0 %)" in status.left
    assert "runs, or was killed" in status.newest
    assert "core-hours" in status.left
    (finished / "plan.json").unlink()
    assert "core-hours" not in status_of(finished).left


def test_a_folder_without_a_run_is_refused(tmp_path: pathlib.Path) -> None:
    with pytest.raises(RecipeError, match="holds no run of a recipe"):
        status_of(tmp_path)


def test_a_damaged_recipe_of_a_run_is_refused(finished: pathlib.Path) -> None:
    (finished / "recipe.json").write_text("{}")
    with pytest.raises(RecipeError, match=r"recipe\.json is damaged"):
        status_of(finished)
