"""Ancestry: a record for everything that a recipe's stages write, chained to the records of what went into it.

A finished stage has a record: what was done, with which code, from what, at which cost. The digests of its files stand
in the record, and the digests of its parents' records as well. Policies and snapshots carry the records of all their
ancestors in their metadata, so that a policy by itself says how it was made.
"""

import dataclasses
import json
import pathlib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from hugwbc.errors import HugwbcError, PolicyFileError, RecipeError
from hugwbc.files import file_digest, write_whole
from hugwbc.learned.policy import checkpoint
from hugwbc.learned.policy.policy_files import read_header
from hugwbc.learned.recipe.ledger import Spent
from hugwbc.learned.recipe.recipe_records import json_digest

FORMAT = "hugwbc ancestry 1"
KEY = "ancestry"
RECORD_FILE, CHAIN_FILE = "record.json", "ancestry.json"
_SEALED = ("policy", "checkpoint", "starts", "labels")  # kinds of files whose metadata take records
_LONGEST_HEADER = 100_000_000  # [byte]


@dataclasses.dataclass(frozen=True)
class Discarded:
    """Work that is in no artefact: a branch that was rolled back, a repeated part, a stage that was given up.

    Attributes:
        reason: what happened.
        steps, labels: how much work it was.
    """

    reason: str
    steps: float = 0.0
    labels: float = 0.0


@dataclasses.dataclass(frozen=True)
class Record:
    """How the files of a stage were made.

    Attributes:
        stage, kind: name and kind of the stage.
        outcome: finished, skipped (given up, and passed on what it started from), or kept best (given up, and went on
            with its best checkpoint).
        recipe, profile, recipe_digest, stage_digest: the recipe, and the digests of all and of this part of it.
        seeds: seeds of its random numbers.
        commits: commits of the source tree, in the order of the sessions.
        uncommitted_changes: whether any session ran with changes that are in no commit.
        versions: versions of Python, machine and packages, of the last session.
        settings: all settings at the begin, defaults included.
        plan: schedules, gates, tables and measurements, as the recipe has them.
        parents: digests of the records of the stages that it took inputs from.
        inputs: digests of the files that it read, by name of the input.
        outputs: digests of the files that it wrote.
        spent: all work and computing time on this stage, discarded parts included.
        steps, labels: work that led to the outputs.
        discarded: work that did not.
        figures: what was measured last, or of the checkpoint that was kept.
        run_spent: what everything in the folder of the run had cost until then.
        ended: date and time.
    """

    stage: str
    kind: str
    outcome: str
    recipe: str
    profile: str
    recipe_digest: str
    stage_digest: str
    seeds: tuple[int, ...]
    commits: tuple[str, ...]
    uncommitted_changes: bool
    versions: Mapping[str, str]
    settings: Mapping[str, Any]
    plan: Mapping[str, Any]
    parents: Mapping[str, str]
    inputs: Mapping[str, str]
    outputs: Mapping[str, str]
    spent: Spent
    steps: float
    labels: float
    discarded: tuple[Discarded, ...]
    figures: Mapping[str, float]
    run_spent: Spent
    ended: str

    def as_dict(self) -> dict[str, Any]:
        """Return the record as JSON."""
        return json.loads(json.dumps(dataclasses.asdict(self), default=str))

    @property
    def digest(self) -> str:
        """Digest of the whole record, which its children name."""
        return json_digest(self.as_dict())

    @classmethod
    def read(cls, content: Any) -> "Record":  # noqa: ANN401  JSON
        """Build a record from JSON.

        Raises:
            ValueError: if the content is not that of a record.
        """
        names = {field.name for field in dataclasses.fields(cls)}
        if not isinstance(content, dict) or set(content) != names:
            raise ValueError("its fields are not those of a record")
        try:
            values = dict(content)
            values |= {name: Spent.read(content[name]) for name in ("spent", "run_spent")}
            values |= {name: tuple(content[name]) for name in ("seeds", "commits")}
            values["discarded"] = tuple(Discarded(**one) for one in content["discarded"])
            for name in ("versions", "settings", "plan", "parents", "inputs", "outputs", "figures"):
                if not isinstance(content[name], dict):
                    raise ValueError(f"{name} is not a mapping")
        except TypeError as error:
            raise ValueError(str(error)) from error
        return cls(**values)


def content_digest(path: pathlib.Path) -> str:
    """Return the digest of a file: of a file of tensors, that of names, types, shapes and bytes of its tensors.

    The metadata of such a file may thus carry its own record.

    Raises:
        PolicyFileError: if a file of tensors is damaged.
        OSError: if the file cannot be read.
    """
    if path.suffix != ".safetensors":
        return file_digest(path)
    kind = file_kind(path)
    tensors, _ = checkpoint.load_file(path, kind)
    return checkpoint.tensor_digest(tensors, kind)[:32]


def file_kind(path: pathlib.Path) -> str:
    """Return the kind of a file of tensors that hugwbc wrote.

    Raises:
        PolicyFileError: if it is none.
    """
    kind = read_header(path).get("kind")
    if not isinstance(kind, str):
        raise PolicyFileError(f"{path} was not written by hugwbc; use a file as it wrote it")
    return kind


def seal(path: pathlib.Path, records: Sequence[Record]) -> None:
    """Write records into the metadata of a policy or snapshot; other files stay as they are. Doing it twice is once.

    Args:
        path: path of the file.
        records: of all ancestors and of the file itself, each after its parents.
    """
    if path.suffix != ".safetensors" or file_kind(path) not in _SEALED:
        return
    kind = file_kind(path)
    tensors, metadata = checkpoint.load_file(path, kind)
    home = metadata.setdefault("training", {}) if kind == "policy" else metadata
    home[KEY] = {"format": FORMAT, "records": [record.as_dict() for record in records]}
    checkpoint.save_file(path, tensors, kind, metadata)


def ancestry_of(path: pathlib.Path) -> list[Record]:
    """Return the records in a policy or snapshot; an empty list if it has none.

    Raises:
        PolicyFileError: if the file is damaged.
        RecipeError: if its ancestry is.
    """
    kind = file_kind(path)
    _, metadata = checkpoint.load_file(path, kind)
    home = metadata.get("training") if kind == "policy" else metadata
    content = home.get(KEY) if isinstance(home, dict) else None
    if content is None:
        return []
    return read_chain(content, path)


def read_chain(content: Any, origin: object) -> list[Record]:  # noqa: ANN401  JSON
    """Return the records of a chain in JSON.

    Raises:
        RecipeError: if it is damaged.
    """
    try:
        if content["format"] != FORMAT:
            raise ValueError(f"its format is {content['format']}, this hugwbc reads {FORMAT}")
        return [Record.read(one) for one in content["records"]]
    except (KeyError, TypeError, ValueError) as error:
        raise RecipeError(f"the ancestry in {origin} is damaged: {error}; use the file as hugwbc wrote it") from error


def write_record(folder: pathlib.Path, record: Record) -> None:
    """Write the record of a finished stage to its folder."""
    write_whole(folder / RECORD_FILE, json.dumps(record.as_dict(), indent=1) + "\n")


def read_record(folder: pathlib.Path) -> Record | None:
    """Return the record of a stage; None if it is not finished.

    Raises:
        RecipeError: if the record is damaged.
    """
    path = folder / RECORD_FILE
    if not path.exists():
        return None
    try:
        return Record.read(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError) as error:
        raise RecipeError(
            f"{path} is damaged ({error}); copy it back, or begin the stage again with `--redo {folder.name}`"
        ) from error


def lineage(record: Record, by_stage: Mapping[str, Record]) -> list[Record]:
    """Return the records of all ancestors and of the record itself, each once and after its parents."""
    found: dict[str, Record] = {}

    def visit(one: Record) -> None:
        for parent in one.parents:
            if parent not in found:
                visit(by_stage[parent])
        found[one.stage] = one

    visit(record)
    return list(found.values())


def chain_problems(records: Sequence[Record]) -> list[str]:
    """Return what is wrong with a chain: parents that are missing or were changed, and inputs that nobody wrote."""
    problems: list[str] = []
    earlier: dict[str, Record] = {}
    for record in records:
        for name, digest in record.parents.items():
            if name not in earlier:
                problems.append(f"{record.stage}: the record of its parent {name} is missing")
            elif earlier[name].digest != digest:
                problems.append(f"{record.stage}: the record of its parent {name} is not the one that it was made from")
        written = {digest for name in record.parents if name in earlier for digest in earlier[name].outputs.values()}
        problems += [
            f"{record.stage}: its input {name} was written by none of its parents"
            for name, digest in record.inputs.items()
            if digest not in written
        ]
        earlier[record.stage] = record
    return problems


def file_problems(folder: pathlib.Path, outputs: Mapping[str, str], made_by: str) -> list[str]:
    """Return which files of a stage are missing or were changed since.

    Args:
        folder: folder of the files.
        outputs: their digests by name.
        made_by: who wrote them, for the messages.
    """
    problems = []
    for name, digest in outputs.items():
        try:
            if content_digest(folder / name) != digest:
                problems.append(f"{folder / name} is not the file that {made_by} wrote")
        except OSError as error:
            problems.append(f"{folder / name} cannot be read: {error.strerror}")
        except HugwbcError as error:
            problems.append(str(error))
    return problems


def total(records: Iterable[Record]) -> Spent:
    """Return what the stages of some records have cost."""
    spent = Spent()
    for record in records:
        spent += record.spent
    return spent
