"""The robot side of a deployment: it lets the pilot decide on each state.

In real time, a relay in a process of its own reads the states, publishes the last command and damps the joints if the
states or the controller fail. In lockstep with a simulated robot, each state is answered, and the robot waits for it.
"""

import contextlib
import math
import multiprocessing
import queue
import signal
import threading
import time
from collections.abc import Callable, Iterator

from hugwbc.deploy import recording
from hugwbc.deploy.capture import GRIPS, OBJECTS, Capture, text_of_grips
from hugwbc.deploy.messages import TICK, StateMessage
from hugwbc.deploy.pilot import Pilot
from hugwbc.deploy.recording import Recorder
from hugwbc.deploy.relay import (
    DECISION,
    END,
    FADE,
    NOTE,
    PERIOD,
    POLL,
    Line,
    LineSetup,
    Relay,
    Settings,
    arrives,
    relay,
)
from hugwbc.deploy.remote import Request
from hugwbc.deploy.state_machine import Mode, damping
from hugwbc.deploy.timing import keep_apart, real_time
from hugwbc.deploy.transport import Endpoint
from hugwbc.errors import CaptureError, DeploymentError
from hugwbc.robot import Robot
from hugwbc.streams import Tally

_GONE = "the process that reads and publishes has ended"
_NEWEST = 4  # texts of a motion capture that are read at once
_PATIENCE = 10.0  # [s] for a robot that sends nothing: beyond the duration, and in lockstep between two states


class RobotSide(Line):
    """Everything between the network and the pilot."""

    def __init__(
        self,
        pilot: Pilot,
        robot: Robot,
        endpoint: Endpoint,
        settings: Settings | None = None,
        recorder: Recorder | None = None,
        tell: Callable[[str], None] = print,
        connect: Callable[[], Endpoint] | None = None,
    ) -> None:
        """Connect the parts; `run` starts them.

        Args:
            pilot: decides.
            robot: whose messages they are.
            endpoint: this end of the connection.
            settings: how the deployment runs; None for the defaults.
            recorder: records all messages and decisions.
            tell: called with the messages of the watchdogs; a function that another process can import.
            connect: makes the endpoint of the relay's process, which must be able to import it, too; without it, the
                relay is a thread of this process.
        """
        self._setup = LineSetup(robot, pilot.limits, pilot.control.period, settings or Settings(), tell)
        super().__init__(endpoint, self._setup, recorder)
        self.pilot, self._connect = pilot, connect
        self._requests: queue.SimpleQueue[Request] = queue.SimpleQueue()
        self._end = threading.Event()
        self._failure: BaseException | None = None
        self._start: float | None = None
        self._fade: float | None = None
        self._sent_decision, self._now = b"", 0.0  # in lockstep: what was answered last, and the time [s]
        self._message: bytes | None = None  # the last decision's
        self._link, self._far = multiprocessing.Pipe()  # to the relay
        self._apart = False  # whether a relay publishes
        self.captures, self.states = (Tally(name, self._tell) for name in (OBJECTS, "states"))  # what arrives
        endpoint.texts(OBJECTS)  # from now on they are heard

    def accept(self, raw: bytes, now: float) -> StateMessage | None:
        """Check a state that has arrived now [s], and say why one is refused."""
        if not self.take(raw, now):
            self.states.note("refused", self.intake.refusal)
            return None
        return self.intake.unpacked(raw)

    def ask(self, request: Request) -> None:
        """Pass on what the operator asks for; a second stop ends the program, after some more damping."""
        if request is Request.STOP and self.pilot.mode is Mode.DAMPING:
            self._end_after_damping()
        self._requests.put(request)

    def _end_after_damping(self) -> None:
        threading.Timer(FADE * self.settings.slower, self._end.set).start()

    def run(self) -> None:
        """Control the robot until the duration is over, or the operator ends it.

        Ctrl-C is raised after the joints have been damped.

        Raises:
            DeploymentError: if in lockstep the robot falls silent while its joints are driven, or else the relay ends.
        """
        with real_time():
            if self.settings.lockstep:
                self._run_lockstep()
            else:
                self._run_apart()
        if self._failure is not None:
            raise self._failure

    def handle(self, raw: bytes, state: StateMessage, arrival: float, *, behind: bool = False) -> bytes | None:
        """Let the pilot decide on a state, and return the message that answers it; `behind` if a newer one waits."""
        requests = []
        while not self._requests.empty():
            requests.append(self._requests.get())
        fault = self._outlet.fault if self.pilot.mode is not Mode.DAMPING else None
        for request in requests:
            self._record(recording.REQUEST, request.value.encode())
        if fault is not None:
            self._record(recording.FAULT, fault.encode())
        self._look()
        if behind:
            self._record(recording.BEHIND)
        self._record(recording.STATE, raw, arrival)
        decision = self.pilot.observe(state, requests, fault, behind=behind)
        if decision.new:
            self._message = None if decision.command is None else self._messages.pack_command(decision.command)
            if self.pilot.grips and not self.settings.dry_run:
                self._endpoint.publish(GRIPS, text_of_grips(self.pilot.grips))
        message = self._message
        self._record(recording.DECISION, message or b"")
        active = self.pilot.machine.active
        self._outlet.put(message, decision, active=active)
        if self._apart:
            head = DECISION.pack(decision.time, decision.new, active, decision.skipped)
            self._link.send_bytes(head + (message or b""))
        self._time_over(state.state.time)
        return message

    def _look(self) -> None:
        """Show the pilot the newest sound text of a motion capture."""
        texts = self._endpoint.texts(OBJECTS)
        if texts:
            self.captures.arrived(len(texts))
        for text in texts[: -_NEWEST - 1 : -1]:
            try:
                capture = Capture.of(text)
            except CaptureError as error:
                self.captures.note("refused", str(error))
                continue
            self._record(recording.SEEN, text.encode())
            self.pilot.see(capture)
            return

    def _time_over(self, now: float) -> None:
        """Stop when the duration is over, and end when the joints have been damped for a while."""
        self._start = now if self._start is None else self._start
        duration = self.settings.duration
        if duration is not None and self._fade is None and now - self._start >= duration:
            self._fade = now
            self._requests.put(Request.STOP)
        if self._fade is not None and now - self._fade >= FADE:
            self._end.set()

    def _run_apart(self) -> None:
        records = self._recorder is not None
        if self._connect is None:
            worker = threading.Thread(target=Relay(self._endpoint, self._setup, self._far, records=records).run)
        else:
            words = (self._connect, self._setup, self._far, records)
            worker = multiprocessing.get_context("spawn").Process(target=relay, args=words, daemon=True)
        worker.start()
        if self._connect is not None:
            self._far.close()  # so that this side sees when the other process is gone
            self._endpoint.stop_receiving()
        self._apart, last = True, self._deadline()
        control = threading.Thread(target=self._control, name="control")
        control.start()
        try:
            while not self._end.wait(POLL) and time.perf_counter() < last:
                pass
        except KeyboardInterrupt as interrupt:
            self._failure = interrupt
        with _uninterrupted():  # another one does not cut it short
            if not self._end.is_set():  # Ctrl-C, or the end by the wall clock: damp first
                self._requests.put(Request.STOP)
                last = time.perf_counter() + FADE * self.settings.slower
                while (left := last - time.perf_counter()) > 0.0 and not self._end.is_set():
                    with contextlib.suppress(KeyboardInterrupt):  # one that was on its way
                        self._end.wait(left)
            self._end.set()
            control.join()
            self._finish()
            worker.join(_PATIENCE)

    def _control(self) -> None:
        """Let the pilot decide until the end; a defect ends the deployment and is raised in the main thread."""
        try:
            keep_apart(last=True)
            while not self._end.is_set():
                notes = [self._link.recv_bytes()]
                while arrives(self._link):
                    notes.append(self._link.recv_bytes())
                states = [state for note in notes if (state := self._hear(note)) is not None]
                for index, state in enumerate(states, 1):
                    self.handle(*state, behind=index < len(states))
        except (EOFError, OSError):
            self._failure = self._failure or DeploymentError(f"{_GONE}: the robot gets no commands any more")
            self._damp()
            self._end.set()
        except BaseException as error:
            self._failure = self._failure or error
            # The relay damps, since the states are no longer answered.
            self._end_after_damping()

    def _damp(self) -> None:
        """Damp the joints for a while in the place of a relay that is gone."""
        self._tell(f"watchdog: {_GONE}: damping")
        slots = round(FADE / PERIOD) if self._message is not None and not self.settings.dry_run else 0
        for _ in range(slots):
            self._endpoint.send(self._messages.pack_command(damping(self._setup.robot)))
            time.sleep(PERIOD * self.settings.slower)

    def _hear(self, note: bytes) -> tuple[bytes, StateMessage, float] | None:
        """Take a note of the relay; return the state that it holds and its arrival, if it is a sound one."""
        if not note:
            return None
        (kind, when), content = NOTE.unpack_from(note), note[NOTE.size :]
        if kind == recording.STATE:
            state = self.accept(content, when)
            return None if state is None else (content, state, when)
        if kind == recording.FAULT:
            self._outlet.fault = content.decode()
        elif kind == recording.PUBLISHED:
            self._record(kind, content, when)
        elif kind == END:
            self.timing, self.sent = self._link.recv()
            raise EOFError
        return None

    def _finish(self) -> None:
        """Tell the relay that it is the end, and take what it still has to say."""
        try:
            self._link.send_bytes(b"")
            while arrives(self._link, _PATIENCE):
                self._hear(self._link.recv_bytes())
        except (EOFError, OSError):  # the last note, or a relay that is gone
            pass

    def _run_lockstep(self) -> None:
        last = math.inf
        try:
            while not self._end.is_set() and time.perf_counter() < last:
                if self.answer(POLL) and self._start is not None:
                    last = time.perf_counter() + _PATIENCE
            if not self._end.is_set():
                self._miss_robot()
        except KeyboardInterrupt as interrupt:  # damp, then end
            self._failure = interrupt
            self._requests.put(Request.STOP)
            end = time.perf_counter() + FADE
            while time.perf_counter() < end:
                self.answer(POLL)

    def _miss_robot(self) -> None:
        """Say that the robot has ended first, which is a failure if its joints are driven."""
        words = f"the robot has sent nothing for {_PATIENCE:g} s"
        if self.pilot.machine.active:
            self._failure = DeploymentError(
                f"{words}, and was in the mode {self.pilot.mode.value}; let the simulated robot run for longer"
            )
        else:
            self._tell(f"{words}: the end")

    def _deadline(self) -> float:
        """Return when to end by the wall clock even if the robot sends nothing [s]."""
        duration = self.settings.duration
        allowed = math.inf if duration is None else duration + FADE + _PATIENCE
        return time.perf_counter() + allowed * self.settings.slower

    def answer(self, timeout: float) -> bool:
        """Take the states that arrive within `timeout` [s], and answer the last one; return whether there was one.

        In lockstep, time goes on by a slot with each state, also a refused one, so that a series of refused states is a
        silence for the watchdog; it stands still while the robot waits.
        """
        raws = self._endpoint.receive(timeout)
        self.look_out()
        begin = time.perf_counter()
        for raw in raws:
            self._now = self._now + PERIOD if self._now else self._messages.tick(raw) * TICK
            state = self.accept(raw, self._now)
            if state is not None:
                self._sent_decision = self.handle(raw, state, self._now) or b""
            elif (fault := self.intake.fault(self._now)) is not None:
                self._outlet.fail(fault)
                self._tell_fault()
                if self.fault is not None:
                    self._sent_decision = self._messages.pack_command(damping(self._setup.robot))
        if not raws:
            return False
        if self._sent_decision and not self.settings.dry_run:
            message = self._messages.answering(self._sent_decision, raws[-1])
            self._endpoint.send(message)
            self.sent += 1
            self._record(recording.PUBLISHED, message, self._now)
        self.timing.answered((time.perf_counter() - begin) / self.settings.slower, self.pilot.control.period)
        return True


@contextlib.contextmanager
def _uninterrupted() -> Iterator[None]:
    """Ignore what ends a program meanwhile, such as a second Ctrl-C; only a main thread hears of it."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {
        number: signal.signal(number, signal.SIG_IGN) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
