"""The robot side of a deployment: it reads states, lets the pilot decide, and publishes at 500 Hz.

Three threads share the work. The reader takes states from the network and checks them. The controller's thread feeds
them to the pilot. The publisher sends the last command every 2 ms and damps the joints if the states or the controller
fail, whatever the other two threads do.

In lockstep with a simulated robot there is one thread: each state is answered, and the simulated robot waits for it.
"""

import collections
import math
import queue
import threading
import time
from collections.abc import Callable
from typing import Annotated

from pydantic import Field

from hugwbc.deploy import recording
from hugwbc.deploy.capture import GRIPS, OBJECTS, Capture, text_of_grips
from hugwbc.deploy.messages import Messages, StateMessage
from hugwbc.deploy.pilot import Decision, Pilot
from hugwbc.deploy.recording import Recorder
from hugwbc.deploy.remote import Request
from hugwbc.deploy.state_machine import Mode
from hugwbc.deploy.timing import Timing, real_time
from hugwbc.deploy.transport import Endpoint
from hugwbc.deploy.watchdogs import Intake
from hugwbc.errors import CaptureError
from hugwbc.robot import Robot
from hugwbc.settings import Share, settings

PERIOD = 0.002  # [s] between two commands
FADE = 2.0  # [s] of damping at the end of a deployment
_PATIENCE = 10.0  # [s] for a robot that sends nothing: beyond the duration, and in lockstep between two states
_POLL = 0.05  # [s], longest wait of a thread before it looks whether to end
Slower = Annotated[float, Field(ge=1.0, le=1000.0)]


class Outlet:
    """The published command: the pilot's last one, or damping after a fault."""

    def __init__(self, intake: Intake, late: float, period: float, damping: bytes) -> None:
        """Begin with nothing to send.

        The pilot may lag behind by `late` [s]; a command that takes longer than the controller's period [s] is a missed
        deadline; the message `damping` damps the joints.
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
        """Take the pilot's decision and its message, None to send nothing; an active one ends at a fault."""
        with self._lock:
            while self._unanswered and self._unanswered[0][0] <= decision.time:
                arrival = self._unanswered.popleft()[1]
                self._arrival = arrival if decision.new else self._arrival
            self._skipped += decision.skipped
            self._message, self._active = message, active

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
            return self._damping
        if arrival is not None:
            timing.answered(now - arrival, self._period, skipped)
        return message


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


class RobotSide:
    """Everything between the network and the pilot."""

    def __init__(
        self,
        pilot: Pilot,
        robot: Robot,
        endpoint: Endpoint,
        settings: Settings | None = None,
        recorder: Recorder | None = None,
        tell: Callable[[str], None] = lambda text: None,
    ) -> None:
        """Connect the parts; `run` starts them. `tell` is called with the messages of the publisher's watchdogs."""
        self._tell = tell
        self.pilot, self.settings = pilot, settings or Settings()
        self._endpoint, self._recorder = endpoint, recorder
        self._messages = Messages(robot)
        self.intake = Intake(self._messages, pilot.limits, self.settings.age)  # counts what arrives
        self.timing = Timing(PERIOD)  # latency and jitter, on the robot's clock
        damping = self._messages.pack_command(pilot.damped())
        self._outlet = Outlet(self.intake, pilot.limits.late, pilot.safe.period, damping)
        self._asked: queue.SimpleQueue[Request] = queue.SimpleQueue()
        self._states: queue.SimpleQueue[tuple[bytes, StateMessage, float] | None] = queue.SimpleQueue()
        self._end = threading.Event()
        self._failure: BaseException | None = None
        self._start: float | None = None
        self._fade: float | None = None
        self._sent_decision = b""
        self._message: bytes | None = None  # the last decision's
        self.sent = self.unseen = 0  # commands sent, and texts of a motion capture refused
        endpoint.texts(OBJECTS)  # from now on they are heard

    def ask(self, request: Request) -> None:
        """Pass on what the operator asks for; a second stop ends the program."""
        if request is Request.STOP and self.pilot.mode is Mode.DAMPING:
            self._end.set()
        self._asked.put(request)

    @property
    def fault(self) -> str | None:
        """What the publisher's watchdogs have found; None if nothing."""
        return self._outlet.fault

    def now(self) -> float:
        """Return the time at the robot's pace [s]."""
        return time.perf_counter() / self.settings.slower

    def run(self) -> None:
        """Control the robot until the duration is over, or the operator ends it.

        Ctrl-C is raised after the joints have been damped.
        """
        with real_time():
            if self.settings.lockstep:
                self._run_lockstep()
            else:
                self._run_threads()
        if self._failure is not None:
            raise self._failure

    def _record(self, kind: bytes, content: bytes = b"", when: float | None = None) -> None:
        if self._recorder is not None:
            self._recorder.add(kind, self.now() if when is None else when, content)

    def accept(self, raw: bytes, now: float) -> StateMessage | None:
        """Check a state that has arrived now [s]; None if it is refused."""
        state = self.intake.accept(raw, now)
        if state is None:
            self._record(recording.REFUSED, raw, now)
        else:
            self._outlet.arrived(state.state.time, now)
        return state

    def handle(self, raw: bytes, state: StateMessage, arrival: float, *, behind: bool = False) -> bytes | None:
        """Let the pilot decide on a state, and return the message that answers it; `behind` if a newer one waits."""
        asked = []
        while not self._asked.empty():
            asked.append(self._asked.get())
        fault = self._outlet.fault if self.pilot.mode is not Mode.DAMPING else None
        for request in asked:
            self._record(recording.REQUEST, request.value.encode())
        if fault is not None:
            self._record(recording.FAULT, fault.encode())
        self._look()
        if behind:
            self._record(recording.BEHIND)
        self._record(recording.STATE, raw, arrival)
        decision = self.pilot.observe(state, asked, fault, behind=behind)
        if decision.new:
            self._message = None if decision.command is None else self._messages.pack_command(decision.command)
            self._grip()
        message = self._message
        self._record(recording.DECISION, message or b"")
        self._outlet.put(message, decision, active=self.pilot.machine.active)
        self._time_over(state.state.time)
        return message

    def _look(self) -> None:
        """Show the pilot the newest sound text of a motion capture."""
        for text in reversed(self._endpoint.texts(OBJECTS)):
            try:
                capture = Capture.of(text)
            except CaptureError as error:
                self.unseen += 1
                if self.unseen == 1:
                    self._tell(f"a text on {OBJECTS} was refused: {error}")
                continue
            self._record(recording.SEEN, text.encode())
            self.pilot.see(capture)
            return

    def _grip(self) -> None:
        """Ask the grippers for what the pilot's source wants now."""
        if self.pilot.grips and not self.settings.dry_run:
            self._endpoint.publish(GRIPS, text_of_grips(self.pilot.grips))

    def _time_over(self, now: float) -> None:
        """Stop when the duration is over, and end when the joints have been damped for a while."""
        self._start = now if self._start is None else self._start
        duration = self.settings.duration
        if duration is not None and self._fade is None and now - self._start >= duration:
            self._fade = now
            self._asked.put(Request.STOP)
        if self._fade is not None and now - self._fade >= FADE:
            self._end.set()

    def publish(self, now: float) -> None:
        """Send what is due now [s]."""
        known = self._outlet.fault
        message = self._outlet.take(now, self.timing)
        if self._outlet.fault is not None and known is None and self.pilot.mode is not Mode.DAMPING:
            self._tell(f"watchdog: {self._outlet.fault}: damping")
        if message is None or self.settings.dry_run:
            return
        self._endpoint.send(message)
        self.sent += 1
        self._record(recording.PUBLISHED, message, now)

    def _run_threads(self) -> None:
        workers = (self._read, self._control, self._publish)
        last = self._deadline()
        threads = [threading.Thread(target=self._guarded, args=(work,), name=work.__name__) for work in workers]
        for thread in threads:
            thread.start()
        try:
            while not self._end.wait(_POLL) and time.perf_counter() < last:
                pass
        except KeyboardInterrupt as interrupt:
            self._failure = interrupt
        if not self._end.is_set():  # Ctrl-C, or the end by the wall clock: damp first
            self.ask(Request.STOP)
            self._end.wait(FADE * self.settings.slower)
        self._end.set()
        self._states.put(None)
        for thread in threads:
            thread.join()

    def _guarded(self, work: Callable[[], None]) -> None:
        """Run a thread's work; an exception ends the deployment and is raised in the main thread."""
        try:
            work()
        except BaseException as error:
            self._failure = self._failure or error
            # The publisher continues and damps, since the states are no longer answered.
            if work == self._publish:
                self._end.set()
            else:
                threading.Timer(FADE * self.settings.slower, self._end.set).start()

    def _read(self) -> None:
        while not self._end.is_set():
            for raw in self._endpoint.receive(_POLL):
                now = self.now()
                state = self.accept(raw, now)
                if state is not None:
                    self._states.put((raw, state, now))

    def _control(self) -> None:
        while (item := self._states.get()) is not None:
            self.handle(*item, behind=not self._states.empty())

    def _publish(self) -> None:
        slot, period = time.perf_counter(), PERIOD * self.settings.slower
        while not self._end.is_set():
            slot = max(slot + period, time.perf_counter())  # slots that were missed are left out
            time.sleep(max(slot - time.perf_counter(), 0.0))
            self.publish(self.now())
            self.timing.published(self.now())

    def _run_lockstep(self) -> None:
        last = math.inf
        try:
            while not self._end.is_set() and time.perf_counter() < last:
                if self.answer(_POLL) and self._start is not None:
                    last = time.perf_counter() + _PATIENCE
        except KeyboardInterrupt as interrupt:  # damp, then end
            self._failure = interrupt
            self.ask(Request.STOP)
            end = time.perf_counter() + FADE
            while time.perf_counter() < end:
                self.answer(_POLL)

    def _deadline(self) -> float:
        """Return when to end by the wall clock even if the robot sends nothing [s]."""
        duration = self.settings.duration
        allowed = math.inf if duration is None else duration + FADE + _PATIENCE
        return time.perf_counter() + allowed * self.settings.slower

    def answer(self, timeout: float) -> bool:
        """Take the states that arrive within `timeout` [s], and answer the last one; return whether there was one.

        In lockstep, time is that of the robot's clock: it stands still while the robot waits.
        """
        raws = self._endpoint.receive(timeout)
        begin = time.perf_counter()
        for raw in raws:
            now = self._messages.unpack_state(raw).state.time if len(raw) == self.intake.size else 0.0
            state = self.accept(raw, now)
            if state is not None:
                self._sent_decision = self.handle(raw, state, now) or b""
        if not raws:
            return False
        if self._sent_decision and not self.settings.dry_run:
            self._endpoint.send(self._messages.answering(self._sent_decision, raws[-1]))
            self.sent += 1
            self._record(recording.PUBLISHED, self._sent_decision)
        self.timing.answered((time.perf_counter() - begin) / self.settings.slower, self.pilot.safe.period)
        return True
