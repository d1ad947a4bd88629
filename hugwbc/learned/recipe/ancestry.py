"""Ancestry: the record in a policy, or another file of tensors, of how it was made.

Each stage of a recipe has a record: with which code and seed its files were made, from what, and at which cost. A file
carries in its metadata the records of all stages that led to it, each after those that it took something from. A record
names what the stage wrote, and what it took, by the digests of their tensors.
"""

import json
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import TypeAdapter, ValidationError

from hugwbc.errors import HugwbcError, PolicyFileError
from hugwbc.learned.policy import checkpoint, load_policy, policy_file
from hugwbc.learned.policy.network_files import POLICY_FILE, SNAPSHOT_FILE
from hugwbc.settings import settings

KEY = "made"
KINDS = {POLICY_FILE: "policy", SNAPSHOT_FILE: "checkpoint"}  # of the files that a stage writes


@settings(kw_only=True)
class Parent:
    """An input of a stage: digest of its tensors, and the stage that wrote it, if one did."""

    stage: str | None
    digest: str


@settings(kw_only=True)
class StageRecord:
    """How the files of a stage were made.

    Attributes:
        stage, kind: name of the stage, and what it did.
        recipe, settings: name of the recipe, and digest of those settings of the stage that differ from the defaults.
        seed: seed of its random numbers.
        commits: commits of the source tree, in the order of the sessions; "+" and a digest follow uncommitted changes.
        versions: versions of Python, machine and packages.
        steps: environment steps that led to the files.
        discarded_steps: steps that did not: after the checkpoint that was kept.
        core_seconds: processor time, killed sessions included as far as they wrote it down [s].
        figures: evaluation of the checkpoint that was kept, or errors of the calibration.
        parents: what it took, by the name of the setting.
        outputs: digests of the files that it wrote, by file name.
        ended: date and time of its end, in UTC.
    """

    stage: str
    kind: str
    recipe: str
    settings: str
    seed: int
    commits: tuple[str, ...]
    versions: dict[str, str]
    steps: float = 0.0
    discarded_steps: float = 0.0
    core_seconds: float = 0.0
    figures: dict[str, float | None]
    parents: dict[str, Parent]
    outputs: dict[str, str]
    ended: str


@settings(kw_only=True)
class Ancestry:
    """The records of a file, its own stage last, and the text of the recipe."""

    recipe: str
    stages: tuple[StageRecord, ...]


def content_digest(path: pathlib.Path, kind: str) -> str:
    """Return a digest of a file's kind and tensors, without the metadata, which `seal` changes."""
    tensors, _ = checkpoint.load_file(path, kind)
    return checkpoint.tensor_digest(tensors, kind)[:32]


def seal(path: pathlib.Path, ancestry: Ancestry) -> None:
    """Write an ancestry into the metadata of a file."""
    kind = KINDS[path.name]
    tensors, metadata = checkpoint.load_file(path, kind)
    home = metadata["training"] if kind == "policy" else metadata
    home[KEY] = TypeAdapter(Ancestry).dump_python(ancestry, mode="json")
    checkpoint.save_file(path, tensors, kind, metadata)


def ancestry_in(metadata: Mapping[str, Any], path: pathlib.Path) -> Ancestry | None:
    """Return the ancestry in the metadata of a file; None if it has none."""
    home = metadata.get("training", metadata)
    content = home.get(KEY) if isinstance(home, dict) else None
    try:
        return None if content is None else TypeAdapter(Ancestry).validate_python(content)
    except ValidationError as error:
        first = error.errors()[0]
        raise PolicyFileError(f"the ancestry in {path} is damaged at {first['loc']}: {first['msg']}") from error


def origin(path: pathlib.Path, kind: str) -> tuple[Parent, Sequence[StageRecord]]:
    """Return a file from outside a recipe as a parent, and the records in its metadata of the stages that led to it."""
    digest, ancestry = content_digest(path, kind), ancestry_in(checkpoint.load_file(path, kind)[1], path)
    records = () if ancestry is None else ancestry.stages
    stage = next((record.stage for record in records if digest in record.outputs.values()), None)
    return Parent(stage=stage, digest=digest), records


def read_record(path: pathlib.Path) -> StageRecord | None:
    """Return the record of a finished stage; None without such a file. Raise PolicyFileError if it is damaged."""
    if not path.exists():
        return None
    try:
        return TypeAdapter(StageRecord).validate_python(json.loads(path.read_text()))
    except (OSError, ValueError) as error:
        raise PolicyFileError(f"{path} is damaged ({error}); remove its folder to make the stage again") from error


def verify(name_or_path: str | pathlib.Path) -> tuple[Sequence[StageRecord], list[str]]:
    """Return the records of a policy, and the problems of the policy and its ancestry, in words.

    Args:
        name_or_path: name of a shipped policy, or path of a policy or its folder.
    """
    path = policy_file(name_or_path)
    load_policy(path, threads=None)  # which runs its self-test
    _, metadata = checkpoint.load_file(path, "policy")
    ancestry = ancestry_in(metadata, path)
    if ancestry is None or not ancestry.stages:
        training = metadata.get("training", {}).get("config", {})
        source = f" hugwbc train with {training['source']} did;" if training.get("source") else ""
        return (), [f"{path} has no ancestry: no recipe made it;{source} its metadata has its settings"]
    problems, written = [], dict[str, str]()
    for record in ancestry.stages:
        for name, parent in record.parents.items():
            if parent.stage is None:
                problems.append(f"{record.stage}: no stage of this recipe made its {name}")
            elif written.get(parent.digest) != parent.stage:
                problems.append(f"{record.stage}: stage {parent.stage} did not write its {name}")
        written |= dict.fromkeys(record.outputs.values(), record.stage)
    last = ancestry.stages[-1]
    for name in {path.name, *KINDS} & {one.name for one in path.parent.glob("*.safetensors")}:
        kind = KINDS.get(name, "policy")
        try:
            made_here = written.get(content_digest(path.parent / name, kind))
        except HugwbcError as error:
            problems.append(str(error))
            continue
        if made_here is None or (kind == "policy" and made_here != last.stage):
            problems.append(f"{path.parent / name} is not what stage {last.stage} or its ancestors wrote")
    return ancestry.stages, problems
