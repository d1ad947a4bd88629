"""The ledger of a run: what every session has spent on every stage, killed sessions and discarded work included."""

import contextlib
import dataclasses
import datetime
import fcntl
import json
import os
import pathlib
import resource
import shutil
import subprocess
import time
from collections.abc import Iterator
from typing import Any

from hugwbc.errors import RecipeError
from hugwbc.files import write_whole
from hugwbc.learned.policy.records import versions

SESSIONS, LOCK = "sessions", "run.lock"
_WRITE_INTERVAL = 5.0  # [s]; what a killed process has spent since the last write is not in the ledger
UNKNOWN = "unknown"


@dataclasses.dataclass(frozen=True)
class Spent:
    """Work and computing time.

    Attributes:
        cpu_seconds: processor time of all threads and child processes [s].
        wall_seconds: time on the clock [s].
        steps: environment steps of trainings.
        labels: labels collected from teachers.
        episodes: episodes of evaluations.
    """

    cpu_seconds: float = 0.0
    wall_seconds: float = 0.0
    steps: float = 0.0
    labels: float = 0.0
    episodes: float = 0.0

    def __add__(self, other: "Spent") -> "Spent":
        return Spent(*(a + b for a, b in zip(dataclasses.astuple(self), dataclasses.astuple(other), strict=True)))

    def __sub__(self, other: "Spent") -> "Spent":
        return Spent(*(a - b for a, b in zip(dataclasses.astuple(self), dataclasses.astuple(other), strict=True)))

    @property
    def core_hours(self) -> float:
        """Processor time in hours."""
        return self.cpu_seconds / 3600.0

    @classmethod
    def read(cls, content: Any) -> "Spent":  # noqa: ANN401  JSON
        """Build from JSON.

        Raises:
            ValueError: if the content is not what `dataclasses.asdict` gave.
        """
        names = {field.name for field in dataclasses.fields(cls)}
        if not isinstance(content, dict) or set(content) != names:
            raise ValueError("not a record of computing time")
        return cls(**{name: float(value) for name, value in content.items()})


def cpu_seconds() -> float:
    """Return the processor time of this process and of its children that have ended [s]."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def now() -> str:
    """Return the date and time in UTC."""
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")


def source_state() -> tuple[str, bool]:
    """Return the commit of the source tree and whether it had uncommitted changes; "unknown" outside of a checkout."""
    git, folder = shutil.which("git"), pathlib.Path(__file__).parent
    if git is None:
        return UNKNOWN, False
    try:
        commit = _git(git, folder, "rev-parse", "HEAD")
        changed = _git(git, folder, "status", "--porcelain", "--untracked-files=no")
    except (OSError, subprocess.SubprocessError):
        return UNKNOWN, False
    return commit, bool(changed)


def _git(git: str, folder: pathlib.Path, *words: str) -> str:
    done = subprocess.run([git, "-C", str(folder), *words], capture_output=True, text=True, check=True, timeout=20)
    return done.stdout.strip()


class Session:
    """One process that works on a run: it writes what it spends on which stage, every few seconds and at its end."""

    def __init__(self, folder: pathlib.Path) -> None:
        """Begin a session in the folder of a run."""
        numbers = [int(path.stem) for path in (folder / SESSIONS).glob("*.json") if path.stem.isdecimal()]
        self.number = max(numbers, default=0) + 1
        self._path = folder / SESSIONS / f"{self.number:04d}.json"
        commit, changed = source_state()
        self._record: dict[str, Any] = {
            "began": now(),
            "commit": commit,
            "uncommitted_changes": changed,
            "versions": versions(),
            "cores": os.cpu_count(),
            "ended": None,
        }
        self._spent: dict[str, Spent] = {}
        self._stage: str | None = None
        self._mark = (cpu_seconds(), time.monotonic())
        self._written = -_WRITE_INTERVAL
        self.write()

    def enter(self, stage: str | None) -> None:
        """Book what follows on a stage, named as its folder is; None for the time between stages."""
        self._book()
        self._stage = stage
        self.write()

    def work(self, *, steps: float = 0.0, labels: float = 0.0, episodes: float = 0.0) -> None:
        """Book work on the current stage; the file is written if the last time is a few seconds ago."""
        key = self._stage or ""
        self._spent[key] = self._spent.get(key, Spent()) + Spent(steps=steps, labels=labels, episodes=episodes)
        if time.monotonic() - self._written >= _WRITE_INTERVAL:
            self.write()

    def write(self) -> None:
        """Write the record of the session."""
        self._book()
        spent = {stage: dataclasses.asdict(one) for stage, one in self._spent.items()}
        write_whole(self._path, json.dumps({**self._record, "spent": spent}, indent=1) + "\n")
        self._written = time.monotonic()

    def end(self, how: str) -> None:
        """Write the end of the session and how it came about."""
        self._record["ended"] = f"{now()} {how}"
        self.write()

    def _book(self) -> None:
        cpu, wall = cpu_seconds(), time.monotonic()
        key = self._stage or ""
        passed = Spent(cpu_seconds=cpu - self._mark[0], wall_seconds=wall - self._mark[1])
        self._spent[key] = self._spent.get(key, Spent()) + passed
        self._mark = (cpu, wall)


@dataclasses.dataclass(frozen=True)
class SessionRecord:
    """What the file of a session says.

    Attributes:
        number: number of the session.
        began, ended: date and time; `ended` also says how, and is None of a process that was killed.
        commit: commit of the source tree.
        uncommitted_changes: whether the tree had changes that are in no commit.
        versions: versions of Python, machine and packages.
        spent: what was spent by stage; "" between stages.
    """

    number: int
    began: str
    ended: str | None
    commit: str
    uncommitted_changes: bool
    versions: dict[str, str]
    spent: dict[str, Spent]


def read_sessions(folder: pathlib.Path) -> list[SessionRecord]:
    """Return the sessions of a run in their order.

    Raises:
        RecipeError: if the file of a session is damaged.
    """
    found = []
    for path in sorted((folder / SESSIONS).glob("*.json")):
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            spent = {stage: Spent.read(one) for stage, one in content.pop("spent").items()}
            names = {field.name for field in dataclasses.fields(SessionRecord)} - {"number", "spent"}
            own = {name: content[name] for name in names}
            found.append(SessionRecord(number=int(path.stem), spent=spent, **own))
        except (OSError, ValueError, KeyError, AttributeError, TypeError) as error:
            raise RecipeError(
                f"{path} is not a readable record of a session ({error}); without it the computing time is not counted "
                "in full. Copy it back from where the run was before, or start a new run in another folder"
            ) from error
    return found


def spent_on(sessions: list[SessionRecord], stage: str | None = None) -> Spent:
    """Return what all sessions have spent on a stage, or on everything."""
    total = Spent()
    for session in sessions:
        for name, spent in session.spent.items():
            if stage in (None, name):
                total += spent
    return total


@contextlib.contextmanager
def only_process(folder: pathlib.Path) -> Iterator[None]:
    """Keep other processes from working on the same run; a killed process leaves no lock behind.

    Raises:
        RecipeError: if another process works on it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / LOCK).open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise RecipeError(
                f"another process is working on {folder}; wait for it or stop it. "
                f"`hugwbc recipe status {folder}` shows how far it is"
            ) from error
        yield
