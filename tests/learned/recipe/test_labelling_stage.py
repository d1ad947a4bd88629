import pathlib
from collections.abc import Callable
from typing import Any

import pytest
import torch

from hugwbc.learned.imitation.dagger import Memory
from hugwbc.learned.policy import checkpoint
from hugwbc.learned.policy.observations import COMMAND_SIZE, Observation
from hugwbc.learned.recipe import labelling_stage
from hugwbc.learned.recipe.recipe_records import Recipe
from hugwbc.learned.recipe.recipe_run import RunOptions, run_recipe
from hugwbc.learned.recipe.run_folder import RunFolder


def fill(memory: Memory, numbers: range) -> None:
    for i in numbers:
        value = torch.full((3,), float(i))
        observation = Observation(
            history=value[:, None].expand(3, 315), command=value[:, None].expand(3, COMMAND_SIZE),
            critic=value[:, None], estimate=value[:, None].expand(3, 6),
        )  # fmt: skip
        memory.add(observation, value[:, None].expand(3, 19), torch.ones(3, 19))


def test_a_memory_is_put_back_where_it_was() -> None:
    """Of nine additions of three samples, a memory of ten keeps the last ones; so does the restored one."""
    whole, parts = Memory(10, torch.Generator().manual_seed(1)), []
    for numbers in (range(3), range(3, 6), range(6, 9)):
        fill(whole, numbers)
        parts.append(whole.newest(9))
    restored = Memory(10, torch.Generator().manual_seed(1))
    restored.restore(parts, 0)
    a, b = whole.sample(64), restored.sample(64)
    assert all(torch.equal(a[name], b[name]) for name in a)
    assert whole.size == restored.size == 10


def test_dropped_labels_leave_the_places_of_the_others_as_they_were() -> None:
    whole = Memory(10, torch.Generator().manual_seed(1))
    fill(whole, range(4))
    fill(whole, range(4, 8))
    part = whole.newest(12)  # of which the memory still has ten
    restored = Memory(10, torch.Generator().manual_seed(1))
    restored.restore([part], 24 - 10)
    fill(whole, range(8, 10))
    fill(restored, range(8, 10))
    a, b = whole.sample(64), restored.sample(64)
    assert all(torch.equal(a[name], b[name]) for name in a)


def test_newest_samples_come_oldest_first() -> None:
    memory = Memory(10, torch.Generator())
    fill(memory, range(5))
    assert memory.newest(6)["action"][:, 0].tolist() == [3.0] * 3 + [4.0] * 3
    assert len(memory.newest(99)["action"]) == 10


@pytest.mark.parametrize("stage", ["labels", "merged"])
def test_legs_that_were_interrupted_make_the_same_network(
    tmp_path: pathlib.Path,
    finished: pathlib.Path,
    make_recipe: Callable[..., Recipe],
    services: Any,
    monkeypatch: pytest.MonkeyPatch,
    stage: str,
) -> None:
    """Also with the memory of `merged`, which is too small for all labels."""
    recipe, folder = make_recipe(), RunFolder(finished)
    before = checkpoint.load_file(folder.stage(stage) / "snapshot.safetensors", "checkpoint")[0]
    write = labelling_stage.write_state
    calls: list[int] = []

    def interrupt(path: pathlib.Path, state: Any) -> None:
        write(path, state)
        calls.append(state["labels"])
        if path.name == stage and len(calls) == 1:
            raise KeyboardInterrupt

    monkeypatch.setattr(labelling_stage, "write_state", interrupt)
    with pytest.raises(KeyboardInterrupt):
        run_recipe(recipe, RunOptions(finished, redo=(stage,)), services)
    assert (folder.stage(stage) / "leg.safetensors").exists()
    assert run_recipe(recipe, RunOptions(finished), services)
    assert calls[0] < calls[1]
    after = checkpoint.load_file(folder.stage(stage) / "snapshot.safetensors", "checkpoint")[0]
    assert all(torch.equal(before[name], after[name]) for name in before)
    assert not list(folder.stage(stage).glob("leg*"))
