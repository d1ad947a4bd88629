"""Run a robot in front of a viewer: live in the browser at real time, or afterwards as a replay page.

`watch` is what the examples use: one rollout, shown live if requested, with a replay page to keep. `run_live` goes on
until it is stopped and stands the robot up again after a fall; `drive` lets a person command it from the live page.
meshcat is loaded only when something is drawn.
"""

import math
import pathlib
import sys
import time
import webbrowser
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from hugwbc.commands import COMMAND_UNITS, VELOCITY_NAMES, Command
from hugwbc.controller import Controller
from hugwbc.errors import HugwbcError
from hugwbc.files import write_whole, writing
from hugwbc.robot import SIDES, Robot
from hugwbc.runtime.loop import ControlLoop, world_targets
from hugwbc.runtime.rollout import rollout
from hugwbc.runtime.trace import Snapshot, Trace
from hugwbc.scripts.view import CommandSource
from hugwbc.sim import Engine, Force, Scene, Simulation
from hugwbc.upper_ik import UpperBodySource

if TYPE_CHECKING:
    from hugwbc.viz.live import LivePage

FRAME_PERIOD = 0.04  # [s] of simulated time between two pictures
SETTLE = 1.0  # [s] after a start that do not count in mean velocities
FALLEN_PAUSE = 1.0  # [s] to look at a fallen robot before it stands up again
PAGE_LOAD_TIME = 1.5  # [s] that a browser needs to show the scene
DEARER, CHEAPER = 0.2, 0.02  # shares by which a picture's time changes what the next one may take
UNEVEN = 2.0  # how many times as long as the slower ones, or as in reality, a picture counts at most
SMOOTHING = 0.05  # share of a picture in the speed that is shown
VERDICT_TIME = 60.0  # [s] that the page shows how a task ended
USAGE_ERROR, INTERRUPTED = 2, 130  # exit codes

Draw = Callable[[Snapshot], None]
Tell = Callable[[str], object]


class RealTime:
    """A clock that holds simulated time back to real time.

    On a slow computer the robot moves in slow motion, as evenly as possible: every picture takes as long as the slower
    ones of the last seconds. It never moves faster than in reality.
    """

    def __init__(self) -> None:
        """Start at a simulated time of 0."""
        self.speed = 1.0  # simulated time over real time, of the last seconds
        self._simulated, self._shown = 0.0, time.monotonic()
        self._cost = 0.0  # of a simulated second [s], for the slower pictures

    def keep(self, simulated: float) -> None:
        """Wait until the picture of a simulated time [s] is due."""
        now, step = time.monotonic(), simulated - self._simulated
        self._simulated = simulated
        if step <= 0.0:  # the robot was reset
            self._shown = now
            return
        # A program that was suspended for a while goes on as before.
        cost = min((now - self._shown) / step, UNEVEN * max(1.0, self._cost))
        dearer = cost - self._cost
        self._cost += dearer * (DEARER if dearer > 0.0 else CHEAPER)
        due = self._shown + step * max(1.0, self._cost)
        if due > now:
            time.sleep(due - now)
        length, self._shown = max(due, now) - self._shown, max(due, now)
        self.speed += SMOOTHING * (step / length - self.speed)

    def pause(self, duration: float = 0.0) -> None:
        """Wait for a duration [s], and do not count the time since the last picture."""
        time.sleep(duration)
        self._shown = time.monotonic()


def open_view(name: str, robot: Robot, *, scene: Scene | None = None, tell: Tell = print) -> Draw:
    """Open a live meshcat page with one robot, which only this machine can reach; return what draws a snapshot."""
    return open_page(tell)(name, robot, scene)


def open_page(tell: Tell) -> Callable[[str, Robot, Scene | None], Draw]:
    """Open an empty page; return what puts a robot there, by its name and what is around it."""
    from hugwbc.viz import meshcat_scene
    from hugwbc.viz.server import open_visualizer

    visualizer, address = open_visualizer()
    tell(f"watch at {address}; Ctrl-C stops")
    if webbrowser.open(address):
        time.sleep(PAGE_LOAD_TIME)

    def put(name: str, robot: Robot, scene: Scene | None) -> Draw:
        picture = meshcat_scene.Scene(visualizer, [name], robot, around=[scene])

        def draw(snapshot: Snapshot) -> None:
            picture.robots[0].show(snapshot)
            picture.look_at(snapshot.qpos[:2])

        return draw

    return put


def watch(
    controller: Controller,
    source: CommandSource | Command,
    simulation: Engine | None = None,
    upper_body: UpperBodySource | None = None,
    *,
    duration: float,
    show: bool = False,
    replay: str | pathlib.Path | None = None,
    forces: Sequence[Force] = (),
    tell: Tell = print,
) -> Trace:
    """Run a controller from a standing start and let people see it.

    Args:
        controller: the controller.
        source: commands and hand targets over time, such as a `Script`; or one command for all times.
        simulation: the robot; a new one by default.
        upper_body: turns hand targets into arm targets; without it hand targets are ignored.
        duration: how long to run [s]; a fall ends the run early.
        show: show the run live in the browser.
        replay: path of the replay page to write; None for no page.
        forces: forces that disturb the robot.
        tell: receives the addresses of the live page and the replay.

    Returns:
        The record of the run.
    """
    simulation = simulation or Simulation()
    draw = open_view(controller.name, simulation.robot, scene=simulation.scene, tell=tell) if show else None
    in_time = None if draw is None else at_real_time(draw, simulation)
    trace = rollout(controller, source, simulation, upper_body, duration=duration, forces=forces, on_snapshot=in_time)
    if replay is not None:
        keep_replay(replay, [trace], tell=tell)
    return trace


def at_real_time(draw: Draw, simulation: Engine, clock: RealTime | None = None) -> Draw:
    """Return a function that draws snapshots of a simulation every `FRAME_PERIOD`, and holds it back to real time."""
    clock, next_frame = clock or RealTime(), 0.0

    def draw_in_time(snapshot: Snapshot) -> None:
        nonlocal next_frame
        now = simulation.time
        if now >= next_frame - 1e-9:
            next_frame += FRAME_PERIOD
            draw(snapshot)
            clock.keep(now)

    return draw_in_time


def keep_replay(path: str | pathlib.Path, traces: Sequence[Trace], *, tell: Tell = print) -> None:
    """Write a replay page of one to four runs side by side, and tell where it is."""
    from hugwbc.viz.replay import replay_html

    path = pathlib.Path(path)
    with writing(path):
        title = f"hugwbc {path.stem}: {', '.join(trace.name for trace in traces)}"
        write_whole(path, replay_html(traces, title=title))
    tell(f"replay in {path}")


def run_live(
    loop: ControlLoop,
    duration: float,
    draw: Callable[[Snapshot], bool | None] | None = None,
    *,
    until: Callable[[], bool] = lambda: False,
    clock: RealTime | None = None,
    tell: Tell = print,
) -> None:
    """Run a control loop for a simulated duration [s], at real time if there is a viewer; falls do not end it.

    A robot that fell stands up again, and so does one whose viewer asks for it: `draw` returns True. The commands then
    restart. The run ends early where `until`, called after each control period, returns True. `tell` receives a line
    for each fall and, at the end, how the run went.
    """
    falls, simulated, next_frame = 0, 0.0, 0.0
    velocities, ticks = np.zeros((2, 3)), 0
    messages: list[str] = []
    loop.reset()
    clock = clock or RealTime()
    try:
        while simulated < duration - 1e-9:
            loop.step(loop.decide(loop.simulation.time), loop.period)
            simulated += loop.period
            if loop.simulation.time > SETTLE:
                velocities += loop.control.chain.command.array()[:3], loop.simulation.state().heading_velocity
                ticks += 1
            again = loop.simulation.fallen
            if draw is not None and (again or simulated >= next_frame):
                next_frame += FRAME_PERIOD
                again = bool(draw(loop.snapshot())) or again
                clock.keep(simulated)
            if loop.simulation.fallen:
                falls += 1
                tell(f"fell after {loop.simulation.time:.1f} s; standing up again")
                if draw is not None:
                    clock.pause(FALLEN_PAUSE)
            if again:
                messages += loop.control.log.report().messages  # the reset clears them
                loop.reset()
            elif until():
                break
    finally:  # also after Ctrl-C
        tell(f"{loop.control.guard.name}: {simulated:.1f} s simulated, {falls} falls")
        if ticks:
            tell(mean_velocities(*velocities / ticks))
        if words := hands_reached(loop):
            tell(words)
        if (watch := getattr(loop.control.upper_body, "watch", None)) is not None and watch.tally.problem:
            tell(str(watch.tally))
        for message in dict.fromkeys([*messages, *loop.control.log.report().messages]):
            tell(f"safety: {message}")


def drive(
    loop: ControlLoop,
    page: "LivePage",
    duration: float,
    *,
    perform: Callable[[str], str],
    tell: Tell = print,
) -> None:
    """Let a person drive a robot until the simulated duration [s] is over; falls do not end it.

    The source of the loop is the page's. `perform` does a task that the page offers, by its name and in its own scene,
    with the loop's controller, and returns how it went. `tell` receives a line for each fall and each task and, at the
    end, how the drive went.
    """
    clock = RealTime()

    def begin_anew() -> None:
        page.source.stand()
        page.moved()

    def draw(_: Snapshot) -> bool:
        page.disturb(loop.simulation)
        page.show(loop.simulation, speed=clock.speed, commanded=loop.control.chain.command)
        again, task = page.take("reset"), page.take_task()
        if again or task is not None:
            begin_anew()
        if task is not None:
            try:
                words = perform(task)
            except HugwbcError as error:  # such as a scene in which the robot does not fit; driving continues
                words = f"{task} was not done: {error}"
            page.stage(loop.simulation)
            begin_anew()  # what was pressed meanwhile was not for this robot
            clock.pause()  # the task kept real time by itself
            tell(words)
            page.source.tell(words, VERDICT_TIME)
        return again or task is not None

    def say(words: str) -> None:
        tell(words)
        page.source.tell(words)

    run_live(loop, duration, draw, clock=clock, tell=say)


def mean_velocities(commanded: np.ndarray, walked: np.ndarray) -> str:
    """Return mean velocities as a line for people; both have the shape (3,)."""
    pairs = zip(VELOCITY_NAMES, walked, commanded, strict=True)
    words = (f"{name} {mean:.2f} of {value:.2f} {COMMAND_UNITS[name]}" for name, mean, value in pairs)
    return f"mean velocities, walked of commanded: {', '.join(words)}"


def hands_reached(loop: ControlLoop) -> str:
    """Return how far the hands are from their targets, as a line for people; empty without targets."""
    simulation, arms = loop.simulation, loop.control.upper_body
    targets = world_targets(loop.control.hands, simulation.state())
    words = []
    for number, (side, target) in enumerate(zip(SIDES, targets, strict=True)):
        away = float(np.linalg.norm(simulation.hand_position(side) - target))
        if math.isfinite(away):
            beyond = arms is not None and arms.solution is not None and not arms.solution.reachable[number]
            words.append(f"{side} {100 * away:.1f} cm" + " (out of reach)" * beyond)
    return f"hands at the end, from their targets: {', '.join(words)}" if words else ""


def run_script(main: Callable[..., object]) -> None:
    """Call a script's `main` with options from the command line; a bad value ends it with a message and exit code 2.

    Its arguments must have types and defaults; its docstring becomes the help text.
    """
    import tyro

    try:
        tyro.cli(main)
    except HugwbcError as error:
        sys.stderr.write(f"{pathlib.Path(sys.argv[0]).name}: {error}\n")
        sys.exit(USAGE_ERROR)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
