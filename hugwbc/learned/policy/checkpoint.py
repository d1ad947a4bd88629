"""Files of tensors: safetensors with JSON metadata and a checksum, written atomically, never pickled."""

import hashlib
import json
import pathlib
from collections.abc import Mapping
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load, save

from hugwbc.errors import PolicyFileError
from hugwbc.files import read_file, write_whole
from hugwbc.learned.policy.network_files import LARGEST_FILE, from_json, header_of

FORMAT = "hugwbc-2"


def tensor_digest(tensors: Mapping[str, torch.Tensor], text: str) -> str:
    """Return the SHA-256 of a text and of names, types, shapes and bytes of tensors, whatever their order."""
    sha = hashlib.sha256(text.encode())
    for name in sorted(tensors):
        tensor = tensors[name].detach().contiguous()
        sha.update(f"{name}|{tensor.dtype}|{tuple(tensor.shape)}|".encode())
        sha.update(tensor.reshape(-1).view(torch.uint8).numpy().tobytes())
    return sha.hexdigest()


def save_file(path: pathlib.Path, tensors: dict[str, torch.Tensor], kind: str, metadata: dict[str, Any]) -> None:
    """Write tensors, and metadata that JSON holds, to a file of a kind; an interruption leaves the old file whole."""
    tensors = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    text = json.dumps(metadata)
    header = {"format": FORMAT, "kind": kind, "sha256": tensor_digest(tensors, text), "metadata": text}
    write_whole(path, save(tensors, header))


def load_file(path: pathlib.Path, kind: str) -> tuple[dict[str, torch.Tensor], dict[str, Any]]:
    """Read tensors and metadata of a file of a kind that `save_file` wrote."""
    try:
        data = read_file(pathlib.Path(path), LARGEST_FILE)
    except OSError as error:
        raise PolicyFileError(f"cannot read {path}: {error.strerror}; give the path of a {kind} file") from error
    try:
        tensors, header = load(data), header_of(data)
    except (SafetensorError, ValueError, KeyError, RecursionError) as error:
        raise PolicyFileError(
            f"{path} is not a readable safetensors file ({error}); it is truncated or of another kind. "
            "Copy it again; for another project's network, give its contract as --controller (docs/evaluation.md)"
        ) from error
    found = header.get("format", "no format mark")
    if found != FORMAT:
        raise PolicyFileError(f"{path} has {found[:40]}, this hugwbc reads {FORMAT}; use a file that it wrote")
    if header.get("kind") != kind:
        raise PolicyFileError(f"{path} is a {header.get('kind')} file; a {kind} file is needed here")
    text = header.get("metadata", "")
    if header.get("sha256") != tensor_digest(tensors, text):
        raise PolicyFileError(f"{path} is corrupted: its checksum does not match. Copy it again")
    metadata = from_json(text, path)
    if not isinstance(metadata, dict):
        raise PolicyFileError(f"{path} is corrupted: its metadata is not a JSON object. Copy it again")
    return tensors, metadata
