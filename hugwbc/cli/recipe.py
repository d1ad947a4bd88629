"""`hugwbc recipe ACTION`: make a policy by a recipe, plan and compare recipes, verify how a policy was made."""

import dataclasses
import os
import pathlib
from collections.abc import Callable, Sequence
from typing import Any

import tyro

from hugwbc.cli.output import output_folder, parse, progress, say, write_json
from hugwbc.errors import RecipeError, UnknownNameError
from hugwbc.evaluation.tables import format_table

NOT_VERIFIED = 1
Name = tyro.conf.Positional[str]


@dataclasses.dataclass(frozen=True)
class RecipeRun:
    """Run a recipe, or go on with its run, until it is finished; Ctrl-C stops, and the same command goes on."""

    recipe: Name
    """Name of a shipped recipe, or path of a recipe file."""
    out: pathlib.Path | None = None
    """Folder of the run; runs/NAME by default."""
    profile: str | None = None
    """Profile of the recipe, such as smoke: every stage in a few seconds."""
    redo: tuple[str, ...] = ()
    """Stages to begin again, with those that take their results; `changed` for all that differ from the recipe."""
    workers: int | None = None
    """Processes that share the episodes of evaluations; by default as the recipe says."""


@dataclasses.dataclass(frozen=True)
class RecipePlan:
    """Check a recipe and say what it would cost: steps, labels and core-hours of every stage. Nothing is run."""

    recipe: Name
    """Name of a shipped recipe, or path of a recipe file."""
    profile: str | None = None
    """Profile of the recipe."""
    measure: bool = False
    """Measure the speed of training and imitation here for some seconds, instead of using recorded speeds."""
    json: pathlib.Path | None = None
    """File to write the plan to; without a path, standard output."""


@dataclasses.dataclass(frozen=True)
class RecipeStatus:
    """Say how far a run is, what it has cost, and what is left."""

    run: Name
    """Folder of the run."""
    json: pathlib.Path | None = None
    """File to write the status to; without a path, standard output."""


@dataclasses.dataclass(frozen=True)
class RecipeDiff:
    """List the settings in which two recipes or two runs differ, and what the runs came to."""

    first: Name
    """Name or path of a recipe, or folder of a run."""
    second: Name
    """The same."""
    json: pathlib.Path | None = None
    """File to write the difference to; without a path, standard output."""


@dataclasses.dataclass(frozen=True)
class RecipeVerify:
    """Check how a policy was made: its chain of stages, from which commit, at which cost. Exit code 1 if it breaks."""

    policy: Name
    """Name of a shipped policy, path of a policy or of its folder, or folder of a run."""
    json: pathlib.Path | None = None
    """File to write the chain to; without a path, standard output."""


def run(words: Sequence[str]) -> int:
    """Run one action.

    Raises:
        UnknownNameError: if there is no such action.
        SystemExit: after printing the list of actions, if that is what was asked for.
    """
    if not words or words[0] in ("-h", "--help"):
        say(_usage())
        raise SystemExit(0 if words else 2)
    if words[0] not in ACTIONS:
        raise UnknownNameError("action of recipe", words[0], ACTIONS)
    options, act = ACTIONS[words[0]]
    return act(parse(options, words[1:], f"recipe {words[0]}", options.__doc__))


def _usage() -> str:
    width = max(map(len, ACTIONS))
    lines = [f"  {name:<{width}}  {(options.__doc__ or '').splitlines()[0]}" for name, (options, _) in ACTIONS.items()]
    return "\n".join(["usage: hugwbc recipe ACTION [OPTIONS]", "", *lines])


def _run(options: RecipeRun) -> int:
    from hugwbc.evaluation.recipe_services import RecipeServices
    from hugwbc.learned.recipe.recipe_file import load_recipe
    from hugwbc.learned.recipe.recipe_run import RunOptions, run_recipe

    services = RecipeServices()
    recipe = load_recipe(options.recipe, profile=options.profile, check_table=services.check_table)
    out = options.out or pathlib.Path("runs") / recipe.name
    if options.workers is not None and options.workers < 1:
        raise RecipeError(f"--workers {options.workers}; give 1 or more")
    if int(os.environ.get("WORLD_SIZE", "1")) > 1:
        raise RecipeError("a recipe runs in one process; start it without torchrun, with more threads in its settings")
    with output_folder(out), progress(f"recipe {recipe.name}") as advance:
        finished = run_recipe(
            recipe, RunOptions(out, options.redo, options.workers), services, progress=advance, say=say
        )
    say(f"finished; everything is in {out}" if finished else f"stopped; the same command goes on with {out}")
    return 0 if finished else 130


def _plan(options: RecipePlan) -> int:
    from hugwbc.evaluation.recipe_services import RecipeServices
    from hugwbc.learned.recipe.forecast import forecast, measure_rates
    from hugwbc.learned.recipe.recipe_file import load_recipe

    services = RecipeServices()
    recipe = load_recipe(options.recipe, profile=options.profile, check_table=services.check_table)
    costs = forecast(recipe, services, measure_rates(recipe, services) if options.measure else None)
    headings = ("stage", "kind", "steps", "at most", "labels", "episodes [s]", "core-hours", "speed from")
    rows: list[tuple[object, ...]] = [
        (c.stage, c.kind, _number(c.steps), _number(c.most_steps), _number(c.labels), _number(c.simulated),
         f"{c.cpu_seconds / 3600.0:.3f}", c.source)
        for c in costs
    ]  # fmt: skip
    hours = sum(c.cpu_seconds for c in costs) / 3600.0
    totals = [_number(sum(getattr(c, name) for c in costs)) for name in ("steps", "most_steps", "labels", "simulated")]
    rows.append(("in all", "", *totals, f"{hours:.3f}", ""))
    say(format_table(headings, rows), options.json)
    say("Gates may end a stage earlier, or repeat a part of it up to 'at most'.", options.json)
    content = {"recipe": recipe.name, "digest": recipe.digest, "core_hours": hours}
    write_json(options.json, {**content, "stages": [dataclasses.asdict(cost) for cost in costs]})
    return 0


def _status(options: RecipeStatus) -> int:
    from hugwbc.learned.recipe.run_status import status_of

    status = status_of(pathlib.Path(options.run))
    headings = ("stage", "state", "done", "steps", "labels", "discarded", "core-hours")
    rows: list[tuple[object, ...]] = [
        (s.name, s.state, f"{100.0 * s.done:.0f} %", _number(s.spent.steps), _number(s.spent.labels),
         _number(s.discarded), f"{s.spent.core_hours:.3f}")
        for s in status.stages
    ]  # fmt: skip
    say(format_table(headings, rows), options.json)
    say(f"{status.sessions} sessions, {status.spent.core_hours:.3f} core-hours in all; {status.left}", options.json)
    if status.newest:
        say(f"last: {status.newest}", options.json)
    write_json(options.json, dataclasses.asdict(status))
    return 0


def _diff(options: RecipeDiff) -> int:
    from hugwbc.learned.recipe.recipe_difference import content_of, recipe_rows, run_rows

    (a, run_a), (b, run_b) = content_of(options.first), content_of(options.second)
    rows = recipe_rows(a, b)
    say(_differences(rows, options.first, options.second) if rows else "the recipes do the same", options.json)
    results = run_rows(run_a, run_b) if run_a is not None and run_b is not None else []
    if results:
        say("\n" + _differences(results, options.first, options.second), options.json)
    write_json(options.json, {"settings": rows, "results": results})
    return 0


def _differences(rows: Sequence[tuple[str, str, str]], first: str, second: str) -> str:
    return format_table(("", first, second), rows)


def _verify(options: RecipeVerify) -> int:
    from hugwbc.learned.recipe.verification import verify

    verdict = verify(options.policy)
    if verdict.records:
        headings = ("stage", "kind", "outcome", "steps", "labels", "discarded", "core-hours", "commit", "record")
        rows: list[tuple[object, ...]] = [
            (r.stage, r.kind, r.outcome, _number(r.steps), _number(r.labels),
             _number(sum(d.steps + d.labels for d in r.discarded)), f"{r.spent.core_hours:.3f}",
             " ".join(commit[:10] for commit in r.commits) + ("+" if r.uncommitted_changes else ""), r.digest[:10])
            for r in verdict.records
        ]  # fmt: skip
        last = verdict.records[-1]
        say(format_table(headings, rows), options.json)
        profile = f", profile {last.profile}" if last.profile else ""
        say(f"recipe {last.recipe}{profile} {last.recipe_digest[:10]}; the whole run: "
            f"{last.run_spent.core_hours:.3f} core-hours, {_number(last.run_spent.steps) or 0} steps, "
            f"{_number(last.run_spent.labels) or 0} labels", options.json)  # fmt: skip
    lines = [*(f"PROBLEM {one}" for one in verdict.problems), *(f"note    {one}" for one in verdict.remarks)]
    say("\n".join(lines if verdict.problems else [*lines, "the chain is whole"]), options.json)
    content: dict[str, Any] = {"path": str(verdict.path), "problems": verdict.problems, "remarks": verdict.remarks}
    write_json(options.json, {**content, "records": [record.as_dict() for record in verdict.records]})
    return NOT_VERIFIED if verdict.problems else 0


def _number(value: float) -> str | None:
    return f"{value:.4g}" if value else None


ACTIONS: dict[str, tuple[type[Any], Callable[[Any], int]]] = {
    "run": (RecipeRun, _run),
    "status": (RecipeStatus, _status),
    "plan": (RecipePlan, _plan),
    "diff": (RecipeDiff, _diff),
    "verify": (RecipeVerify, _verify),
}
