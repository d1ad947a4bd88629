"""`hugwbc play`: drive one controller from a page in the browser, or watch it."""

import dataclasses
import importlib.util
import pathlib
import socket
import webbrowser
from collections.abc import Callable, Sequence

import numpy as np
import tyro

from hugwbc.cli.output import output_folder, parse, say, say_arena
from hugwbc.commands import COMMAND_NAMES, Command
from hugwbc.errors import CommandError, ConfigError, TargetError
from hugwbc.gait import Gait
from hugwbc.robot import SIDES
from hugwbc.runtime.controllers import ControllerSpec
from hugwbc.runtime.loop import ControlLoop
from hugwbc.scripts.behaviours.behaviour import Behaviour
from hugwbc.scripts.behaviours.behaviour_file import check_objects, load_plan
from hugwbc.scripts.behaviours.behaviour_source import LONGEST, BehaviourSource
from hugwbc.scripts.command_source import CommandSource, Constant
from hugwbc.scripts.motion import load_motion
from hugwbc.scripts.script import DEFAULT_RAMP, Script, Segment
from hugwbc.scripts.socket_source import SocketSource
from hugwbc.scripts.whole_body_motion import MotionScore, WholeBodyMotion, load_whole_body_motion
from hugwbc.sim import Arena, Scene, load_scene
from hugwbc.targets import HandTargets
from hugwbc.tasks import TASK_NAMES, Verdict, load_task, run_task
from hugwbc.upper_ik import UpperBodySource
from hugwbc.viz.show import at_real_time, open_view, run_live

HEADLESS_DURATION = 10.0  # [s]
LAST_PORT = 65535  # of TCP
WHOLE_BODY = ".bvh"  # ending of the motion files that command more than the arms
_COMMANDING = ("gait", "motion", "left_hand", "right_hand", *COMMAND_NAMES)
# What says what the robot does in place of a person at a page.
_DRIVING = ("script", "listen", "headless", *_COMMANDING)


@dataclasses.dataclass(frozen=True)
class PlayOptions:
    """Drive a controller from a page in the browser (on this machine only); Ctrl-C stops.

    With a command, a script or hand targets, or if no live page is available, meshcat shows the robot instead.
    """

    controller: str = "learned"
    """learned, qp, hold (a baseline that only holds its pose), a plug-in's name, FILE.py:NAME, or the path of a policy
    or of a contract for a foreign policy (docs/evaluation.md)."""
    policy: str | None = None
    """Name of a shipped policy or path of a policy, for learned; path of a network, for a foreign policy."""
    script: str | None = None
    """Play this script or behaviour instead of one command: name of a shipped one, or a file (.yaml);
    docs/how-to/add-a-behaviour.md."""
    motion: pathlib.Path | None = None
    """Move the arms by this file (.npz, or .csv with the joints' names; docs/upper_ik.md), while the rest of the body
    follows the command; or dance a person's clip (.bvh) with the whole body. It ends with the file."""
    task: str | None = None
    """Do this task of the suite, in its scene, instead of a script (docs/tasks.md), such as press_button."""
    scene: str | None = None
    """Objects around the robot: name of a shipped scene, or a file (.yaml); docs/how-to/add-an-object.md."""
    seed: int = 0
    """Seed of the sensors' errors, and of what varies in the scene."""
    gait: str | None = None
    """Gait; by default walking if a velocity is given, otherwise standing."""
    v_x: float | None = None
    """Forward velocity [m/s]."""
    v_y: float | None = None
    """Velocity to the left [m/s]."""
    omega: float | None = None
    """Yaw rate [rad/s]."""
    f: float | None = None
    """Stride frequency [Hz]."""
    l: float | None = None  # noqa: E741  the paper's symbol
    """Swing height [m]."""
    h: float | None = None
    """Pelvis height relative to nominal [m]."""
    p: float | None = None
    """Pelvis pitch [rad]."""
    w: float | None = None
    """Waist yaw [rad]."""
    left_hand: tuple[float, float, float] | None = None
    """Target of the left hand in the pelvis frame, x y z [m]; with `--right-hand`."""
    right_hand: tuple[float, float, float] | None = None
    """Target of the right hand in the pelvis frame, x y z [m]; with `--left-hand`."""
    listen: int | None = None
    """Follow the messages of another program on this UDP port of this machine (docs/how-to/teleoperate.md);
    0 for any free port."""
    duration: float | None = None
    """Stop after this time [s]; by default at the end of the script, or on Ctrl-C."""
    headless: bool = False
    """Run without a browser and as fast as possible, for 10 s unless `--duration` says otherwise."""
    browser: bool = True
    """Open the page in the browser; otherwise only print its address."""
    live: bool = False
    """Insist on the live page: keys, gamepad, sliders, a push, draggable hands. Needs the extra [live]."""
    meshcat: bool = False
    """Watch in meshcat, without driving."""
    out: pathlib.Path = pathlib.Path("out/play")
    """Folder for what is recorded on the live page: a script and a replay of each record."""
    host: str = "127.0.0.1"
    """Host on which to serve the live page."""
    port: int = 0
    """Port of the live page; 0 for any free port."""
    expose: bool = False
    """Allow a host that other machines can reach. They can then drive the robot."""
    arena: tyro.conf.OmitArgPrefixes[Arena] = dataclasses.field(default_factory=Arena)
    """Robot, drives, sensors and ground (docs/arena.md)."""


def run(words: Sequence[str]) -> int:
    """Parse the options, open the viewer and run the loop; return the exit code."""
    options = parse(PlayOptions, words, "play", PlayOptions.__doc__)
    if options.duration is not None and not options.duration > 0.0:
        raise ConfigError(f"duration is {options.duration} s; give a time above 0 s")
    say_arena(options.arena)
    if options.task is not None:
        return _run_task(options)
    if options.live and options.meshcat:
        raise ConfigError("--live and --meshcat are both given; give one of them")
    if options.live or _drives(options):
        return _run_live(options)
    _refuse_options_of_the_page(options)
    source, duration = _source(options)
    controller = ControllerSpec(options.controller, options.policy).told(options.arena).build()
    arena = options.arena
    simulation = arena.simulation(seed=options.seed, scene=_scene(options))
    if isinstance(source, BehaviourSource):
        check_objects(source.behaviour, simulation.objects.names)
    loop = ControlLoop(controller, source, simulation, UpperBodySource(robot=arena.known_robot))
    draw = None
    if not options.headless:
        draw = open_view(controller.name, scene=simulation.scene, browser=options.browser, tell=say)
    behaviour = source if isinstance(source, BehaviourSource) else None
    score = MotionScore(source, simulation.robot) if isinstance(source, WholeBodyMotion) else None

    def ended() -> bool:
        if score is not None:
            hands = np.stack([simulation.hand_position(side) for side in SIDES])
            score.watch(simulation.time, simulation.state(), hands)
        return behaviour is not None and behaviour.done

    run_live(loop, duration, draw, until=ended, tell=say)
    for line in [] if score is None else score.lines():
        say(line)
    if behaviour is not None:
        say(f"{behaviour.behaviour.label}: {behaviour.ending}")
    for problem in simulation.objects.problems:
        say(f"scene: {problem}")
    return 0


def _run_task(options: PlayOptions) -> int:
    """Do one episode of a task, and say how it went.

    Raises:
        ConfigError: if other options give commands or a scene as well, which the task has of its own.
    """
    _refuse_beside(
        "--task", "the task has its own", options, (*_COMMANDING, "script", "listen", "scene", "duration", "live")
    )
    _refuse_options_of_the_page(options)
    task, arena = load_task(str(options.task)), options.arena
    controller = ControllerSpec(options.controller, options.policy).told(arena).build()
    simulation = arena.simulation(seed=options.seed, scene=task.scene)
    draw = None
    if not options.headless:
        view = open_view(controller.name, scene=simulation.scene, browser=options.browser, tell=say)
        draw = at_real_time(view, simulation)
    verdict = run_task(task, controller, simulation, on_moment=draw).verdict
    words = _words(verdict)
    say(f"{task.name} with {controller.name}, seed {options.seed}: {words} after {simulation.time:.1f} s")
    if verdict.detail:
        say(f"it ended with: {verdict.detail}")
    say(f"score: {verdict.score:.2f}")
    return 0


def _words(verdict: Verdict) -> str:
    return "done" if verdict.success else f"not done: {verdict.reason}"


def _refuse_beside(option: str, why: str, options: PlayOptions, others: Sequence[str]) -> None:
    """Refuse options that mean nothing beside another one.

    Raises:
        ConfigError: if there are any; the message names them.
    """
    given = _given(options, others)
    if given:
        raise ConfigError(f"{option} and {', '.join(given)} are both given; {why}")


def _scene(options: PlayOptions) -> Scene | None:
    return None if options.scene is None else load_scene(options.scene)


def _given(options: PlayOptions, names: Sequence[str]) -> list[str]:
    # `is not False`, because a command of 0 is given too, and 0 == False.
    return [name for name in names if getattr(options, name) is not None and getattr(options, name) is not False]


def _drives(options: PlayOptions) -> bool:
    """Return whether to open the live page unasked: somebody must drive, and a page and a browser must be available."""
    if options.meshcat or not options.browser or _given(options, _DRIVING) or _options_of_the_page(options):
        return False
    if importlib.util.find_spec("viser") is None:
        return False
    try:
        webbrowser.get()
    except webbrowser.Error:
        return False
    return True


def _options_of_the_page(options: PlayOptions) -> list[str]:
    names = ("host", "port", "expose", "out")
    return [name for name in names if getattr(options, name) != getattr(PlayOptions(), name)]


def _refuse_options_of_the_page(options: PlayOptions) -> None:
    """Refuse options of the live page without `--live`, because they would do nothing.

    Raises:
        ConfigError: if there are any; the message names them.
    """
    given = _options_of_the_page(options)
    if given:
        names = ", ".join(f"--{name}" for name in given)
        raise ConfigError(f"{names} is for the live page; add --live, or leave it out")


def _run_live(options: PlayOptions) -> int:
    """Serve the live page until the time is over or Ctrl-C.

    Raises:
        ConfigError: if viser is not installed, the host or port is not allowed, or other options give commands as well.
    """
    _refuse_beside("--live", "the live page is driven by its own sliders", options, _DRIVING)
    if not 0 <= options.port <= LAST_PORT:
        raise ConfigError(f"port is {options.port}; give 1 to {LAST_PORT}, or 0 for any that is free")
    _check_address(options.host, options.port)
    try:
        from hugwbc.viz.drive import Drive
        from hugwbc.viz.live import LivePage
    except ImportError as error:
        raise ConfigError(f"--live needs viser ({error}); run `pip install 'hugwbc[live]'`") from error
    controller = ControllerSpec(options.controller, options.policy).told(options.arena).build()
    arena = options.arena
    simulation = arena.simulation(seed=options.seed, scene=_scene(options))
    page = LivePage(
        simulation, name=controller.name, host=options.host, port=options.port, expose=options.expose, tasks=TASK_NAMES
    )
    loop = ControlLoop(controller, page.source, simulation, UpperBodySource(robot=arena.known_robot))
    say(f"drive at {page.address} with the keys W A S D Q E; Ctrl-C stops")
    if options.browser:
        webbrowser.open(page.address)

    def perform(name: str, stop: Callable[[], bool]) -> str:
        """Do a task of the suite on the page; the person may stop it."""
        task = load_task(name)
        its_own = arena.simulation(seed=options.seed, scene=task.scene)
        page.stage(its_own)
        draw = at_real_time(lambda _: page.show(its_own, name), its_own)
        run = run_task(task, controller, its_own, on_moment=draw, stop=lambda: page.interrupted or stop())
        words = "stopped" if page.interrupted else _words(run.verdict)
        return f"{name} with {controller.name}: {words} after {its_own.time:.1f} s"

    try:
        with output_folder(options.out):
            Drive(loop, page, folder=options.out, perform=perform, tell=say).run(options.duration or np.inf)
    finally:
        page.close()
    return 0


def _check_address(host: str, port: int) -> None:
    """Refuse an address that cannot be had.

    The page's server would fail in its own thread without a message, or take another port than the one asked for.

    Raises:
        ConfigError: if no port of the host can be opened, or this one is in use.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        socket.create_server((host, 0), family=family).close()
    except OSError as error:
        raise ConfigError(f"cannot serve on host '{host}': {error}; give an address of this machine") from error
    try:
        socket.create_server((host, port), family=family).close()
    except OSError as error:
        raise ConfigError(
            f"cannot serve on port {port}: {error}; give another one, or 0 for any that is free"
        ) from error


def _source(options: PlayOptions) -> tuple[CommandSource, float]:
    """Return what to command, and for how long [s].

    Raises:
        ConfigError: if commands and a port to listen on are both given, or the port cannot be used.
        CommandError: if a value is out of range, or if values and a script are both given.
        TargetError: if only one hand has a target, or a target is not finite.
        MotionFileError: if the motion file cannot be used.
    """
    if options.listen is not None:
        _refuse_beside("--listen", "the other program gives the commands", options, (*_COMMANDING, "script"))
        listening = SocketSource(options.listen)
        say(f"listening on UDP port {listening.port} of this machine")
        return listening, options.duration or (HEADLESS_DURATION if options.headless else np.inf)
    values = {name: getattr(options, name) for name in COMMAND_NAMES if getattr(options, name) is not None}
    if options.script is not None:
        others = [
            *values,
            *(name for name in ("gait", "motion", "left_hand", "right_hand") if getattr(options, name) is not None),
        ]
        if others:
            raise CommandError(f"a script and {', '.join(others)} are both given; give one or the other")
        plan = load_plan(options.script)
        if isinstance(plan, Behaviour):
            return BehaviourSource(plan), options.duration or LONGEST
        return plan, options.duration or plan.duration
    moving = any(values.get(name) for name in ("v_x", "v_y", "omega"))
    gait = Gait.parse(options.gait) if options.gait else Gait.WALKING if moving else Gait.STANDING
    command = Command.from_mapping(values, gait).validate()
    if options.motion is not None:
        _refuse_beside("--motion", "a motion moves both arms", options, ("left_hand", "right_hand"))
        if options.motion.suffix.lower() == WHOLE_BODY:
            return _whole_body(options, options.motion)
        motion = load_motion(options.motion)
        segment = Segment(
            motion.name, motion.duration, gait, values, ramp=min(DEFAULT_RAMP, motion.duration), motion=motion
        )
        return Script(motion.name, (segment,)), options.duration or motion.duration
    return Constant(command, _hands(options)), options.duration or (HEADLESS_DURATION if options.headless else np.inf)


def _whole_body(options: PlayOptions, path: pathlib.Path) -> tuple[CommandSource, float]:
    """Return a clip of the whole body and how long to play it [s], and say what is dropped.

    Raises:
        ConfigError: if commands are given as well, or the library that reads the file is not installed.
        MotionFileError: if the file cannot be used.
    """
    _refuse_beside(f"--motion *{WHOLE_BODY}", "the clip commands the whole body", options, ("gait", *COMMAND_NAMES))
    motion = load_whole_body_motion(path)
    say("no command follows the roll of the trunk, the steps of the feet and the directions of hands and head")
    if motion.unused:
        say(f"not used of {path.name}: {', '.join(motion.unused)}")
    return motion, options.duration or motion.duration


def _hands(options: PlayOptions) -> HandTargets | None:
    if options.left_hand is None and options.right_hand is None:
        return None
    if options.left_hand is None or options.right_hand is None:
        raise TargetError("only one hand has a target; give both --left-hand x y z and --right-hand x y z, or neither")
    return HandTargets.of(options.left_hand, options.right_hand)
