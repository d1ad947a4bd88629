"""Verification: whether a policy's ancestry is complete, unbroken, and that of the recipe that it names."""

import dataclasses
import json
import pathlib
from collections.abc import Sequence

from hugwbc.errors import HugwbcError, RecipeError
from hugwbc.learned.policy import policy_file
from hugwbc.learned.recipe.ancestry import (
    CHAIN_FILE,
    Record,
    ancestry_of,
    chain_problems,
    content_digest,
    file_problems,
    read_chain,
    total,
)
from hugwbc.learned.recipe.ledger import UNKNOWN
from hugwbc.learned.recipe.recipe_file import load_recipe
from hugwbc.learned.recipe.run_folder import RunFolder


@dataclasses.dataclass(frozen=True)
class Verdict:
    """What a verification found.

    Attributes:
        path: what was verified.
        records: the chain, each record after its parents; empty without an ancestry.
        problems: what is wrong; empty if all is well.
        remarks: what one should know besides, such as stages that began again.
    """

    path: pathlib.Path
    records: Sequence[Record]
    problems: Sequence[str]
    remarks: Sequence[str]


def verify(name_or_path: str | pathlib.Path) -> Verdict:
    """Verify a policy by name, file or folder, or all stages of a run.

    Raises:
        HugwbcError: if there is nothing of that name, or its policy file is damaged.
    """
    folder = RunFolder(pathlib.Path(name_or_path))
    if folder.stored():
        return _verify_run(folder)
    return _verify_policy(policy_file(name_or_path))


def _verify_policy(path: pathlib.Path) -> Verdict:
    records = ancestry_of(path)
    if not records:
        return Verdict(
            path,
            (),
            (f"{path} has no ancestry: it was not made by a recipe, and how it was made cannot be verified",),
            (),
        )
    problems = chain_problems(records)
    own = records[-1]
    if content_digest(path) not in own.outputs.values():
        problems.append(f"{path} is not the file that stage {own.stage} wrote: its tensors were changed")
    beside = path.parent / CHAIN_FILE
    if beside.exists():
        problems += _beside_problems(beside, own)
    recipe_problems, remarks = _against_recipe(records)
    return Verdict(path, records, [*problems, *recipe_problems], [*remarks, *_remarks(records)])


def _beside_problems(chain: pathlib.Path, own: Record) -> list[str]:
    """Return what is wrong with the other files of the folder, which the chain beside the policy lists."""
    try:
        stored = read_chain(json.loads(chain.read_text(encoding="utf-8")), chain)
    except (OSError, ValueError) as error:
        return [f"{chain} cannot be read: {error}"]
    except RecipeError as error:
        return [str(error)]
    if not stored or stored[-1].digest != own.digest:
        return [f"{chain} belongs to another policy"]
    present = {name: digest for name, digest in own.outputs.items() if (chain.parent / name).exists()}
    return file_problems(chain.parent, present, f"stage {own.stage}")


def _against_recipe(records: Sequence[Record]) -> tuple[list[str], list[str]]:
    """Compare the records with the shipped recipe of the name that they give."""
    own = records[-1]
    profile = own.profile or None
    try:
        recipe = load_recipe(own.recipe, profile=profile)
    except HugwbcError as error:
        return [], [f"the recipe '{own.recipe}' is not here to compare with: {str(error).splitlines()[0]}"]
    problems = []
    names = {stage.name for stage in recipe.stages}
    for record in records:
        if record.stage not in names or recipe.stage_digest(record.stage) != record.stage_digest:
            problems.append(f"{record.stage}: the recipe '{own.recipe}' says something else today")
    return problems, []


def _remarks(records: Sequence[Record]) -> list[str]:
    remarks = []
    commits = {commit for record in records for commit in record.commits}
    if len(commits) > 1:
        remarks.append(f"it was made from {len(commits)} commits")
    if UNKNOWN in commits:
        remarks.append("a part of it was made outside of a checkout, so that its commit is unknown")
    if any(record.uncommitted_changes for record in records):
        remarks.append("the source tree had changes that are in no commit")
    beyond = records[-1].run_spent.core_hours - total(records).core_hours
    if beyond > 0.01:
        remarks.append(f"{beyond:.2f} core-hours more were spent in its run: on other branches and between stages")
    return remarks


def _verify_run(folder: RunFolder) -> Verdict:
    records = list(folder.records().values())
    problems = chain_problems(records)
    for record in records:
        problems += file_problems(folder.stage(record.stage), record.outputs, f"stage {record.stage}")
    stored = folder.stored()
    waiting = [name for name in stored["stages"] if name not in {record.stage for record in records}]
    remarks = _remarks(records) if records else []
    if waiting:
        remarks.append(f"not finished: {', '.join(waiting)}")
    problems += [
        f"{record.stage}: the recipe of the run says something else"
        for record in records
        if stored["stages"].get(record.stage, [""])[0] != record.stage_digest
    ]
    return Verdict(folder.path, records, problems, remarks)
