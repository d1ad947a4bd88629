"""What users add from outside this package: Python files named on the command line, and entry points of their packages.

Both are programs of the user and run with the user's rights, like any program that is started by name. A file is run
only because its path was given as such; no file of data leads here.
"""

import contextlib
import importlib
import importlib.metadata
import importlib.util
import modulefinder
import pathlib
import sys
import traceback
import types
from collections.abc import Mapping
from importlib.metadata import EntryPoint
from typing import Any

from hugwbc.errors import ConfigError, HugwbcError
from hugwbc.files import digest, digest_of, is_own, note, noting

SUFFIX = ".py"
_IMPORTLIB = pathlib.Path(importlib.__file__).parent
_OBJECT = f"{SUFFIX}:"  # between the path of a file and the name of an object in it


def registered(group: str, kind: str, ours: Mapping[str, str] | None = None) -> dict[str, EntryPoint]:
    """Return what is registered in a group of entry points, by name, ours first; nothing is loaded.

    Args:
        group: such as "hugwbc.controllers".
        kind: what the group holds, in words, such as "controller".
        ours: entries of this package, "module:name" by name. They count in a source tree without metadata as well.
    """
    found = {name: EntryPoint(name, value, group) for name, value in (ours or {}).items()}
    for entry in importlib.metadata.entry_points(group=group):
        other = found.setdefault(entry.name, entry)
        if other.value != entry.value:
            raise ConfigError(
                f"two {kind}s are registered as '{entry.name}': {other.value} and {entry.value}; uninstall one of the "
                "packages, or let it register another name"
            )
    return found


def load_entry(entry: EntryPoint, kind: str) -> Any:  # noqa: ANN401  whatever the package registers
    """Import what an entry point names."""
    try:
        return entry.load()
    except HugwbcError:
        raise
    except Exception as error:  # the code of another package may raise anything
        raise ConfigError(
            f"{kind} '{entry.name}' ({entry.value}) cannot be loaded: {described(error)}; mend its package, or install "
            "it again"
        ) from error


def names_object(words: str) -> bool:
    """Return whether words have the form `FILE.py:NAME`."""
    return _OBJECT in words


def load_object(words: str, kind: str) -> Any:  # noqa: ANN401  whatever the file holds
    """Run a Python file (`run_file`), and return what `FILE.py:NAME` names; the kind is a word for messages."""
    path, name = split_object(words)
    module = run_file(path, kind)
    if name not in vars(module):
        own = [key for key, value in vars(module).items() if getattr(value, "__module__", None) == module.__name__]
        has = f"it has {', '.join(own)}" if own else "it defines no class or function"
        raise ConfigError(f"{path} has no '{name}'; {has}. Give {path}:NAME")
    return vars(module)[name]


def split_object(words: str) -> tuple[pathlib.Path, str]:
    """Return the path and the name of `FILE.py:NAME`."""
    path, _, name = words.rpartition(":")
    return pathlib.Path(path), name


def run_file(path: pathlib.Path, kind: str) -> types.ModuleType:
    """Run a Python file, once for each content of it in a process, and return its module; the kind is for messages."""
    try:
        code = tuple((file, digest(file.read_bytes())) for file in code_of(path))
    except OSError as error:
        raise ConfigError(f"there is no file {path}; give the path of the Python file with the {kind}") from error
    key = (path.resolve(), code)
    # A file that it read when it ran may have changed since.
    if key not in _ran or any(digest_of(name) != was for name, was in _ran[key][1].items()):
        _ran[key] = _run(*key)
    note_code(path)
    return _ran[key][0]


def note_code(path: pathlib.Path) -> None:
    """Note a Python file, the modules that it imports, and what it read when it ran in this process."""
    read = [name for (ran, _), (_, read) in _ran.items() if ran == path.resolve() for name in read]
    for file in (*code_of(path), *read):
        note(file)


def code_of(path: pathlib.Path) -> list[pathlib.Path]:
    """Return a Python file, and the modules that it and these import, but for those of installed packages."""
    finder = modulefinder.ModuleFinder([folder for folder in sys.path if is_own(folder)], excludes=["hugwbc"])
    with contextlib.suppress(SyntaxError, ValueError):  # running the file reports the error
        finder.run_script(str(path))
    found = {module.__file__ for module in finder.modules.values() if module.__file__} - {str(path)}
    return [path, *map(pathlib.Path, sorted(found))]


def source_of(entry: EntryPoint) -> pathlib.Path | None:
    """Return the Python file of an entry point's module; None if it has none."""
    with contextlib.suppress(ImportError, ValueError):  # loading the entry reports the error
        spec = importlib.util.find_spec(entry.module)
        if spec is not None and spec.origin is not None and spec.origin.endswith(SUFFIX):
            return pathlib.Path(spec.origin)
    return None


_Code = tuple[tuple[pathlib.Path, str], ...]  # files and their digests
_Ran = tuple[types.ModuleType, dict[str, str]]  # a module, and the digests of the files that it read when it ran
_imported: dict[pathlib.Path, str] = {}  # digests of modules beside files that were run
_ran: dict[tuple[pathlib.Path, _Code], _Ran] = {}


def _run(path: pathlib.Path, code: _Code) -> _Ran:
    if any(_imported.get(file, now) != now for file, now in code[1:]):  # imported before it was changed
        beside = {str(file) for file, _ in code[1:]}
        for other in [key for key, module in sys.modules.items() if getattr(module, "__file__", None) in beside]:
            del sys.modules[other]
    _imported.update(code[1:])
    # No module that is imported by name can have this one.
    name = f"{path.stem}({digest(repr(code))[:16]})"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None  # for a name that ends in .py
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up
    try:
        with noting() as read:
            spec.loader.exec_module(module)
    except Exception as error:  # the user's code may raise anything
        del sys.modules[name]
        missing = isinstance(error, ModuleNotFoundError)
        hint = "; modules beside the file are found if its folder is in PYTHONPATH" if missing else ""
        raise ConfigError(f"{path} cannot be run: {described(error)}{hint}") from error
    return module, read


def described(error: Exception) -> str:
    """Return kind, message and place of an error in somebody else's code."""
    if isinstance(error, SyntaxError):
        return f"{type(error).__name__}: {error}"
    frames = traceback.extract_tb(error.__traceback__)
    passed = ("<", str(_IMPORTLIB), __file__)  # frozen modules, and those that run files and entries
    own = [frame for frame in frames if not frame.filename.startswith(passed)]
    # Where a user's file calls us or another library wrongly, its line says more than ours.
    own = [frame for frame in own if is_own(frame.filename)] or own
    place = f" ({pathlib.Path(own[-1].filename).name}, line {own[-1].lineno})" if own else ""
    return f"{type(error).__name__}: {error}{place}"
