"""Drive a robot from the live page: real time, falls, resets, and tasks."""

from collections.abc import Callable

from hugwbc.errors import HugwbcError
from hugwbc.runtime.loop import ControlLoop
from hugwbc.viz.live import LivePage
from hugwbc.viz.show import FALLEN_PAUSE, FRAME_PERIOD, RealTime, Tell

VERDICT_TIME = 60.0  # [s] that the page shows how a task ended
Perform = Callable[[str, Callable[[], bool]], str]
"""Does a task by its name in its own scene, until it is over or the second argument says so; says how it went."""


class Drive:
    """A robot that a person drives."""

    def __init__(
        self,
        loop: ControlLoop,
        page: LivePage,
        *,
        perform: Perform | None = None,
        tell: Tell = print,
    ) -> None:
        """Connect a robot, in a loop whose source is the page's, to that page.

        `perform` does the tasks that the page offers, with the loop's controller. `tell` receives a line for each fall
        and, at the end, how the drive went.
        """
        self.loop, self.page, self.perform, self.tell = loop, page, perform, tell
        self.falls = 0  # how often the robot fell
        self._t = 0.0
        self._messages: list[str] = []

    def run(self, duration: float, stop: Callable[[], bool] = lambda: False) -> None:
        """Run in real time until the duration [s] is over, falls included, or `stop` says so."""
        simulated, next_frame = 0.0, 0.0
        self.loop.reset()
        clock = RealTime()
        while simulated < duration - 1e-9 and not stop():
            self.loop.step(self.loop.decide(self._t), self.loop.period)
            self._t += self.loop.period
            simulated += self.loop.period
            if simulated >= next_frame:
                next_frame += FRAME_PERIOD
                self.page.disturb(self.loop.simulation)
                self.page.show(self.loop.simulation, speed=clock.speed)
                if self.page.take("reset"):
                    self.page.source.stand()
                    self._restart()
                self._do_task(stop)
                clock.keep(simulated)
            if self.loop.simulation.fallen:
                self.falls += 1
                self.tell(f"fell after {self._t:.1f} s; standing up again")
                self.page.show(self.loop.simulation)
                clock.pause(FALLEN_PAUSE)
                self.page.source.tell("the robot fell and stands up again")
                self._restart()
        self.tell(f"{self.loop.safe.name}: {simulated:.1f} s simulated, {self.falls} falls")
        for message in dict.fromkeys([*self._messages, *self.loop.safe.report().messages]):
            self.tell(f"safety: {message}")

    def _do_task(self, stop: Callable[[], bool]) -> None:
        """Do the requested task, if any, and stand up in the old place."""
        task = self.page.take_task()
        if task is None or self.perform is None:
            return
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
