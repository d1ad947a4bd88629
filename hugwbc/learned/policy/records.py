"""Records of trainings: the versions and settings that made a policy, as its file states them."""

import dataclasses
import importlib.metadata
import json
import pathlib
import platform
from typing import Any

from hugwbc.errors import ConfigError, PolicyFileError
from hugwbc.learned.policy.contract import contract_of, load_contract
from hugwbc.learned.policy.network_files import ONNX_SUFFIX, OnnxNetwork
from hugwbc.learned.policy.policy_files import policy_file, read_header
from hugwbc.robot import load_robot


def versions() -> dict[str, str]:
    """Return the versions that a result depends on."""
    packages = ("hugwbc", "mujoco", "numpy", "safetensors", "torch")
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

    Folders mean nothing on another machine: of a path only the last two parts are kept, and of `out` nothing. Functions
    of a user's file are named with the digest of the file.
    """
    record = json.loads(json.dumps(dataclasses.asdict(settings), default=_named))
    record.pop("out", None)
    return record


def _named(value: object) -> str:
    if isinstance(value, pathlib.PurePath):
        return "/".join(value.parts[-2:])
    return f"{value.__module__}.{getattr(value, '__qualname__', type(value).__name__)}"


def _metadata(path: pathlib.Path) -> Any:  # noqa: ANN401  what a file holds
    """Return what a policy's file says besides the network."""
    if path.suffix == ONNX_SUFFIX:
        return OnnxNetwork(path, {}).metadata
    try:
        return json.loads(read_header(path).get("metadata", "{}"))
    except (ValueError, RecursionError) as error:  # brackets nested by the thousand
        raise PolicyFileError(f"{path} is corrupted: its metadata is not JSON ({error}). Copy it again") from error


def check_robot(what: str, own: str, robot: str) -> None:
    """Refuse what was learnt for a robot with other joints than that which is here, both given by name."""
    if load_robot(own).joint_names != load_robot(robot).joint_names:
        raise ConfigError(
            f"{what} is for the robot {own}, and this is {robot}; train one: hugwbc train --env.robot {robot}"
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
