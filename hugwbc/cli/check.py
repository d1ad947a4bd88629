"""`hugwbc check`: try every part of this installation, or verify how a policy was made."""

import dataclasses
import pathlib
from collections.abc import Sequence
from typing import Any

from hugwbc.cli.output import parse, progress, say
from hugwbc.errors import ConfigError

CHECK_FAILED = 1


@dataclasses.dataclass(frozen=True)
class CheckOptions:
    """Verify models, versions, controllers and the training; or a robot, or how a policy was made.

    Exit code 1 if something is wrong.
    """

    # Name of a shipped policy, or path of a policy or its folder: print by which stages it was made, from which commit,
    # at which cost, check that each took what the one before wrote, and whether its shipped recipe is still the same
    policy: str | None = None
    # Name of a robot, or path of its table or folder: say what is missing or implausible, and whether it stands, walks
    # and raises its hands
    robot: str | None = None


def run(words: Sequence[str]) -> int:
    """Run all checks and print a line for each."""
    options = parse(CheckOptions, words, "check")
    if options.policy is not None:
        if options.robot is not None:
            raise ConfigError("--policy and --robot are two checks; give one of them")
        return _policy(options.policy)
    from hugwbc.evaluation.installation import run_checks

    with progress("check") as advance:
        outcomes = run_checks(advance, options.robot)
    failed = sum(not passed for _, passed, _ in outcomes)
    for name, passed, text in outcomes:
        say("\n".join(f"{'ok   ' if passed else 'FAIL '} {name}: {line}" for line in text.splitlines()))
    say("all is well" if not failed else f"{failed} of {len(outcomes)} checks failed")
    return CHECK_FAILED if failed else 0


def _policy(name_or_path: str) -> int:
    from hugwbc.evaluation.tables import Cell, format_table
    from hugwbc.learned.policy import policy_file
    from hugwbc.learned.recipe.ancestry import verify

    records, problems = verify(name_or_path)
    if records:
        headings = ("stage", "kind", "steps", "discarded", "core-hours", "seed", "commit", "from", "wrote")
        rows: list[tuple[Cell, ...]] = [
            (
                one.stage,
                one.kind,
                f"{one.steps:.4g}",
                f"{one.discarded_steps:.4g}",
                f"{one.core_seconds / 3600.0:.3f}",
                one.seed,
                " ".join(commit[:10] + "+" * ("+" in commit) for commit in one.commits),
                ", ".join(parent.stage or "elsewhere" for parent in one.parents.values()),
                ", ".join(f"{name.partition('.')[0]} {digest[:8]}" for name, digest in one.outputs.items()),
            )
            for one in records
        ]
        say(format_table(headings, rows))
        hours = sum(one.core_seconds for one in records) / 3600.0
        steps = sum(one.steps + one.discarded_steps for one in records)
        say(f"recipe {records[-1].recipe}, {steps:.4g} steps and {hours:.2f} core-hours in all; +: with other changes")
        _say_changed_recipe(policy_file(name_or_path), records[-1].recipe)
    say("\n".join(f"PROBLEM {one}" for one in problems) if problems else "the chain is whole")
    return CHECK_FAILED if problems else 0


def _say_changed_recipe(path: pathlib.Path, name: str) -> None:
    """Say if the shipped recipe of a name is no longer the one in a policy, comments apart."""
    from hugwbc import settings_file
    from hugwbc.learned.policy import checkpoint
    from hugwbc.learned.recipe.ancestry import ancestry_in
    from hugwbc.robot_tables import models_dir

    made, content = ancestry_in(checkpoint.load_file(path, "policy")[1], path), dict[str, Any]
    for file in models_dir().glob("*/recipes/*.yaml"):
        if file.stem != name or made is None:
            continue
        if settings_file.load(content, file) != settings_file.parse(content, made.recipe, path):
            say(f"{file} has changed since it made this policy, whose metadata has the recipe as it was")
