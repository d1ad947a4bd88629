"""The identity of a result: everything that determines it, as JSON.

A stored result counts only for a request with the same identity.
"""

import ast
import dataclasses
import enum
import functools
import hashlib
import importlib.metadata
import inspect
import json
import pathlib
import sys
import typing
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

import hugwbc
from hugwbc.errors import ConfigError
from hugwbc.files import file_digest
from hugwbc.robot import load_robot, robot_names, robot_table

_PACKAGE = pathlib.Path(hugwbc.__file__).parent
# Libraries whose version changes the last digits of a trajectory, or more.
_LIBRARIES = ("mujoco", "numpy", "pin", "placo", "proxsuite", "torch")


def to_json(value: object) -> Any:  # noqa: ANN401  whatever JSON holds
    """Return a value as JSON that keeps the names of dataclasses and enumerations.

    An object with a method `identity()` stands for what that returns.

    Raises:
        TypeError: if it contains something other than JSON, dataclasses, enumerations, paths, arrays and functions.
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
    # A lambda or a local function has a "<" in its name. Its name does not identify it: it may close over anything.
    name = getattr(value, "__qualname__", "<")
    if callable(value) and "<" not in name:
        return f"{value.__module__}.{name}"
    raise TypeError(f"{value!r} of type {type(value).__name__} cannot be part of a result's identity")


def digest(value: object) -> str:
    """Return 32 hexadecimal digits for anything that `to_json` takes, the same in every process."""
    text = json.dumps(to_json(value), sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def controller_identity(factory: Callable[[], object]) -> dict[str, Any]:
    """Return what distinguishes the controllers of a factory: `identity()` of the factory or of its bound object.

    Args:
        factory: for example the `build` method of a `ControllerSpec`.
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
    """Return the module of a function, of the function in a partial, or of the class of an object or of a method's."""
    inner = judge.func if isinstance(judge, functools.partial) else judge
    return inner.__module__ if inspect.isfunction(inner) else type(getattr(inner, "__self__", inner)).__module__


def row_type(judge: object) -> type[Any]:
    """Return the dataclass in the judge's return annotation.

    Raises:
        TypeError: if the annotation is missing or not a dataclass.
    """
    inner = judge.func if isinstance(judge, functools.partial) else judge
    call = inner if inspect.isfunction(inner) else type(inner).__call__
    result = typing.get_type_hints(call).get("return")
    if not dataclasses.is_dataclass(result) or not isinstance(result, type):
        raise TypeError(f"{judge!r} is not annotated to return a dataclass; rows that are stored need one")
    return result


def code_identity(modules: Iterable[str]) -> dict[str, Any]:
    """Return digests of the code that some modules use, of the robot's description, and the libraries' versions.

    The code is the modules themselves and everything in this package that they import, directly or through others.
    Other modules do not count, so that a new protocol leaves the results of the others valid. Comments, docstrings and
    layout do not count either. Tables (.yaml) in the folders of the code do count: results hold the paper's figures.

    Args:
        modules: dotted names. Of a module outside this package, its own file counts and what it imports of this one.
    """
    files = _imported(frozenset(modules))
    tables = sorted(table for folder in {path.parent for path in files} for table in folder.glob("*.yaml"))
    return {
        "code": digest([*(_meaning(path) for path in files), *map(file_digest, tables)]),
        "robot": [_robot_identity(name) for name in robot_names()],
        "libraries": {name: _version(name) for name in _LIBRARIES},
    }


def _robot_identity(name: str) -> list[str]:
    """Return digests of what the simulation and the controllers know of a robot."""
    robot = load_robot(name)
    return [digest(robot_table(name)), file_digest(robot.xml_path), file_digest(robot.urdf_path)]


def _version(library: str) -> str | None:
    try:
        return importlib.metadata.version(library)
    except importlib.metadata.PackageNotFoundError:
        return None


@functools.lru_cache(maxsize=16)
def _imported(roots: frozenset[str]) -> tuple[pathlib.Path, ...]:
    """Return the files of this package that the roots are or import, directly or through others."""
    found: set[pathlib.Path] = set()
    waiting = [path for name in roots if (path := _path(name) or _file_outside(name))]
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


def _file_outside(module: str) -> pathlib.Path | None:
    """Return the Python file of a loaded module of another package: a judge of the user's own."""
    if module.partition(".")[0] == _PACKAGE.name:
        return None
    path = pathlib.Path(getattr(sys.modules.get(module), "__file__", None) or "")
    return path if path.suffix == ".py" else None


@functools.cache
def _tree(path: pathlib.Path) -> ast.Module:
    return ast.parse(path.read_bytes())


def _imports(path: pathlib.Path) -> list[pathlib.Path]:
    """Return the files that the import statements of a file lead to, those inside functions included."""
    found: list[pathlib.Path | None] = []
    for node in ast.walk(_tree(path)):
        if isinstance(node, ast.Import):
            found += [_path(alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            found += [_source(node.module, alias.name) for alias in node.names]
    return [source for source in found if source is not None]


def _source(module: str, name: str) -> pathlib.Path | None:
    """Return the file behind `from module import name`.

    A room's `__init__` passes names on from its modules. Following the name to the module that defines it, instead of
    counting the `__init__` with all that it imports, makes a result depend on what it uses and not on the whole room.
    """
    submodule, door = _path(f"{module}.{name}"), _path(module)
    if submodule is not None or door is None or door.name != "__init__.py":
        return submodule or door
    for node in _tree(door).body:
        if isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                if (alias.asname or alias.name) == name:
                    return _source(node.module, alias.name)
    return door


@functools.cache
def _meaning(path: pathlib.Path) -> str:
    """Return a digest of a file's syntax tree without its docstrings."""
    tree = _tree(path)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            node.body = node.body[1:]
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest()
