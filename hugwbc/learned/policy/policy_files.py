"""Where policies are: the shipped ones by name, others by path."""

import os
import pathlib

from hugwbc.errors import UnknownNameError
from hugwbc.robot import model_dir

DEFAULT_POLICY = "h1"
POLICY_FILE = "policy.safetensors"


def policy_dir() -> pathlib.Path:
    """Return the folder of the shipped policies."""
    return model_dir() / "policies"


def shipped_policies() -> list[str]:
    """Return the names of the shipped policies."""
    return sorted(path.parent.name for path in policy_dir().glob(f"*/{POLICY_FILE}"))


def policy_file(name_or_path: str | pathlib.Path = DEFAULT_POLICY) -> pathlib.Path:
    """Find the policy file, given the name of a shipped policy, a file, or a folder that holds one.

    Raises:
        UnknownNameError: if it is neither a shipped policy nor an existing path.
    """
    for path in (pathlib.Path(name_or_path), policy_dir() / str(name_or_path)):
        # pathlib raises on a name that no file can have; os.path says that it does not exist.
        if os.path.exists(path):
            return path / POLICY_FILE if path.is_dir() else path
    raise UnknownNameError("policy", name_or_path, [*shipped_policies(), "the path of a policy file or folder"])
