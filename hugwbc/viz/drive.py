"""Drive a robot from the live page: real time, falls, resets, and records of what the person did."""

import pathlib
import threading
import time
from collections.abc import Callable

from hugwbc.errors import HugwbcError
from hugwbc.files import write_whole
from hugwbc.runtime.loop import ControlLoop
from hugwbc.runtime.rollout import Recorder
from hugwbc.runtime.trace import Trace
from hugwbc.sim import Disturber
from hugwbc.viz.drive_log import DriveLog
from hugwbc.viz.live import LivePage
from hugwbc.viz.replay import write_replay
from hugwbc.viz.show import FALLEN_PAUSE, FRAME_PERIOD, RealTime, Tell

LONGEST_RECORD = 600.0  # [s]; a record holds about 80 kB for a second
VERDICT_TIME = 60.0  # [s] that the page shows how a task ended
NAME = "drive"  # of the files
Perform = Callable[[str, Callable[[], bool]], str]
"""Does a task by its name in its own scene, until it is over or the second argument says so; says how it went."""


class _Record:
    """One record in the making."""

    def __init__(self, loop: ControlLoop) -> None:
        self.recorder = Recorder(loop, Disturber(loop.simulation.link_names, ()), None)
        self.log = DriveLog()


class Drive:
    """A robot that a person drives."""

    def __init__(
        self,
        loop: ControlLoop,
        page: LivePage,
        *,
        folder: pathlib.Path | None = None,
        perform: Perform | None = None,
        tell: Tell = print,
    ) -> None:
        """Connect a robot, in a loop whose source is the page's, to that page.

        Records go to the folder; without one none are offered. `perform` does the tasks that the page offers, with the
        loop's controller. `tell` receives a line for each fall and each record and, at the end, how the drive went.
        """
        self.loop, self.page, self.folder, self.tell = loop, page, folder, tell
        self.perform = perform
        self.falls = 0  # how often the robot fell
        self.written: list[pathlib.Path] = []  # files of the records, complete after `run`
        self._record: _Record | None = None
        self._t, self._begin = 0.0, 0.0
        self._writers: list[threading.Thread] = []
        self._messages: list[str] = []
        page.can_reset = True
        page.recording = None if folder is None else False

    def run(self, duration: float, stop: Callable[[], bool] = lambda: False) -> None:
        """Run in real time until the duration [s] is over, falls included, or `stop` says so."""
        simulated, next_frame = 0.0, 0.0
        self.loop.reset()
        clock = RealTime()
        try:
            while simulated < duration - 1e-9 and not stop():
                self._tick()
                simulated += self.loop.period
                if simulated >= next_frame:
                    next_frame += FRAME_PERIOD
                    self.page.disturb(self.loop.simulation)
                    self.page.show(self.loop.simulation, speed=clock.speed)
                    self._obey()
                    self._do_task(stop)
                    clock.keep(simulated)
                if self.loop.simulation.fallen:
                    self.falls += 1
                    self.tell(f"fell after {self._t:.1f} s; standing up again")
                    self._end_record(fell=True)
                    self.page.show(self.loop.simulation)
                    clock.pause(FALLEN_PAUSE)
                    self.page.source.tell("the robot fell and stands up again")
                    self._restart()
        finally:
            self._end_record(fell=False)
            for writer in self._writers:
                writer.join()
        self.tell(f"{self.loop.safe.name}: {simulated:.1f} s simulated, {self.falls} falls")
        for message in dict.fromkeys([*self._messages, *self.loop.safe.report().messages]):
            self.tell(f"safety: {message}")

    def _tick(self) -> None:
        command = self.loop.decide(self._t)
        if self._record is None:
            self.loop.step(command, self.loop.period)
        else:
            record, t = self._record, self._t - self._begin
            record.log.add(t, self.page.source.command, self.loop.control.hands)
            if record.recorder.due(t):
                record.recorder.sample(t, command)
            record.recorder.advance(command, t)
            record.recorder.tick_ms.append(self.loop.safe.last_tick_s * 1e3)
            if t >= LONGEST_RECORD:
                self._end_record(fell=False)
        self._t += self.loop.period

    def _obey(self) -> None:
        if self.page.take("reset"):
            self._end_record(fell=False)
            self.page.source.stand()
            self._restart()
        if self.page.take("record") and self.folder is not None:
            if self._record is None:
                self._begin, self._record = self._t, _Record(self.loop)
                self.page.source.tell("recording; press again to write it")
            else:
                self._end_record(fell=False)
            self.page.recording = self._record is not None

    def _do_task(self, stop: Callable[[], bool]) -> None:
        """Do the requested task, if any, and stand up in the old place."""
        task = self.page.take_task()
        if task is None or self.perform is None:
            return
        self._end_record(fell=False)
        self.page.source.stand()
        try:
            words = self.perform(task, stop)
        except HugwbcError as error:  # such as a scene in which the robot does not fit; driving continues
            words = f"{task} was not done: {error}"
        self.page.stage(self.loop.simulation)
        self._restart()
        self.tell(words)
        self.page.source.tell(words, VERDICT_TIME)

    def _restart(self) -> None:
        self._messages += self.loop.safe.report().messages  # the reset clears them
        self.loop.reset()
        self._t = 0.0
        self.page.source.restart()
        self.page.moved()

    def _end_record(self, *, fell: bool) -> None:
        """Close the record, if there is one, and write it while the robot continues."""
        record, self._record = self._record, None
        if record is None:
            return
        self.page.recording = False
        length = self._t - self._begin
        trace = record.recorder.trace(fell=fell, survived_s=length, steps=round(length / self.loop.period))
        writer = threading.Thread(target=self._write, args=(record.log, trace))
        self._writers.append(writer)
        writer.start()

    def _write(self, log: DriveLog, trace: Trace) -> None:
        assert self.folder is not None
        stem = f"{NAME}-{time.strftime('%Y%m%d-%H%M%S')}"
        taken = sum(path.stem.startswith(stem) for path in self.written)
        stem = f"{stem}-{taken}" if taken else stem
        script, replay = self.folder / f"{stem}.yaml", self.folder / f"{stem}.html"
        try:
            write_whole(script, log.script(f"A drive of {trace.name} by hand."))
            write_replay(replay, [trace], title=f"hugwbc {stem}: {trace.name}")
        except (OSError, HugwbcError) as error:
            self.tell(f"the record was not written: {error}")
            self.page.source.tell(f"the record was not written: {error}")
            return
        self.written += [script, replay]
        self.page.source.tell(f"written: {script.name} and {replay.name}")
        self.tell(f"wrote {script} and {replay}; play the script with `hugwbc compare --script {script}`")
