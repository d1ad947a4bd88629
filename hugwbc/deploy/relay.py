"""What is between the network and the pilot: states are read and checked, commands published, both sides watched.

In real time this is a process of its own, so that a busy, hanging or dead controller delays no command and no watchdog.
"""

import collections
import contextlib
import dataclasses
import functools
import math
import os
import select
import struct
import threading
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Annotated

from pydantic import Field

from hugwbc.deploy import recording
from hugwbc.deploy.messages import Messages
from hugwbc.deploy.pilot import Decision
from hugwbc.deploy.recording import Recorder
from hugwbc.deploy.state_machine import damping
from hugwbc.deploy.timing import Timing, keep_apart, real_time
from hugwbc.deploy.transport import Endpoint
from hugwbc.deploy.watchdogs import Intake, Limits
from hugwbc.robot import Robot
from hugwbc.settings import Share, settings

PERIOD = 0.002  # [s] between two commands
FADE = 2.0  # [s] of damping at the end of a deployment
RIVAL = "another program commands this robot"
POLL = 0.05  # [s], longest wait of a thread before it looks whether to end
END = b"E"  # kind of a relay's last note, before its figures; the others are those of a recording
NOTE = struct.Struct("<cd")  # head of a note to the pilot: kind, time [s]
DECISION = struct.Struct("<d??I")  # head of a message from the pilot: the state's time [s], new, active, skipped
Slower = Annotated[float, Field(ge=1.0, le=1000.0)]


@settings
class Settings:
    """How a deployment runs."""

    lockstep: bool = False  # answer each state of a simulated robot, which waits; never with a real robot
    # how many times slower than the wall clock the (simulated) robot runs
    slower: Slower = 1.0
    dry_run: bool = False  # do everything but publish and release the motion modes
    age: Share = 0.0  # assumed age of a reading when it arrives [s]
    # end after this time since the first state, on the robot's clock [s]; without it, the operator ends it
    duration: Annotated[float, Field(gt=0.0, allow_inf_nan=True)] | None = None


def arrives(link: Connection, timeout: float = 0.0) -> bool:
    """Return whether something arrives on a link within a time [s]; exact to microseconds, unlike `Connection.poll`."""
    try:
        return bool(select.select([link], [], [], timeout)[0])
    except ValueError:  # of a process with more than a thousand open files
        return link.poll(timeout)


class Outlet:
    """The published command: the pilot's last one, or damping after a fault."""

    def __init__(self, intake: Intake, late: float, period: float, damping: Callable[[], bytes]) -> None:
        """Begin with nothing to send.

        The pilot may lag behind by `late` [s]; a command that takes longer than the controller's period [s] is a missed
        deadline; `damping` returns the message that damps the joints.
        """
        self._intake, self._late, self._period, self._damping = intake, late, period, damping
        self._lock = threading.Lock()
        self._unanswered: collections.deque[tuple[float, float]] = collections.deque()  # time of a state, its arrival
        self._message: bytes | None = None
        self._active = False
        self._arrival: float | None = None  # of the state that a message not yet sent answers
        self._skipped = 0  # periods left out before it
        self.fault: str | None = None  # what has failed, for the pilot to note

    def arrived(self, time: float, now: float) -> None:
        """Note that a state of a time [s] has arrived now [s]."""
        with self._lock:
            self._unanswered.append((time, now))

    def put(self, message: bytes | None, decision: Decision, *, active: bool) -> None:
        """Take the pilot's decision and its message, None to send nothing; while it is active, a fault damps."""
        with self._lock:
            while self._unanswered and self._unanswered[0][0] <= decision.time:
                arrival = self._unanswered.popleft()[1]
                self._arrival = arrival if decision.new else self._arrival
            self._skipped += decision.skipped
            self._message, self._active = message, active

    def fail(self, fault: str) -> None:
        """Damp if the pilot drives the joints."""
        with self._lock:
            if self._active and self.fault is None:
                self.fault = fault

    def take(self, now: float, timing: Timing) -> bytes | None:
        """Return what to send now [s]; None if nothing."""
        with self._lock:
            message, arrival = self._message, self._arrival
            if message is None:
                return None
            if self._active and self.fault is None:
                waiting = now - self._unanswered[0][1] if self._unanswered else 0.0
                self.fault = self._intake.fault(now)
                if self.fault is None and waiting > self._late:
                    self.fault = f"the controller is {waiting * 1e3:.0f} ms late"
            self._arrival, skipped = None, self._skipped
            if arrival is not None:
                self._skipped = 0
        if self.fault is not None:
            return self._damping()
        if arrival is not None:
            timing.answered(now - arrival, self._period, skipped)
        return message


@dataclasses.dataclass(frozen=True)
class LineSetup:
    """How states are checked and the joints damped; it can be sent to another process."""

    robot: Robot  # whose messages they are
    limits: Limits  # of the watchdogs
    period: float  # of the controller [s]
    settings: Settings  # how the deployment runs
    tell: Callable[[str], None]  # called with the watchdogs' messages


class Line:
    """The checks of what arrives, and the watchdogs of what is sent."""

    def __init__(self, endpoint: Endpoint, setup: LineSetup, recorder: Recorder | None = None) -> None:
        """Begin with nothing to send."""
        self.settings = setup.settings
        self._endpoint, self._recorder, self._tell = endpoint, recorder, setup.tell
        self._messages = Messages(setup.robot)
        self.intake = Intake(self._messages, setup.limits, self.settings.age)  # counts what arrives
        self.timing = Timing(PERIOD)  # latency and jitter, on the robot's clock
        # Packed when it is needed, for the variant of the robot that has sent states until then.
        damped = functools.partial(self._messages.pack_command, damping(setup.robot))
        self._outlet = Outlet(self.intake, setup.limits.late, setup.period, damped)
        self.sent, self._told = 0, False  # commands; whether the fault was told
        self._rivalled = False  # whether a second program was told

    @property
    def fault(self) -> str | None:
        """What the watchdogs have found; None if nothing."""
        return self._outlet.fault

    def now(self) -> float:
        """Return the time at the robot's pace [s]."""
        return time.perf_counter() / self.settings.slower

    def _record(self, kind: bytes, content: bytes = b"", when: float | None = None) -> None:
        if self._recorder is not None:
            self._recorder.add(kind, self.now() if when is None else when, content)

    def take(self, raw: bytes, now: float) -> bool:
        """Check a state that has arrived now [s]; return whether it is accepted."""
        fresh = self.intake.check(raw, now)
        if fresh:
            self._outlet.arrived(self.intake.time, now)
        else:
            self._record(recording.REFUSED, raw, now)
        return fresh

    def look_out(self) -> None:
        """Damp from the moment when another program commands the robot, too, and tell it once."""
        if self.settings.dry_run or not self._endpoint.rivals():
            return
        self._outlet.fail(RIVAL)
        if not self._rivalled:
            self._rivalled = True
            self._tell(f"{RIVAL}; end one of the two")

    def _tell_fault(self) -> None:
        """Tell, once, what the watchdogs have found."""
        if self.fault is not None and not self._told:
            self._told = True
            self._tell(f"watchdog: {self.fault}: damping")

    def publish(self, now: float) -> None:
        """Send what is due now [s]."""
        message = self._outlet.take(now, self.timing)
        if message is not None and not self.settings.dry_run:
            self._endpoint.send(message)
            self.sent += 1
            self._record(recording.PUBLISHED, message, now)
        self._tell_fault()


class Relay(Line):
    """A line whose pilot is in another process.

    One thread passes on what arrives, the other one publishes: each new command at once, the last one every 2 ms. When
    the pilot's process ends without a word, the relay damps the joints for a while.
    """

    def __init__(self, endpoint: Endpoint, setup: LineSetup, link: Connection, *, records: bool) -> None:
        """Connect the network with the pilot at the other end of a link; with `records`, it is told what is sent."""
        super().__init__(endpoint, setup)
        self._link, self._records = link, records
        self._notes: collections.deque[bytes] = collections.deque()
        self._over = threading.Event()

    def run(self) -> None:
        """Work until the pilot says that it is the end, or its process is gone."""
        reader = threading.Thread(target=self._read, name="reader")
        reader.start()
        try:
            self._publish()
        finally:
            self._over.set()
            reader.join()
            with contextlib.suppress(OSError):
                self._link.send_bytes(NOTE.pack(END, self.now()))
                self._link.send((self.timing, self.sent))

    def _record(self, kind: bytes, content: bytes = b"", when: float | None = None) -> None:
        if self._records and kind == recording.PUBLISHED:  # the pilot's side records the rest
            self._notes.append(NOTE.pack(kind, when) + content)

    def _read(self) -> None:
        told = False
        with contextlib.suppress(OSError):  # the pilot's process is gone
            while not self._over.is_set():
                raws = self._endpoint.receive(POLL)
                self.look_out()
                for raw in raws:
                    now = self.now()
                    self._link.send_bytes(NOTE.pack(recording.STATE, now) + raw)
                    self.take(raw, now)
                if self.fault is not None and not told:
                    self._notes.append(NOTE.pack(recording.FAULT, self.now()) + self.fault.encode())
                    told = True
                if not raws:
                    self._notes.append(b"")  # lets the pilot's side look whether to end
                while self._notes:
                    self._link.send_bytes(self._notes.popleft())

    def _publish(self) -> None:
        slot, period, end = time.perf_counter(), PERIOD * self.settings.slower, math.inf
        while (now := time.perf_counter()) < end:
            slot = max(slot + period, now)  # slots that were missed are left out
            try:
                while arrives(self._link, max(slot - time.perf_counter(), 0.0)):
                    packed = self._link.recv_bytes()
                    if not packed:
                        return
                    if self._put(packed):
                        slot = time.perf_counter()
                        break
            except (EOFError, OSError):
                self._outlet.fail("the controller's process has ended")
                end = min(end, now + FADE * self.settings.slower)
                time.sleep(max(slot - time.perf_counter(), 0.0))
            self.publish(self.now())
            self.timing.published(self.now())

    def _put(self, packed: bytes) -> bool:
        """Take the pilot's answer to a state; return whether its command is new."""
        when, new, active, skipped = DECISION.unpack_from(packed)
        message = packed[DECISION.size :] or None
        self._outlet.put(message, Decision(when, None, new=new, skipped=skipped), active=active)
        return new


def relay(connect: Callable[[], Endpoint], setup: LineSetup, link: Connection, records: bool) -> None:
    """Run a relay with a connection of its own, as a process."""
    # Keys of the terminal, such as Ctrl-C and Ctrl-Z, are for the pilot's process, which this one outlives.
    os.setsid()
    keep_apart(last=False)
    endpoint = connect()
    try:
        with real_time():
            Relay(endpoint, setup, link, records=records).run()
    finally:
        endpoint.close()
