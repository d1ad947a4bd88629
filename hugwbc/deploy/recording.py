"""Recordings of a deployment: every message and decision, for a replay bit for bit.

A recording is a line of JSON (what was run) and a zlib stream of entries: kind, time, length, content. What a killed
process leaves behind can be read up to its last flush.
"""

import dataclasses
import json
import pathlib
import queue
import struct
import threading
import zlib
from collections.abc import Iterator
from typing import Any, BinaryIO

from hugwbc.deploy.capture import LONGEST, Capture
from hugwbc.deploy.messages import Messages
from hugwbc.deploy.pilot import Pilot
from hugwbc.deploy.remote import Request
from hugwbc.deploy.watchdogs import Intake
from hugwbc.errors import ConfigError
from hugwbc.files import writing
from hugwbc.state import RobotState

FORMAT = "hugwbc deployment 1"
# Kinds of entries: a state that the pilot took; one that was refused; a request; a fault; the pilot's command (empty
# while nothing is to be sent); a published command; what a motion capture saw; that the next state was not the newest
# one.
STATE, REFUSED, REQUEST, FAULT, DECISION, PUBLISHED, SEEN, BEHIND = b"S", b"X", b"R", b"F", b"D", b"P", b"O", b"B"
_KINDS = (STATE, REFUSED, REQUEST, FAULT, DECISION, PUBLISHED, SEEN, BEHIND)
_ENTRY = struct.Struct("<cdI")
_LONGEST_HEADER, _LONGEST_ENTRY = 1 << 20, 4 * LONGEST  # bytes; a character has up to four
_FLUSH_EVERY = 500  # entries
_WAITING = 50_000  # entries that may wait for a slow disk


class Recorder:
    """A writer of recordings, in a thread of its own so that a slow disk delays nothing."""

    def __init__(self, path: pathlib.Path, header: dict[str, Any]) -> None:
        """Open a file, which is replaced, and write what is run as its header."""
        self.failure: str | None = None  # why the recording is not complete
        self._entries: queue.Queue[bytes | None] = queue.Queue(maxsize=_WAITING)
        with writing(path):
            self._file: BinaryIO = path.open("wb")
            self._file.write(json.dumps({"format": FORMAT, **header}).encode() + b"\n")
        self._thread = threading.Thread(target=self._write, name="recorder", daemon=True)
        self._thread.start()

    def add(self, kind: bytes, time: float, content: bytes = b"") -> None:
        """Record an entry at a time [s]; if too many wait, it is lost, and `failure` says so."""
        content = content[:_LONGEST_ENTRY]  # a message that was refused may have any size
        try:
            self._entries.put_nowait(_ENTRY.pack(kind, time, len(content)) + content)
        except queue.Full:
            self.failure = "the disk is too slow"

    def _write(self) -> None:
        stream, count, entry = zlib.compressobj(1), 0, b""
        try:
            while (entry := self._entries.get()) is not None:
                self._file.write(stream.compress(entry))
                count += 1
                if count % _FLUSH_EVERY == 0:
                    self._file.write(stream.flush(zlib.Z_SYNC_FLUSH))
                    self._file.flush()
            self._file.write(stream.flush())
        except OSError as error:
            self.failure = str(error.strerror)
            while entry is not None:
                entry = self._entries.get()

    def close(self) -> None:
        """Write what is left and close the file."""
        self._entries.put(None)
        self._thread.join()
        try:
            self._file.close()
        except OSError as error:
            self.failure = self.failure or str(error.strerror)


@dataclasses.dataclass(frozen=True)
class Entry:
    """One entry of a recording; see the kinds above."""

    kind: bytes  # of the entry
    time: float  # when it happened, on the clock of the robot side [s]
    content: bytes  # message or text


class Recording:
    """A recording that is read from a file."""

    def __init__(self, path: pathlib.Path) -> None:
        """Read the header."""
        self._path = path
        if not path.is_file():
            raise ConfigError(f"there is no recording {path}; give the path of a file that --record has written")
        try:
            with path.open("rb") as file:
                line = file.readline(_LONGEST_HEADER)
            header = json.loads(line)
        except (OSError, ValueError, RecursionError) as error:
            raise self._error("it has no header") from error
        if not isinstance(header, dict) or header.get("format") != FORMAT:
            raise self._error(f"its format is not '{FORMAT}'")
        self.header = header  # what was run

    def _error(self, what: str) -> ConfigError:
        return ConfigError(f"{self._path} is not a recording of a deployment: {what}; record it again with --record")

    def entries(self) -> Iterator[Entry]:
        """Yield the entries; one that was cut off ends the recording."""
        waiting = b""
        for data in self._data():
            waiting += data
            while len(waiting) >= _ENTRY.size:
                kind, time, length = _ENTRY.unpack_from(waiting)
                if kind not in _KINDS or length > _LONGEST_ENTRY:
                    raise self._error("an entry is damaged")
                end = _ENTRY.size + length
                if len(waiting) < end:
                    break
                yield Entry(kind, time, waiting[_ENTRY.size : end])
                waiting = waiting[end:]

    def _data(self) -> Iterator[bytes]:
        stream = zlib.decompressobj()
        with self._path.open("rb") as file:
            file.readline(_LONGEST_HEADER)
            while block := file.read(_LONGEST_ENTRY):
                while block:
                    try:
                        yield stream.decompress(block, _LONGEST_ENTRY)
                    except zlib.error as error:
                        raise self._error("its data are damaged") from error
                    block = stream.unconsumed_tail


@dataclasses.dataclass(frozen=True)
class ReplayResult:
    """The comparison of a replay with its recording."""

    states: int  # states that the pilot took
    decisions: int  # its commands
    different: int  # commands that differ in any bit
    first: float | None  # time of the first one that does [s]; None if none does
    last: RobotState | None  # the last state that the pilot took; None if it took none


def replay(recording: Recording, pilot: Pilot, messages: Messages, age: float) -> ReplayResult:
    """Feed a recording to a new pilot, built as the recorded one was, and compare its commands with the recorded ones.

    The age of a reading when it arrives [s] is that of the recording.
    """
    intake = Intake(messages, pilot.limits, age)
    requests: list[Request] = []
    fault: str | None = None
    behind = False
    command = b""
    states = decisions = different = 0
    first, last = None, None
    for entry in recording.entries():
        if entry.kind == REQUEST:
            requests.append(Request(entry.content.decode()))
        elif entry.kind == FAULT:
            fault = entry.content.decode()
        elif entry.kind == BEHIND:
            behind = True
        elif entry.kind == SEEN:
            pilot.see(Capture.of(entry.content.decode()))
        elif entry.kind == STATE:
            state = intake.accept(entry.content, entry.time)
            if state is not None:
                states, last = states + 1, state.state
                decided = pilot.observe(state, requests, fault, behind=behind).command
                command = b"" if decided is None else messages.pack_command(decided)
                requests, fault, behind = [], None, False
        elif entry.kind == DECISION:
            decisions += 1
            if entry.content != command:
                different += 1
                first = entry.time if first is None else first
    return ReplayResult(states, decisions, different, first, last)
