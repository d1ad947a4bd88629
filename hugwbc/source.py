"""The commit of the source that runs, for whatever a file says about how it was made."""

import ast
import contextlib
import functools
import pathlib
import subprocess
from collections.abc import Iterator

import yaml

import hugwbc
from hugwbc.files import digest

_SHOWING = (":(exclude)*.md", ":(exclude)hugwbc/viz")  # changes no number
_FILES = (".py", ".yaml", ".urdf", ".xml", ".safetensors")
_POLICIES = (":(exclude)models/*/policies/*", ":(exclude)models/*/recipes/*")  # as patterns of git


@functools.cache
def source_commit(*, policies: bool = True) -> str:
    """Return the last commit that changed code or models, then "+" and a digest of what differs from it, if anything.

    Outside of a checkout, return the version, "+" and a digest of the files. What was made stays valid when only
    documents, comments, docstrings, tests or `viz` change. Without policies, changes of shipped policies and recipes do
    not count: for what depends on no policy or knows its digest.
    """
    paths = ("hugwbc", "models", *_SHOWING, *(() if policies else _POLICIES))
    try:
        if not _git("ls-files", "hugwbc/__init__.py"):
            return _version(policies=policies)
        changed = _changed(["HEAD"], paths)
        new = (*(f"hugwbc/*{suffix}" for suffix in _FILES), *_SHOWING)
        added = _names(_git("ls-files", "--others", "--exclude-standard", "-z", "--", *new))
        changes = b"".join(name.encode() + (_content("", name) or b"") for name in sorted([*changed, *added]))
        return _last_change(paths) + (f"+{digest(changes)[:16]}" if changes else "")
    except (OSError, subprocess.CalledProcessError):
        return _version(policies=policies)


def short_commit() -> str:
    """Return `source_commit` for a reader: twelve digits of the commit; "+" and the digest of what differs stay."""
    commit, plus, changes = source_commit().partition("+")
    return f"{commit[:12]}{plus}{changes}"


def _version(*, policies: bool) -> str:
    """Return the version and a digest of the code and the models, where no git knows them."""
    package = pathlib.Path(hugwbc.__file__).parent
    models = package.parent / "models"
    folders = [package] if (package / "models").is_dir() or not models.is_dir() else [package, models]
    left_out = {"viz"} if policies else {"viz", "policies", "recipes"}
    files = [file for folder in folders for file in sorted(folder.rglob("*")) if file.suffix in _FILES]
    kept = [file for file in files if not left_out.intersection(file.relative_to(package.parent).parts)]
    return f"{hugwbc.__version__}+{digest(b''.join(file.read_bytes() for file in kept))[:16]}"


def _last_change(paths: tuple[str, ...]) -> str:
    """Return the newest commit on the first-parent history that changed what the files under `paths` mean."""
    commits = _git("log", "--first-parent", "--format=%H %P", "--", *paths).decode().splitlines()
    last = ""
    with contextlib.suppress(subprocess.CalledProcessError):  # a shallow clone ends before the parent
        for last, *parents in map(str.split, commits):
            if not parents or any(_changed([parents[0], last], paths)):
                break
    return last


def _changed(commits: list[str], paths: tuple[str, ...]) -> Iterator[str]:
    """Yield the files whose meaning differs between two commits, or between one and the working tree."""
    names = _names(_git("diff", "--name-only", "--no-renames", "-z", *commits, "--", *paths))
    before, after = commits[0], commits[1] if len(commits) > 1 else ""
    return (name for name in names if _meaning(before, name) != _meaning(after, name))


def _meaning(commit: str, name: str) -> object:
    """Return a file without comments and docstrings; its bytes if it is neither Python nor YAML, or cannot be read."""
    content = _content(commit, name)
    try:
        if content is not None and name.endswith(".py"):
            tree = ast.parse(content)
            for node in ast.walk(tree):
                if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                    node.body = node.body[ast.get_docstring(node, clean=False) is not None :]
            return ast.dump(tree)
        if content is not None and name.endswith(".yaml"):
            return yaml.safe_load(content)
    except (SyntaxError, ValueError, yaml.YAMLError):
        pass
    return content


def _content(commit: str, name: str) -> bytes | None:
    """Return a file of a commit, or of the working tree without one; None if it has no such file."""
    try:
        return _git("show", f"{commit}:{name}") if commit else (_root() / name).read_bytes()
    except (OSError, subprocess.CalledProcessError):
        return None


def _names(output: bytes) -> list[str]:
    return [name for name in output.decode().split("\0") if name]


def _root() -> pathlib.Path:
    return pathlib.Path(hugwbc.__file__).parents[1]


def _git(*words: str) -> bytes:
    command = ["git", "-C", str(_root()), *words]
    return subprocess.run(command, check=True, capture_output=True).stdout
