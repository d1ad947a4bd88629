"""Helpers that the verbs share: options from a dataclass, JSON files and progress."""

import contextlib
import dataclasses
import inspect
import json
import os
import pathlib
import re
import sys
import tempfile
import threading
import time
import typing
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, Any, TextIO, TypeVar

import tyro

from hugwbc.errors import ConfigError
from hugwbc.files import finite_json, write_whole, writing

if TYPE_CHECKING:
    from hugwbc.sim.arena import Arena

STDOUT = pathlib.Path("-")
HELP_ALL = "--help-all"
_LINE_INTERVAL = 5.0  # [s] between two lines of progress when not on a terminal
_QUIET = 2.0  # [s]; shorter work shows no progress
_RECENT, _FEWEST = 600.0, 2  # [s], calls: from which the speed follows
Options = TypeVar("Options")


def parse(
    options: type[Options], words: Sequence[str], verb: str, description: str | None, default: Options | None = None
) -> Options:
    """Return the options of a verb from its words; exit with code 2 on an unknown or malformed option."""
    description = inspect.cleandoc(description) if description else description
    given: dict[str, Any] = {} if default is None else {"default": default}
    # A shell expands only a `~` at the start of a word.
    args = [re.sub("^(--[^=]+=)(~.*)", lambda it: it[1] + os.path.expanduser(it[2]), word) for word in words]
    try:
        return tyro.cli(options, prog=f"hugwbc {verb}", description=description, args=args, **given)
    except ConfigError as error:  # a user knows options, not the classes behind them
        raise ConfigError(re.sub(r"^[A-Z]\w+\.", "", str(error))) from None


def parse_settings(
    settings: type[Options], words: Sequence[str], verb: str, description: str | None, default: Options | None = None
) -> Options:
    """Parse as `parse` does, for settings with groups of them inside.

    With `--help`, the settings outside any group are explained, and the groups are listed. `--help-all` explains all.
    """
    if HELP_ALL in words:
        return parse(settings, ["--help"], verb, description, default)
    if not {"-h", "--help"} & set(words):
        return parse(settings, words, verb, description, default)
    groups = [field for field in dataclasses.fields(_dataclass(settings)) if _is_group(field)]
    folded = [
        (
            field.name,
            Annotated[field.type, tyro.conf.Suppress],
            dataclasses.field(default_factory=field.default_factory),
        )
        for field in groups
    ]
    short = dataclasses.make_dataclass(settings.__name__, folded, bases=(settings,), frozen=True)
    short.__module__ = settings.__module__  # where tyro looks for the comments beside the fields
    try:
        parse(short, words, verb, description)
    except SystemExit as finished:
        if not finished.code:
            _print(_list_groups(groups, f"hugwbc {verb} {HELP_ALL}"), sys.stdout)
        raise
    raise AssertionError("--help ends the process")


def _dataclass(settings: type[Any]) -> type[Any]:
    assert dataclasses.is_dataclass(settings)
    return settings


def _group(field: dataclasses.Field[Any]) -> type[Any]:
    """Return the type of a field without its annotations, such as that its options have no prefix."""
    kind: Any = field.type
    return typing.get_args(kind)[0] if typing.get_origin(kind) is Annotated else kind


def _is_group(field: dataclasses.Field[Any]) -> bool:
    return dataclasses.is_dataclass(_group(field))


def _list_groups(groups: Sequence[dataclasses.Field[Any]], command: str) -> str:
    """Return a line for each group of settings, those within groups included: prefix or options, and what it is."""
    rows: list[tuple[str, str]] = []

    def visit(name: str, field: dataclasses.Field[Any]) -> None:
        kind = _group(field)
        about = (inspect.getdoc(kind) or "").partition(". ")[0].partition("\n")[0].rstrip(".")
        fields = dataclasses.fields(kind)
        own = [each.name for each in fields if not _is_group(each)]
        if kind is field.type:
            rows.append((f"--{name}.*".replace("_", "-"), f"{len(own):3} options  {about}"))
        else:
            rows.append((field.name, " ".join(f"--{each}".replace("_", "-") for each in own)))
        for each in filter(_is_group, fields):
            visit(f"{name}.{each.name}", each)

    for field in groups:
        visit(field.name, field)
    width = max(len(name) for name, _ in rows)
    lines = [f"  {name:<{width}}  {about}" for name, about in rows]
    return "\n".join(["", "groups of options:", *lines, "", f"`{command}` explains every option."])


def say(text: str, json_path: pathlib.Path | None = None) -> None:
    """Print text to standard output, or to standard error when standard output carries the JSON."""
    _print(text, sys.stderr if json_path == STDOUT else sys.stdout)


def say_arena(arena: "Arena", json_path: pathlib.Path | None = None) -> None:
    """Print how an arena differs from the default, if it does."""
    if arena.remark:
        say(f"arena: {arena.remark}, which is not the default (docs/arena.md)", json_path)


def _print(text: str, stream: TextIO) -> None:
    """Print as long as the stream has a reader, so that `| head` does not stop the work that writes files."""
    try:
        print(text, file=stream, flush=True)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def check_writable(path: pathlib.Path | None) -> None:
    """Check that a file can be written, before the work whose result it will hold."""
    if path is None or path == STDOUT:
        return
    with writing(path), _removed_if_empty(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)
        new = not path.exists()
        path.open("a").close()
        if new:  # what fails later must not leave an empty file
            path.unlink()


@contextlib.contextmanager
def output_folder(path: pathlib.Path) -> Iterator[pathlib.Path]:
    """Make a folder and check that files can be written to it, before the work whose results it will hold.

    At the end, folders that were made here and are still empty are removed: work that was refused leaves no trace.
    """
    with _removed_if_empty(path):
        with writing(path):
            path.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=path).close()
        yield path


@contextlib.contextmanager
def _removed_if_empty(path: pathlib.Path) -> Iterator[None]:
    """Remove a folder and its parents at the end if they are new and empty."""
    new = [folder for folder in (path, *path.parents) if not folder.exists()]
    try:
        yield
    finally:
        with contextlib.suppress(OSError):  # it is in use, and so are those above it
            for folder in new:
                folder.rmdir()


def write_json(path: pathlib.Path | None, content: Any) -> None:  # noqa: ANN401  whatever JSON holds
    """Write JSON to a file, to standard output for `-`, or nowhere for None. NaN becomes null."""
    text = json.dumps(finite_json(content), indent=2)
    if path == STDOUT:
        _print(text, sys.stdout)
    elif path is not None:
        write_whole(path, text + "\n")


Advance = Callable[[float], None]
"""Reports the fraction of the work that is done."""


@contextlib.contextmanager
def progress(label: str) -> Iterator[Advance]:
    """Show the progress of work that takes longer than two seconds, on standard error.

    On a terminal this is a bar, elsewhere plain lines; both give the time left at the speed so far.
    """
    show = _bar if sys.stderr.isatty() else _lines
    with show(label) as advance:
        yield advance


@contextlib.contextmanager
def _bar(label: str) -> Iterator[Advance]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:3.0f} %"))
    console = Console(stderr=True)
    with Progress(*columns, TimeRemainingColumn(), console=console, transient=True, speed_estimate_period=600) as bars:
        task = bars.add_task(label, total=1.0)
        yield lambda fraction: bars.update(task, completed=fraction)


@contextlib.contextmanager
def _lines(label: str) -> Iterator[Advance]:
    start = time.monotonic()
    calls: list[tuple[float, float]] = []  # times and fractions of the last `_RECENT` seconds
    over = threading.Event()

    def tell() -> None:
        # A thread prints, not `advance`: work may arrive in bursts, and the first call of one would print too early.
        told = 0.0
        while not over.wait(_LINE_INTERVAL):
            (begin, before), (_, done) = (calls[0], calls[-1]) if calls else ((0.0, 0.0), (0.0, 0.0))
            if done > told:
                told, rate = done, (done - before) / (time.monotonic() - begin)
                left = f", about {_duration((1.0 - done) / rate)} left" if rate > 0.0 else ""
                percent = f"{100.0 * done:.{0 if done > 0.1 else 1}f} %"
                print(f"{label}: {percent}{left}", file=sys.stderr, flush=True)

    def advance(fraction: float) -> None:
        # What was done before may have been read from earlier results in no time, and the speed may change.
        calls.append((time.monotonic(), fraction))
        while len(calls) > _FEWEST and calls[0][0] < calls[-1][0] - _RECENT:
            calls.pop(0)

    teller = threading.Thread(target=tell, daemon=True)
    teller.start()
    try:
        yield advance
    finally:
        over.set()
        teller.join()
    elapsed = time.monotonic() - start
    if elapsed >= _QUIET:
        print(f"{label}: took {elapsed:.1f} s", file=sys.stderr, flush=True)


def _duration(seconds: float) -> str:
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"
