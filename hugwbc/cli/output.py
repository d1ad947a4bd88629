"""Helpers that the verbs share: options from a dataclass, JSON files and progress."""

import argparse
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
_QUIET = 2.0  # [s]; of shorter work, no line says how long it took
_RECENT, _TOGETHER = 600.0, 1.0  # [s], from which the speed follows, and within which steps count as one
_FEWEST = 3  # steps from which a speed is known
Options = TypeVar("Options")


def parse(options: type[Options], words: Sequence[str], verb: str, **given: Any) -> Options:  # noqa: ANN401  tyro's
    """Return the options of a verb from its words; exit with code 2 on an unknown or malformed option.

    What is `given` further is for `tyro.cli`, such as a description in place of the docstring of the options.
    """
    with _options_named():
        return tyro.cli(options, prog=f"hugwbc {verb}", args=_expanded(words), **given)


def parse_known(options: type[Options], words: Sequence[str], verb: str) -> tuple[Options, list[str]]:
    """Parse as `parse` does, and return the words of unknown options, too."""
    with _options_named():
        return tyro.cli(options, prog=f"hugwbc {verb}", args=_expanded(words), return_unknown_args=True)


def take(words: Sequence[str], verb: str, option: str, **given: Any) -> tuple[Any, list[str]]:  # noqa: ANN401  argparse's
    """Return the value of an option, which decides what the other words mean, and the other words."""
    parser = argparse.ArgumentParser(prog=f"hugwbc {verb}", add_help=False, allow_abbrev=False)
    parser.add_argument(option, dest="value", **given)
    found, others = parser.parse_known_args(words)
    return found.value, others


def _expanded(words: Sequence[str]) -> list[str]:
    """Return words with `~` expanded behind `=`, too; a shell expands only one at the start of a word."""
    return [re.sub("^(--[^=]+=)(~.*)", lambda it: it[1] + os.path.expanduser(it[2]), word) for word in words]


@contextlib.contextmanager
def _options_named() -> Iterator[None]:
    """Let settings' errors name options, which a user knows, and not the classes behind them."""
    try:
        yield
    except ConfigError as error:
        raise ConfigError(re.sub(r"^[A-Z]\w+\.", "", str(error))) from None


def parse_settings(settings: type[Options], words: Sequence[str], verb: str, **given: Any) -> Options:  # noqa: ANN401
    """Parse as `parse` does, for settings with groups of them inside.

    With `--help`, the settings outside any group are explained, and the groups are listed. `--help-all` explains all.
    """
    if HELP_ALL in words:
        return parse(settings, ["--help"], verb, **given)
    if not {"-h", "--help"} & set(words):
        return parse(settings, words, verb, **given)
    fields = dataclasses.fields(settings)  # pyright: ignore[reportArgumentType]
    groups = [field for field in fields if _group(field)]
    folded = [
        (each.name, Annotated[each.type, tyro.conf.Suppress], dataclasses.field(default_factory=each.default_factory))
        for each in groups
    ]
    short = dataclasses.make_dataclass(settings.__name__, folded, bases=(settings,), frozen=True)
    short.__module__ = settings.__module__  # where tyro looks for the comments beside the fields
    shown = {"description": given.get("description", inspect.getdoc(settings))}
    if (default := given.get("default")) is not None:
        shown["default"] = short(**{field.name: getattr(default, field.name) for field in fields})
    try:
        parse(short, words, verb, **shown)
    except SystemExit as finished:
        if not finished.code:
            _print(_list_groups(groups, f"hugwbc {verb} {HELP_ALL}"), sys.stdout)
        raise
    raise AssertionError("--help ends the process")


def _group(field: dataclasses.Field[Any]) -> type[Any] | None:
    """Return the group of settings that a field holds, whatever annotates it; None for a single option."""
    kind: Any = field.type
    kind = typing.get_args(kind)[0] if typing.get_origin(kind) is Annotated else kind
    return kind if isinstance(kind, type) and dataclasses.is_dataclass(kind) else None


def option_names(settings: type[Any]) -> list[str]:
    """Return the names of settings, those in groups included."""
    parts = [(field.name, _group(field)) for field in dataclasses.fields(settings)]
    return [each for name, group in parts for each in ([name] if group is None else option_names(group))]


def _list_groups(groups: Sequence[dataclasses.Field[Any]], command: str) -> str:
    """Return a line for each group of settings, those within groups included: prefix or options, and what it is."""
    rows: list[tuple[str, str]] = []

    def visit(name: str, field: dataclasses.Field[Any]) -> None:
        kind: Any = _group(field)
        about = (inspect.getdoc(kind) or "").partition(". ")[0].partition("\n")[0].rstrip(".")
        fields = dataclasses.fields(kind)
        own = [each.name for each in fields if not _group(each)]
        if kind is field.type:
            rows.append((f"--{name}.*".replace("_", "-"), f"{len(own):3} options  {about}"))
        else:
            rows.append((field.name, " ".join(f"--{each}".replace("_", "-") for each in own)))
        for each in filter(_group, fields):
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


def remark(text: str) -> None:
    """Print what is no result to standard error."""
    _print(text, sys.stderr)


def _print(text: str, stream: TextIO) -> None:
    """Print as long as the stream has a reader, so that `| head` does not stop the work that writes files."""
    try:
        try:
            print(text, file=stream, flush=True)
        except UnicodeEncodeError:  # names from a network or a file may have any characters
            print(text.encode("ascii", "backslashreplace").decode(), file=stream, flush=True)
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
    if path.is_file():
        raise ConfigError(f"{path} is a file; give a folder")
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
    text = json.dumps(finite_json(content), indent=2, default=str)
    if path == STDOUT:
        _print(text, sys.stdout)
    elif path is not None:
        write_whole(path, text + "\n")


Advance = Callable[[float], None]
"""Reports the fraction of the work that is done."""


@contextlib.contextmanager
def progress(label: str) -> Iterator[Advance]:
    """Show the progress of work on standard error: what is done, and the time left.

    On a terminal this is a bar, elsewhere a line every 5 s and, for work of 2 s or more, one with its duration.
    """
    show = _bar if sys.stderr.isatty() else _lines
    with show(label) as advance:
        yield advance


class Pace:
    """Parts of some work that were done at some times, and how long the rest takes at that pace.

    The first part, and the time up to the second one, do not count: reading what an earlier run has stored, and
    starting, take other times than the work.
    """

    def __init__(self) -> None:
        """Begin without a part."""
        self._steps: list[tuple[float, float]] = []  # times [s], and what was done by then

    def add(self, now: float, done: float) -> None:
        """Take the part that is done by now [s]."""
        if len(self._steps) > 1 and now < self._steps[-1][0] + _TOGETHER:
            self._steps[-1] = self._steps[-1][0], done  # several processes finish together
            return
        self._steps.append((now, done))
        while len(self._steps) > _FEWEST and self._steps[0][0] < now - _RECENT:
            self._steps.pop(0)  # the speed may change

    @property
    def left(self) -> str:
        """The time that the rest takes, for people; empty as long as nobody knows."""
        if len(self._steps) < _FEWEST or self._steps[-1][1] <= self._steps[1][1]:
            return ""
        (begin, before), (end, done) = self._steps[1], self._steps[-1]
        return f"about {_duration((1.0 - done) * (end - begin) / (done - before))} left"


@contextlib.contextmanager
def _bar(label: str) -> Iterator[Advance]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    ending = TextColumn("{task.percentage:3.0f} % {task.fields[left]}")
    columns = TextColumn("{task.description}"), BarColumn(), ending
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        task, pace = bars.add_task(label, total=1.0, left=""), Pace()

        def advance(fraction: float) -> None:
            pace.add(time.monotonic(), fraction)
            bars.update(task, completed=fraction, left=pace.left)

        yield advance


@contextlib.contextmanager
def _lines(label: str) -> Iterator[Advance]:
    start, pace, done = time.monotonic(), Pace(), 0.0
    over = threading.Event()

    def tell() -> None:
        # A thread prints, not `advance`: work may arrive in bursts, and the first call of one would print too early.
        told = 0.0
        while not over.wait(_LINE_INTERVAL):
            if done > told:
                told, percent = done, f"{100.0 * done:.{0 if done > 0.1 else 1}f} %"
                remark(f"{label}: {', '.join(filter(None, (percent, pace.left)))}")

    def advance(fraction: float) -> None:
        nonlocal done
        pace.add(time.monotonic(), fraction)
        done = fraction

    teller = threading.Thread(target=tell, daemon=True)
    teller.start()
    try:
        yield advance
    finally:
        over.set()
        teller.join()
    elapsed = time.monotonic() - start
    if elapsed >= _QUIET:
        remark(f"{label}: took {elapsed:.1f} s")


def _duration(seconds: float) -> str:
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"
