"""Checks of a recipe as a whole: where inputs come from, and settings at every measurement and level."""

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from hugwbc.errors import HugwbcError, UnknownNameError
from hugwbc.learned.config import TrainConfig
from hugwbc.learned.recipe.recipe_reader import Draft, Table
from hugwbc.learned.recipe.recipe_records import KINDS, Stage, usual_file


def check(draft: Draft, mistakes: list[str], check_table: Callable[[Table], None]) -> None:
    """Note what is wrong with stages as a whole: inputs, and settings at every measurement."""
    earlier: dict[str, Stage] = {}
    for name, stage in draft.stages.items():
        reader, node = draft.nodes[name]
        problems = [*_input_problems(stage, earlier, draft.stages), *_setting_problems(stage)]
        for entry, problem in problems:
            at_reader, at = draft.nodes.get(f"{name}/{entry}", (reader, node))
            at_reader.note(at, f"stage {name}: {problem}")
        if stage.kind == "evaluate" and not stage.tables:
            reader.note(node, f"stage {name} has no tables; give a list of protocols under tables")
        for index, table in enumerate(stage.tables):
            at_reader, at = draft.nodes.get(f"{name}/table {index}", (reader, node))
            at_reader.attempt(lambda r=at_reader, at=at, table=table: r.checked(at, check_table, table))
        if stage.if_given_up == "skip" and "start_from" not in stage.inputs:
            reader.note(node, f"stage {name} starts from nothing: if it is given up there is nothing to pass on; "
                              "use if_given_up: fail or best")  # fmt: skip
        earlier[name] = stage


def _input_problems(
    stage: Stage, earlier: Mapping[str, Stage], every: Mapping[str, Stage]
) -> Iterator[tuple[str, object]]:
    for name in KINDS[stage.kind].required:
        if name not in stage.inputs:
            yield "inputs", f"the input '{name}' is missing; give inputs: {{{name}: STAGE}}"
    for name, source in stage.inputs.items():
        parent, _, file = source.partition("/")
        if parent not in earlier:
            later = "comes later; move it before this one" if parent in every else None
            yield "inputs", f"'{parent}' {later}" if later else UnknownNameError("stage", parent, earlier)
        elif (file or usual_file(name, earlier[parent])) not in KINDS[earlier[parent].kind].outputs:
            outputs = ", ".join(KINDS[earlier[parent].kind].outputs)
            yield (
                "inputs",
                f"input '{name}': {parent} does not write {file or usual_file(name, earlier[parent])}; {outputs}",
            )


def _setting_problems(stage: Stage) -> Iterator[tuple[str, object]]:
    """Yield what the settings refuse, at every measurement and every level of a gated schedule."""
    seen: set[str] = set()
    highest = max([len(s.values) for s in stage.schedules.values() if s.shape == "gated"], default=1)
    trials: list[tuple[float, int, Mapping[str, Any]]] = [
        (stage.progress_of(segment), level, {})
        for segment in range(min(stage.segments, 200))
        for level in range(highest)
    ]
    trials += [(0.0, 0, gate.change) for gate in stage.gates if gate.change]
    for progress, level, changes in trials:
        try:
            config = stage.config(progress, levels=dict.fromkeys(stage.schedules, level), changes=changes)
            if isinstance(config, TrainConfig):
                dataclasses.replace(config, schedules=stage.smooth_schedules(0.0, without=changes))
        except HugwbcError as error:
            if str(error) not in seen:
                seen.add(str(error))
                yield "gates" if changes else _named_in(str(error), [*stage.schedules, *stage.settings]), error
            continue
        if isinstance(config, TrainConfig) and "every" not in seen:
            iteration, every = config.ppo.horizon * config.env.count, stage.work / stage.segments
            if every < iteration:
                seen.add("every")
                yield (
                    "every",
                    f"{every:g} steps between two measurements; an iteration alone has {iteration}. Give more",
                )
    if "env.count" in stage.schedules:
        yield "env.count", "the number of robots cannot change within a stage; make two stages of it"
    if stage.segments > 10_000:
        yield "every", f"{stage.segments} measurements; give a larger 'every'"


def _named_in(message: str, names: list[str]) -> str:
    """Return the setting that a message is about, by its last word; empty if none is found."""
    head = message.partition("=")[0]
    return next((name for name in names if name.rpartition(".")[2] in head), "")
