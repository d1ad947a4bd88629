"""The difference of two recipes, or of two runs, setting by setting."""

import json
import pathlib
from collections.abc import Iterator, Mapping
from typing import Any

from hugwbc.learned.recipe.dotted import flat
from hugwbc.learned.recipe.recipe_file import load_recipe
from hugwbc.learned.recipe.recipe_records import KINDS
from hugwbc.learned.recipe.run_folder import RunFolder

Row = tuple[str, str, str]  # what, in the first, in the second
ABSENT = "-"


def content_of(name_or_path: str, profile: str | None = None) -> tuple[dict[str, Any], RunFolder | None]:
    """Return what a recipe says, and the folder of its run if that is what was named.

    Raises:
        HugwbcError: if there is neither a recipe nor a run of that name, or the recipe has mistakes.
    """
    folder = RunFolder(pathlib.Path(name_or_path))
    if folder.stored():
        return folder.stored()["recipe"], folder
    return load_recipe(name_or_path, profile=profile).as_dict(), None


def recipe_rows(first: Mapping[str, Any], second: Mapping[str, Any]) -> list[Row]:
    """Return the settings in which two recipes differ."""
    a, b = dict(_flat(first)), dict(_flat(second))
    usual = {**_defaults(first), **_defaults(second)}

    def shown(one: Mapping[str, str], name: str) -> str:
        return one.get(name) or usual.get(name, ABSENT)

    rows = [(name, shown(a, name), shown(b, name)) for name in dict.fromkeys([*a, *b])]
    return [row for row in rows if row[1] != row[2]]


def _defaults(content: Mapping[str, Any]) -> dict[str, str]:
    """Return the default of each setting of each stage, under the names of `_flat`; without those that are refused."""
    found = {}
    for stage in content["stages"]:
        kind = KINDS.get(stage["kind"])
        if kind is not None and stage["kind"] != "distil":  # whose defaults lack teachers
            for setting, value in flat(kind.settings()).items():
                found[f"{stage['name']}: {setting}"] = _text(json.loads(json.dumps(value, default=str)))
    return found


def _flat(content: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    for key in ("seed", "measure", "profile"):
        yield key, _text(content[key])
    for stage in content["stages"]:
        name = stage["name"]
        yield f"{name}", str(stage["kind"])
        for key in ("every", "score", "keep", "if_given_up"):
            yield f"{name}: {key}", _text(stage[key])
        for group in ("inputs", "settings"):
            for setting, value in stage[group].items():
                yield f"{name}: {setting}", _text(value)
        for setting, schedule in stage["schedules"].items():
            shown = {key: value for key, value in schedule.items() if value}
            yield f"{name}: {setting} (schedule)", _text(shown)
        for number, gate in enumerate(stage["gates"], 1):
            yield f"{name}: gate {number}", _text(gate)
        for number, table in enumerate(stage["tables"], 1):
            yield f"{name}: table {number}", _text(table)


def _text(value: Any) -> str:  # noqa: ANN401  whatever JSON holds
    return value if isinstance(value, str) else json.dumps(value)


def run_rows(first: RunFolder, second: RunFolder) -> list[Row]:
    """Return in what the stages of two runs came to differ: outcome, steps, labels, core-hours, figures."""
    a, b = (dict(_of_run(folder)) for folder in (first, second))
    names = dict.fromkeys([*a, *b])
    return [(name, a.get(name, ABSENT), b.get(name, ABSENT)) for name in names if a.get(name) != b.get(name)]


def _of_run(folder: RunFolder) -> Iterator[tuple[str, str]]:
    for name, record in folder.records().items():
        yield f"{name}: outcome", record.outcome
        yield f"{name}: steps", f"{record.steps:.4g}"
        yield f"{name}: labels", f"{record.labels:.4g}"
        yield f"{name}: core-hours", f"{record.spent.core_hours:.3f}"
        yield f"{name}: commit", ", ".join(commit[:10] for commit in record.commits)
        for figure, value in sorted(record.figures.items()):
            if figure.startswith("evaluation/") or record.kind in ("evaluate", "calibrate"):
                yield f"{name}: {figure}", f"{value:.4f}"
