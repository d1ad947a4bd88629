"""What a result depends on, as JSON: to tell whether a stored one is the one that is asked for."""

import ast
import dataclasses
import enum
import functools
import hashlib
import importlib.metadata
import inspect
import json
import pathlib
import typing
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

import hugwbc
from hugwbc.errors import ConfigError
from hugwbc.robot import load_robot

_PACKAGE = pathlib.Path(hugwbc.__file__).parent
# Libraries whose version changes a trajectory's last digits, or more.
_LIBRARIES = ("mujoco", "numpy", "pin", "placo", "proxsuite", "torch")


def to_json(value: object) -> Any:  # noqa: ANN401  whatever JSON holds
    """A value as JSON, with the names of dataclasses and enumerations, and what `identity()` gives of what has it.

    Raises:
        TypeError: if it holds what is neither JSON, nor a dataclass, an enumeration, a path, an array or a function.
    """
    if isinstance(value, enum.Enum):
        return f"{type(value).__name__}.{value.name}"
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, pathlib.PurePath):
        return str(value)
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [to_json(item) for item in value]
    if isinstance(value, dict):
        return {str(key): to_json(item) for key, item in value.items()}
    if callable(getattr(value, "identity", None)) and not isinstance(value, type):
        return to_json(value.identity())  # type: ignore[attr-defined]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {field.name: to_json(getattr(value, field.name)) for field in dataclasses.fields(value)}
        return {"type": type(value).__qualname__, **fields}
    if isinstance(value, functools.partial):
        return {"call": to_json(value.func), "args": to_json(value.args), "keywords": to_json(value.keywords)}
    name = getattr(value, "__qualname__", "<")
    if callable(value) and "<" not in name:  # neither a lambda nor a local function, which may hold anything
        return f"{value.__module__}.{name}"
    raise TypeError(f"{value!r} of type {type(value).__name__} cannot be part of a result's identity")


def digest(value: object) -> str:
    """Of anything that `to_json` takes: 32 hexadecimal digits, the same in every process."""
    text = json.dumps(to_json(value), sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def file_digest(path: pathlib.Path) -> str:
    """Of a file's bytes: 32 hexadecimal digits."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:32]


def controller_identity(factory: Callable[[], object]) -> dict[str, Any]:
    """What tells the controllers of a factory from others: what `identity()` of the factory, or of its object, gives.

    Args:
        factory: such as a `ControllerSpec`'s `build`.

    Raises:
        ConfigError: if the factory does not say.
    """
    for holder in (factory, getattr(factory, "__self__", None)):
        identity = getattr(holder, "identity", None)
        if callable(identity):
            return to_json(identity())
    raise ConfigError(
        f"results of {factory!r} cannot be stored: nothing tells its controllers from others; "
        "give it a method identity() that returns JSON, as ControllerSpec has, or store no results"
    )


def judge_module(judge: object) -> str:
    """The module of a function, of the function in a partial, or of an object's class."""
    inner = judge.func if isinstance(judge, functools.partial) else judge
    return inner.__module__ if inspect.isfunction(inner) else type(getattr(inner, "__self__", inner)).__module__


def row_type(judge: object) -> type[Any]:
    """The dataclass that a judge is annotated to return.

    Raises:
        TypeError: if it is not.
    """
    inner = judge.func if isinstance(judge, functools.partial) else judge
    call = inner if inspect.isfunction(inner) else type(inner).__call__
    result = typing.get_type_hints(call).get("return")
    if not dataclasses.is_dataclass(result) or not isinstance(result, type):
        raise TypeError(f"{judge!r} is not annotated to return a dataclass; rows that are stored need one")
    return result


def code_identity(modules: Iterable[str]) -> dict[str, Any]:
    """Of all code of this package that some modules import, of the robot's description, and of the libraries.

    Comments, docstrings and layout do not count, and no other module does: a new protocol leaves the results of the
    others as they are. Tables (.yaml) that stand beside the code do: results hold the paper's figures.

    Args:
        modules: dotted names; those outside this package are left out.
    """
    files = _imported(frozenset(modules))
    tables = sorted(table for folder in {path.parent for path in files} for table in folder.glob("*.yaml"))
    return {
        "code": digest([*(_meaning(path) for path in files), *map(file_digest, tables)]),
        "robot": [file_digest(path) for path in (load_robot().xml_path, load_robot().urdf_path)],
        "libraries": {name: _version(name) for name in _LIBRARIES},
    }


def _version(library: str) -> str | None:
    try:
        return importlib.metadata.version(library)
    except importlib.metadata.PackageNotFoundError:
        return None


@functools.lru_cache(maxsize=16)
def _imported(roots: frozenset[str]) -> tuple[pathlib.Path, ...]:
    """Files of this package that the roots are, or import, or what these import."""
    found: set[pathlib.Path] = set()
    waiting = [path for name in roots if (path := _path(name))]
    while waiting:
        path = waiting.pop()
        if path not in found:
            found.add(path)
            waiting += _imports(path)
    return tuple(sorted(found))


def _path(module: str) -> pathlib.Path | None:
    first, *rest = module.split(".")
    if first != _PACKAGE.name:
        return None
    base = _PACKAGE.joinpath(*rest)
    return next((path for path in (base.with_suffix(".py"), base / "__init__.py") if path.is_file()), None)


@functools.cache
def _tree(path: pathlib.Path) -> ast.Module:
    return ast.parse(path.read_bytes())


def _imports(path: pathlib.Path) -> list[pathlib.Path]:
    names: list[str] = []
    for node in ast.walk(_tree(path)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return [found for name in names if (found := _path(name))]


@functools.cache
def _meaning(path: pathlib.Path) -> str:
    """Digest of a file's syntax tree without its docstrings."""
    tree = _tree(path)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            node.body = node.body[1:]
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest()
