"""The commit of the source that runs, for whatever a file says about how it was made."""

import functools
import pathlib
import subprocess

import hugwbc
from hugwbc.files import digest

_SHOWING = (":(exclude)*.md", ":(exclude)hugwbc/viz")  # changes no number
_POLICIES = (":(exclude)models/*/policies/*", ":(exclude)models/*/recipes/*")  # as patterns of git


@functools.cache
def source_commit(*, policies: bool = True) -> str:
    """Return the last commit that changed code or models, then "+" and a digest of what differs from it, if anything.

    Outside of a checkout, return the version. What was made stays valid when only documents, tests or `viz` change.
    Without policies, changes of shipped policies and recipes do not count: for what depends on no policy or knows its
    digest.
    """
    paths = ("hugwbc", "models", *_SHOWING, *(() if policies else _POLICIES))
    try:
        if not _git("ls-files", "hugwbc/__init__.py"):
            return hugwbc.__version__
        changes = _git("diff", "HEAD", "--", *paths)
        added = _git("ls-files", "--others", "--exclude-standard", "-z", "--", "hugwbc/*.py", *_SHOWING)
        for name in sorted(filter(None, added.decode().split("\0"))):
            changes += name.encode() + (_root() / name).read_bytes()
        last = _git("log", "-1", "--format=%H", "--", *paths).decode().strip()
        return last + (f"+{digest(changes)[:16]}" if changes else "")
    except (OSError, subprocess.CalledProcessError):
        return hugwbc.__version__


def _root() -> pathlib.Path:
    return pathlib.Path(hugwbc.__file__).parents[1]


def _git(*words: str) -> bytes:
    command = ["git", "-C", str(_root()), *words]
    return subprocess.run(command, check=True, capture_output=True).stdout
