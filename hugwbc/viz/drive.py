"""Drive a robot from the live page: real time, falls, resets, and tasks."""

from collections.abc import Callable

from hugwbc.errors import HugwbcError
from hugwbc.runtime.loop import ControlLoop
from hugwbc.runtime.moment import Moment
from hugwbc.viz.live import LivePage
from hugwbc.viz.show import RealTime, Tell, run_live

VERDICT_TIME = 60.0  # [s] that the page shows how a task ended
Perform = Callable[[str, Callable[[], bool]], str]
"""Does a task by its name in its own scene, until it is over or the second argument says so; says how it went."""


def drive(
    loop: ControlLoop,
    page: LivePage,
    duration: float,
    *,
    perform: Perform | None = None,
    stop: Callable[[], bool] = lambda: False,
    tell: Tell = print,
) -> None:
    """Let a person drive a robot until the duration [s] is over, falls included, or `stop` says so.

    The source of the loop is the page's. `perform` does the tasks that the page offers, with the loop's controller.
    `tell` receives a line for each fall and each task and, at the end, how the drive went.
    """
    clock = RealTime()

    def draw(_: Moment) -> bool:
        page.disturb(loop.simulation)
        page.show(loop.simulation, speed=clock.speed)
        again, task = page.take("reset"), page.take_task()
        if again or task is not None:
            page.source.stand()
            page.moved()
        if task is not None and perform is not None:
            try:
                words = perform(task, stop)
            except HugwbcError as error:  # such as a scene in which the robot does not fit; driving continues
                words = f"{task} was not done: {error}"
            page.stage(loop.simulation)
            tell(words)
            page.source.tell(words, VERDICT_TIME)
        return again or task is not None

    def say(words: str) -> None:
        tell(words)
        page.source.tell(words)

    run_live(loop, duration, draw, until=stop, clock=clock, tell=say)
