"""`hugwbc play`: drive one controller from a page in the browser, or watch it."""

import dataclasses
import importlib.util
import pathlib
import socket
import webbrowser
from collections.abc import Sequence
from typing import Annotated, Any, Literal

import numpy as np
import tyro
from pydantic import Field

from hugwbc.behaviours import BehaviourSource, load_plan
from hugwbc.behaviours.source import LONGEST, Status
from hugwbc.cli.output import parse_settings, say, say_arena
from hugwbc.commands import COMMAND_NAMES, Command
from hugwbc.errors import ConfigError, TargetError, needing
from hugwbc.gait import Gait
from hugwbc.robot import SIDES, Robot
from hugwbc.runtime.controllers import ControllerSpec
from hugwbc.runtime.loop import ControlLoop
from hugwbc.scripts.motion import load_motion
from hugwbc.scripts.script import Script, Segment
from hugwbc.scripts.socket_source import SocketSource
from hugwbc.scripts.view import CommandSource, Constant
from hugwbc.scripts.whole_body_motion import MotionScore, WholeBodyMotion, load_whole_body_motion
from hugwbc.settings import Positive, settings
from hugwbc.sim import Arena, Scene, load_scene
from hugwbc.targets import HandTargets
from hugwbc.tasks import TASK_NAMES, load_task, run_task
from hugwbc.tasks.record import TaskWatch, bumps
from hugwbc.upper_ik import UpperBodySource
from hugwbc.viz.show import SETTLE, RealTime, at_real_time, mean_velocities, open_page, run_live

UNWATCHED_DURATION = 10.0  # [s]
WHOLE_BODY = ".bvh"  # ending of the motion files that command more than the arms


@dataclasses.dataclass(frozen=True)
class CommandOptions:
    """One command, and targets of the hands."""

    gait: str | None = None  # Gait; by default walking if a velocity is given, otherwise standing
    v_x: float | None = None  # Forward velocity [m/s]
    v_y: float | None = None  # Velocity to the left [m/s]
    omega: float | None = None  # Yaw rate [rad/s]
    f: float | None = None  # Stride frequency [Hz]
    l: float | None = None  # noqa: E741  the paper's symbol
    """Swing height [m]"""
    h: float | None = None  # Pelvis height relative to nominal [m]
    p: float | None = None  # Pelvis pitch [rad]
    w: float | None = None  # Waist yaw [rad]
    # Target of the left hand in the pelvis frame, x y z [m]; with `--right-hand`
    left_hand: tuple[float, float, float] | None = None
    # Target of the right hand in the pelvis frame, x y z [m]; with `--left-hand`
    right_hand: tuple[float, float, float] | None = None

    @property
    def given(self) -> dict[str, Any]:
        """The options that are given, by name."""
        return {name: value for name, value in vars(self).items() if value is not None}


@settings
class PageOptions:
    """The live page."""

    host: str = "127.0.0.1"  # Host on which to serve it
    port: Annotated[int, Field(ge=0, le=65535)] = 0  # Its port; 0 for any free port
    expose: bool = False  # Allow a host that other machines can reach. They can then drive the robot.


@settings
class PlayOptions:
    """Drive a robot from a page in the browser, or watch a command, script, task or motion; Ctrl-C stops."""

    controller: str = "learned"  # learned, qp, hold, a plug-in's name, FILE.py:NAME, or a policy's or contract's path
    policy: str | None = None  # Shipped policy or path of one, for learned; path of a network, for a contract
    script: str | None = None  # Play a script or behaviour: name of a shipped one, a script (.yaml), or FILE.py:NAME
    task: str | None = None  # Do a task in its scene: one of the suite, as press_button, or FILE.py (docs/tasks.md)
    motion: pathlib.Path | None = None  # Move the arms by a file (.npz, .csv), or the whole body by a clip (.bvh)
    listen: int | None = None  # Follow another program's messages on this UDP port of this machine; 0 for any
    scene: str | None = None  # Objects around the robot: name of a shipped scene, or a file (.yaml)
    seed: int = 0  # Seed of the sensors' errors, and of what varies in the scene
    # Stop after this time [s]; by default at the end of the script, else on Ctrl-C, or after 10 s without a viewer
    duration: Positive | None = None
    # live: drive from the live page (extra [live]); meshcat: watch; none: run as fast as possible. auto: live if
    # nothing else commands the robot, otherwise meshcat.
    viewer: Literal["auto", "live", "meshcat", "none"] = "auto"
    # One command, and targets of the hands
    command: tyro.conf.OmitArgPrefixes[CommandOptions] = dataclasses.field(default_factory=CommandOptions)
    # The live page
    page: tyro.conf.OmitArgPrefixes[PageOptions] = dataclasses.field(default_factory=PageOptions)
    # What is simulated: robot, drives, sensors, ground
    arena: tyro.conf.OmitArgPrefixes[Arena] = dataclasses.field(default_factory=Arena)

    @property
    def commanding(self) -> list[str]:
        """Names of the options that say what the robot does in place of a person at a page."""
        names = [name for name in ("script", "task", "motion", "listen") if getattr(self, name) is not None]
        return [*names, *self.command.given]


def run(words: Sequence[str]) -> int:
    """Parse the options, open the viewer and run the loop; return 1 where a behaviour or task was not done, else 0."""
    options = parse_settings(PlayOptions, words, "play")
    viewer = _viewer(options)
    say_arena(options.arena)
    if viewer == "live":
        return _drive(options)
    if options.task is not None:
        return _do_task(options, viewer)
    scene = _scene(options)
    source, duration = _source(options, viewer)
    chosen = ControllerSpec(options.controller, options.policy).told(options.arena)
    page = None if viewer == "none" else open_page(say)
    controller = chosen.build()
    simulation = options.arena.simulation(seed=options.seed, scene=scene)
    loop = ControlLoop(controller, source, simulation, UpperBodySource(robot=simulation.known_robot))
    draw = None if page is None else page(controller.name, simulation.robot, simulation.scene)
    behaviour = source if isinstance(source, BehaviourSource) else None
    score = MotionScore(source, simulation.robot) if isinstance(source, WholeBodyMotion) else None
    watch = TaskWatch(simulation) if simulation.scene is not None else None

    def ended() -> bool:
        if watch is not None:
            watch.look()
        if score is not None:
            hands = np.stack([simulation.hand_position(side) for side in SIDES])
            score.watch(simulation.time, simulation.state(), hands)
        return behaviour is not None and behaviour.done

    try:
        run_live(loop, duration, draw, until=ended, tell=say)
    finally:
        if isinstance(source, SocketSource):
            _stop_listening(source)
    for line in [] if score is None else score.lines():
        say(line)
    if behaviour is not None:
        say(f"{options.script}: {behaviour.ending}")
    for bump in [] if watch is None else bumps(watch):
        say(f"scene: {bump}")
    for problem in simulation.objects.problems:
        say(f"scene: {problem}")
    return int(behaviour is not None and behaviour.status is not Status.SUCCESS)


def _viewer(options: PlayOptions) -> str:
    """Return how to show the robot: live, meshcat or none."""
    viewer, commanding = options.viewer, options.commanding
    if viewer == "auto":
        viewer = "meshcat" if commanding else "live"
        if viewer == "live" and importlib.util.find_spec("viser") is None:
            say("driving needs the live page: run `pip install 'hugwbc[live]'`; until then you watch the robot stand")
            viewer = "meshcat"
    if viewer == "live":
        others = [name for name in commanding if name != "listen"]
        _refuse_beside("--viewer live", "the live page is driven by its own sliders", others)
    elif options.page != PageOptions():
        given = [f"--{name}" for name, value in vars(options.page).items() if value != getattr(PageOptions(), name)]
        raise ConfigError(f"{', '.join(given)} is for the live page; add --viewer live, or leave it out")
    return viewer


def _do_task(options: PlayOptions, viewer: str) -> int:
    """Do one episode of a task, and say how it went."""
    others = [name for name in ("scene", "duration") if getattr(options, name) is not None]
    _refuse_beside("--task", "the task has its own", [*(n for n in options.commanding if n != "task"), *others])
    arena = options.arena
    task = load_task(str(options.task)).sized(arena.known_robot)
    chosen = ControllerSpec(options.controller, options.policy).told(arena)
    page = None if viewer == "none" else open_page(say)
    controller = chosen.build()
    simulation = arena.simulation(seed=options.seed, scene=task.scene)
    draw = None if page is None else at_real_time(page(controller.name, simulation.robot, simulation.scene), simulation)
    run = run_task(task, controller, simulation, on_snapshot=draw)
    verdict, settled = run.verdict, run.trace.time >= SETTLE
    say(f"{task.name} with {controller.name}, seed {options.seed}: {verdict.words} after {simulation.time:.1f} s")
    say(f"score: {verdict.score:.2f}")
    if settled.any():
        told, walked = (values[settled, :3].mean(axis=0) for values in (run.trace.command, run.trace.measured))
        say(mean_velocities(told, walked))
    return int(not verdict.success)


def _refuse_beside(option: str, why: str, others: Sequence[str]) -> None:
    """Refuse options that have no effect with another one."""
    if others:
        given = ", ".join(f"--{name.replace('_', '-')}" for name in others)
        raise ConfigError(f"{option} and {given} are both given; {why}")


def _scene(options: PlayOptions) -> Scene | None:
    return None if options.scene is None else load_scene(options.scene)


def _drive(options: PlayOptions) -> int:
    """Serve the live page until the time is over or Ctrl-C."""
    serve, chosen = options.page, ControllerSpec(options.controller, options.policy).told(options.arena)
    port = _free_port(serve.host, serve.port)
    stream = None if options.listen is None else _listening(options.listen, options.arena.known_robot)
    with needing("live", "the live page"):
        from hugwbc.viz.drive_link import page_address

        say(f"the page will be at {page_address(serve.host, port)}")
        from hugwbc.viz.live import LivePage
        from hugwbc.viz.show import drive
    controller, arena = chosen.build(), options.arena
    simulation = arena.simulation(seed=options.seed, scene=_scene(options))
    page = LivePage(
        simulation,
        name=controller.name,
        host=serve.host,
        port=port,
        expose=serve.expose,
        tasks=() if stream else TASK_NAMES,
        stream=stream,
    )
    loop = ControlLoop(controller, page.source, simulation, UpperBodySource(robot=arena.known_robot))
    say(f"drive at {page.address} with the keys W A S D Q E; Ctrl-C stops")
    if not webbrowser.open(page.address):
        tunnel = f"ssh -L {port}:127.0.0.1:{port} THIS_MACHINE"
        say(f"this machine has no browser; on yours: {tunnel}, then open the address there")

    def perform(name: str) -> str:
        """Do a task of the suite on the page; the person may stop it."""
        task = load_task(name).sized(arena.known_robot)
        its_own = arena.simulation(seed=options.seed, scene=task.scene)
        page.stage(its_own)
        clock = RealTime()
        draw = at_real_time(lambda _: page.show(its_own, name, clock.speed), its_own, clock)
        run = run_task(task, controller, its_own, on_snapshot=draw, stop=lambda: bool(page.interruption), strict=False)
        words = f"stopped ({page.interruption})" if page.interruption else run.verdict.words
        return f"{name} with {controller.name}: {words} after {its_own.time:.1f} s"

    try:
        drive(loop, page, options.duration or np.inf, perform=perform, tell=say)
    finally:
        page.close()
        if stream is not None:
            _stop_listening(stream)
    return 0


def _listening(port: int, robot: Robot) -> SocketSource:
    source = SocketSource(port, tell=say, robot=robot)
    say(f"listening on UDP port {source.port} of this machine")
    return source


def _stop_listening(source: SocketSource) -> None:
    say(str(source.tally))
    source.close()


def _free_port(host: str, port: int) -> int:
    """Return a free port, for 0 any; refuse an address that cannot be had.

    The page's server would fail in its own thread without a message, or take another port than the one asked for.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        socket.create_server((host, 0), family=family).close()
    except OSError as error:
        raise ConfigError(f"cannot serve on host '{host}': {error}; give an address of this machine") from error
    try:
        with socket.create_server((host, port), family=family) as server:
            return int(server.getsockname()[1])
    except OSError as error:
        raise ConfigError(
            f"cannot serve on port {port}: {error}; give another one, or 0 for any that is free"
        ) from error


def _source(options: PlayOptions, viewer: str = "none") -> tuple[CommandSource, float]:
    """Return what to command, and for how long [s]."""
    commands, forever = options.command, UNWATCHED_DURATION if viewer == "none" else np.inf
    if options.listen is not None:
        others = [name for name in options.commanding if name != "listen"]
        _refuse_beside("--listen", "the other program gives the commands", others)
        return _listening(options.listen, options.arena.known_robot), options.duration or forever
    if options.script is not None:
        others = [name for name in options.commanding if name != "script"]
        _refuse_beside("--script", "give one or the other", others)
        plan = load_plan(options.script, options.arena.known_robot)
        if isinstance(plan, Script):
            return plan, options.duration or plan.duration
        return BehaviourSource(plan), options.duration or LONGEST
    values = {name: value for name, value in commands.given.items() if name in COMMAND_NAMES}
    moving = any(values.get(name) for name in ("v_x", "v_y", "omega"))
    gait = Gait.parse(commands.gait) if commands.gait else Gait.WALKING if moving else Gait.STANDING
    robot = options.arena.known_robot
    command = Command.from_mapping(values, gait, robot).validate(robot)
    if options.motion is not None:
        hands = [name for name in ("left_hand", "right_hand") if name in commands.given]
        _refuse_beside("--motion", "a motion moves both arms", hands)
        if options.motion.suffix.lower() == WHOLE_BODY:
            return _whole_body(options, options.motion)
        motion = load_motion(options.motion, robot)
        segment = Segment(motion.name, motion.duration, gait, values, motion=motion, robot=robot)
        return Script(motion.name, (segment,)), options.duration or motion.duration
    return Constant(command, _hands(commands)), options.duration or forever


def _whole_body(options: PlayOptions, path: pathlib.Path) -> tuple[CommandSource, float]:
    """Return a clip of the whole body and how long to play it [s], and say what is dropped."""
    _refuse_beside(f"--motion *{WHOLE_BODY}", "the clip commands the whole body", list(options.command.given))
    motion = load_whole_body_motion(path, options.arena.known_robot)
    say("no command follows the roll of the trunk, the steps of the feet and the directions of hands and head")
    if motion.unused:
        say(f"not used of {path.name}: {', '.join(motion.unused)}")
    return motion, options.duration or motion.duration


def _hands(options: CommandOptions) -> HandTargets | None:
    if options.left_hand is None and options.right_hand is None:
        return None
    if options.left_hand is None or options.right_hand is None:
        raise TargetError("only one hand has a target; give both --left-hand x y z and --right-hand x y z, or neither")
    return HandTargets.of(options.left_hand, options.right_hand)
