"""Where policies are: the shipped ones by name, others by path."""

import json
import os
import pathlib

from hugwbc.errors import PolicyFileError, UnknownNameError
from hugwbc.files import read_file
from hugwbc.robot import DEFAULT_ROBOT, models_dir

DEFAULT_POLICY = "h1"
POLICY_FILE, CONTRACT_FILE = "policy.safetensors", "contract.yaml"
LARGEST_FILE = 2_000_000_000  # [byte]


def policy_dir() -> pathlib.Path:
    """Return the folder of the shipped policies."""
    return models_dir() / DEFAULT_ROBOT / "policies"


def shipped_policies() -> list[str]:
    """Return the names of the shipped policies."""
    return sorted(path.parent.name for path in policy_dir().glob(f"*/{POLICY_FILE}"))


def shipped_contracts() -> list[str]:
    """Return the names of the shipped contracts of other projects' policies, whose networks are not shipped."""
    return sorted(path.parent.name for path in policy_dir().glob(f"*/{CONTRACT_FILE}"))


def policy_file(name_or_path: str | pathlib.Path = DEFAULT_POLICY) -> pathlib.Path:
    """Find the file of a policy or contract, given a shipped name, a file, or a folder that holds one."""
    for path in (pathlib.Path(name_or_path), policy_dir() / str(name_or_path)):
        # pathlib raises on a name that no file can have; os.path says that it does not exist.
        if os.path.exists(path):
            contract = path / CONTRACT_FILE
            return path if not path.is_dir() else contract if contract.is_file() else path / POLICY_FILE
    valid = [*shipped_policies(), *shipped_contracts(), "the path of a policy, of a contract, or of a folder with one"]
    raise UnknownNameError("policy", name_or_path, valid)


def read_header(path: pathlib.Path) -> dict[str, str]:
    """Return the metadata of a safetensors file."""
    try:
        return header_of(read_file(path, LARGEST_FILE))
    except (OSError, ValueError, AttributeError, TypeError, RecursionError) as error:
        raise PolicyFileError(f"{path} is not a readable safetensors file ({error}); copy it again") from error


def header_of(data: bytes) -> dict[str, str]:
    """Return the metadata of a safetensors file, in which an 8-byte length and a JSON header precede the tensors."""
    length = int.from_bytes(data[:8], "little")
    return dict(json.loads(data[8 : 8 + length]).get("__metadata__", {}))
