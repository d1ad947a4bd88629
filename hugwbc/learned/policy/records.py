"""Records of trainings: what made a policy, as its file states it, and the log of a run.

The log has a row of figures per iteration, and a record per session.
"""

import csv
import dataclasses
import importlib.metadata
import itertools
import json
import math
import pathlib
import platform
from typing import Any

from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.files import write_whole
from hugwbc.learned.policy.contract import contract_of, load_contract
from hugwbc.learned.policy.network_files import ONNX_SUFFIX, OnnxNetwork, from_json, policy_file, read_header
from hugwbc.robot import load_robot

LOG_NAME = "metrics.csv"
SESSIONS_NAME = "sessions.jsonl"


def versions() -> dict[str, str]:
    """Return the versions that a result depends on."""
    packages = ("hugwbc", "mujoco", "numpy", "pin", "placo", "proxsuite", "safetensors", "torch")
    return {
        "python": platform.python_version(),
        "machine": platform.machine(),
        **{package: version for package in packages if (version := _version(package)) is not None},
    }


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:  # torch, which running an exported network does not need
        return None


def settings_record(settings: Any) -> dict[str, Any]:  # noqa: ANN401  any dataclass
    """Return settings in a form that JSON can hold, for the record of a policy.

    Folders mean nothing on another machine: of a path only the last two parts are kept, and `out` is left out. The name
    of a function of a user's file includes the digest of the file.
    """
    record = json.loads(json.dumps(dataclasses.asdict(settings), default=_named))
    record.pop("out", None)
    if "robot" in record.get("env", {}):
        record["env"]["robot"] = robot_label(record["env"]["robot"])
    return record


def robot_label(name: str) -> str:
    """Return the name of a robot, or the last two parts of the path of its table."""
    return _named(pathlib.Path(name)) if name.endswith(".yaml") else name


def _named(value: object) -> str:
    if isinstance(value, pathlib.PurePath):
        return "/".join(value.parts[-2:])
    return f"{value.__module__}.{getattr(value, '__qualname__', type(value).__name__)}"


def _metadata(path: pathlib.Path) -> Any:  # noqa: ANN401  what a file holds
    """Return the metadata of a policy's file."""
    is_onnx = path.suffix == ONNX_SUFFIX
    return OnnxNetwork(path, {}).metadata if is_onnx else from_json(read_header(path).get("metadata", "{}"), path)


def check_robot(what: str, own: str, robot: str) -> None:
    """Raise ConfigError if what was learnt for the robot `own` meets another `robot`, with other joints.

    Args:
        what: what was learnt, for messages.
        own: name of the robot for which it was learnt.
        robot: name of the robot that is here.
    """
    try:
        joints = load_robot(own).joint_names
    except UnknownNameError as error:
        raise ConfigError(f"{what} is for the robot {own}, whose table is not there; put it there") from error
    if joints != load_robot(robot).joint_names:
        raise ConfigError(
            f"{what} is for the robot {own}, and this is {robot}; choose --robot {own}, or train one for "
            f"{robot}: hugwbc train --env.robot {robot}. The QP takes any robot: --controller qp"
        )


def robot_of(path: pathlib.Path) -> str:
    """Return the robot for which a policy or contract was made, by name, given its file."""
    found = load_contract(path) if path.name.endswith((".yaml", ".yml")) else contract_of(_metadata(path), path)
    return found.robot


def trained_with(name_or_path: str | pathlib.Path) -> str | None:
    """Return what moved the arms in a policy's training ("noise", "motion" or "none"); None without a record."""
    record = _metadata(policy_file(name_or_path))
    for key in ("training", "config", "env", "intervention"):
        record = record.get(key) if isinstance(record, dict) else None
    return record if isinstance(record, str) else None


# Log of a run --------------------------------------------------------------------------------------------------------


def begin_log(folder: pathlib.Path, iteration: int, *, resumed: bool) -> None:
    """Prepare the log of a run for a session that goes on after an iteration, so that each iteration is in it once.

    A run that was cut off has logged iterations after its last checkpoint. The resumed run does these again, so their
    rows are dropped. The log of another run in the folder is kept under another name.
    """
    path = folder / LOG_NAME
    if not path.exists():
        return
    if not resumed:
        path.rename(_free(path.with_stem(f"{path.stem}-before")))
        return
    header, *rows = _rows(path)
    column = header.index("iteration") if "iteration" in header else None
    kept = [row for row in rows if column is not None and len(row) == len(header) and float(row[column]) <= iteration]
    if len(kept) < len(rows):
        _write_rows(path, [header, *kept])


def append_row(folder: pathlib.Path, row: dict[str, float]) -> None:
    """Append the figures of an iteration to the log; NaN, or a column that the row lacks, leaves a cell empty.

    A column that the log lacks, such as that of a reward which a schedule switches on, is added to all of its rows.
    """
    path, header = folder / LOG_NAME, list[str]()
    if path.exists():
        with path.open(newline="") as file:
            header = next(csv.reader(file), [])
    if new := [name for name in row if name not in header]:
        _, *rows = _rows(path)
        _write_rows(path, [[*header, *new], *(cells + [""] * len(new) for cells in rows)])
    with path.open("a", newline="") as file:
        cells = {name: "" if math.isnan(value) else f"{value:.6g}" for name, value in row.items()}
        csv.DictWriter(file, [*header, *new]).writerow(cells)


def _rows(path: pathlib.Path) -> list[list[str]]:
    """Return the cells of a log, its header first; an empty header without a log."""
    if not path.exists():
        return [[]]
    with path.open(newline="") as file:
        return list(csv.reader(file)) or [[]]


def _write_rows(path: pathlib.Path, rows: list[list[str]]) -> None:
    write_whole(path, "".join(",".join(row) + "\r\n" for row in rows))


def append_session(folder: pathlib.Path, record: dict[str, Any]) -> None:
    """Append the settings and versions of a session to the record of the run."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / SESSIONS_NAME).open("a") as file:
        file.write(json.dumps(record) + "\n")


def _free(path: pathlib.Path) -> pathlib.Path:
    """Return the path, or the first of path-2, path-3, ... that does not exist."""
    numbered = (path.with_stem(f"{path.stem}-{number}") for number in itertools.count(2))
    return next(candidate for candidate in itertools.chain([path], numbered) if not candidate.exists())
