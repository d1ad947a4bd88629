"""Files that are there whole or not at all, their digests, and numbers that JSON can hold."""

import hashlib
import math
import os
import pathlib
import secrets
from typing import Any


def write_whole(path: pathlib.Path, content: bytes | str) -> None:
    """Write a file, so that it is always either the old or the new one, whatever happens meanwhile; text as UTF-8.

    Of several processes that write it at once, one wins.

    Args:
        path: of the file; its folder is made. What is no ordinary file, such as /dev/stdout, is written to as it is.
        content: of the file.

    Raises:
        OSError: if it cannot be written.
    """
    data = content.encode("utf-8") if isinstance(content, str) else content
    path = path.resolve()  # a link stays one
    if path.exists() and not path.is_file():
        path.write_bytes(data)
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    # A name of its own: another process may be writing the same file.
    temporary = path.with_name(f"{path.name}.{secrets.token_hex(8)}.partial")
    try:
        with temporary.open("xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def file_digest(path: pathlib.Path) -> str:
    """Return 32 hexadecimal digits of the SHA-256 of a file's bytes."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:32]


def finite_json(content: Any) -> Any:  # noqa: ANN401  whatever JSON holds
    """JSON with null for numbers that are not finite."""
    if isinstance(content, dict):
        return {key: finite_json(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [finite_json(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content
