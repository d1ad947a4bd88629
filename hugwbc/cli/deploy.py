"""`hugwbc deploy`: control a robot over the network."""

import contextlib
import dataclasses
import functools
import pathlib
import time
from collections.abc import Callable, Sequence
from typing import Any

import tyro

from hugwbc.behaviours import BehaviourSource
from hugwbc.cli.output import parse, say
from hugwbc.cli.tasks import check_recorded
from hugwbc.deploy.dds import LOOPBACK, DdsEndpoint
from hugwbc.deploy.messages import Messages
from hugwbc.deploy.pilot import Pilot
from hugwbc.deploy.recording import Recorder, Recording, replay
from hugwbc.deploy.relay import RIVAL, Settings
from hugwbc.deploy.remote import OF_KEY, Request, Sticks, listen
from hugwbc.deploy.robot_side import RobotSide
from hugwbc.deploy.telling import Aside
from hugwbc.deploy.transport import Endpoint, release_modes
from hugwbc.deploy.watchdogs import Limits
from hugwbc.errors import ConfigError, DeploymentError
from hugwbc.robot import Robot
from hugwbc.robot_tables import DEFAULT_ROBOT
from hugwbc.runtime.controllers import ControllerSpec
from hugwbc.scripts.script import load_script
from hugwbc.scripts.view import CommandSource
from hugwbc.settings import Positive, settings
from hugwbc.sim.arena import Arena
from hugwbc.sim.engine import check_seed
from hugwbc.sim.sensors import ROBOT
from hugwbc.tasks import load_task
from hugwbc.upper_ik import UpperBodySource

FAULT = 1
_PATIENCE, _POLL = 60.0, 0.5  # [s] for the first state
_LISTEN = 0.5  # [s] for commands of another program
_KEYS = "keys, each with Enter: s start, r run, q or an empty line stop (twice: end)"
# What a recording must hold for its replay.
_RECORDED = ("controller", "policy", "robot", "script", "task", "seed")


@settings
class DeployOptions:
    """Control a robot over the network, a real one or `hugwbc simulate-robot`. Read docs/deploy.md first."""

    controller: str = "learned"  # learned, qp, a plug-in's name, FILE.py:NAME, or the path of a policy or of a contract
    # Name of a shipped policy or path of a policy, for learned; path of a network, for a foreign policy
    policy: str | None = None
    net: str = "lo"  # Network interface to the robot, such as eth0; lo for a simulated robot on this machine
    domain: int | None = None  # DDS domain; by default 1 on lo (a simulated robot), else 0 (a real one)
    robot: str = DEFAULT_ROBOT  # Robot as the controller and the estimator know it, or the path of its table
    # Play this script, with its hand targets, once the controller runs: a shipped script's name, or a file (.yaml). By
    # default the sticks of the remote control give the commands.
    script: str | None = None
    # Do this task instead (docs/tasks.md), by the object poses on the topic rt/hugwbc/objects: a task of the suite, or
    # the path of a Python file with one
    task: str | None = None
    seed: int = 0  # Seed of the objects of --task, as given to `simulate-robot`: it determines their sizes
    release: bool = True  # Release the robot's motion modes first
    tilt: Positive = Limits.tilt  # Tilt above which the joints are damped [rad]
    record: pathlib.Path | None = None  # Record every message to this file
    # Replay this recording through its controller instead, without a network, and compare the commands bit by bit; a
    # controller, policy or task that it names by a path is given again, since it may be a program
    replay: pathlib.Path | None = None
    # How fast it runs, for how long, and whether it publishes
    settings: tyro.conf.OmitArgPrefixes[Settings] = dataclasses.field(
        default_factory=lambda: Settings(age=ROBOT.latency)
    )


def run(words: Sequence[str]) -> int:
    """Parse the options, and deploy or replay; return the exit code: 1 after a fault, or for a replay that differs."""
    options = parse(DeployOptions, words, "deploy")
    if options.replay is not None:
        return _replay(options, options.replay)
    settings = options.settings
    if options.net != LOOPBACK and (settings.lockstep or settings.slower != 1.0):
        raise ConfigError(f"--lockstep and --slower are for a simulated robot on {LOOPBACK}; a real one does not wait")
    if options.record is not None and options.record.is_file():
        raise ConfigError(f"{options.record} is there already; recordings are never overwritten: give a new file")
    if options.task is None and options.seed != DeployOptions.seed:
        raise ConfigError("--seed is of the objects of a task; give --task, or leave it out")
    if options.task is not None and options.script is not None:
        raise ConfigError("--task gives the commands itself; leave --script out")
    header = {name: getattr(options, name) for name in _RECORDED} | {"age": settings.age}
    header["limits"] = dataclasses.asdict(Limits(tilt=options.tilt))
    robot, pilot, _ = _build(header)
    domain = options.domain if options.domain is not None else 1 if options.net == LOOPBACK else 0
    package = Messages(robot).package
    connect = functools.partial(DdsEndpoint, package=package, robot=False, net=options.net, domain=domain)
    with contextlib.closing(connect()) as endpoint:
        if options.record is None:
            return _deploy(options, pilot, robot, endpoint, None, connect)
        recorder = Recorder(options.record, header)
        try:
            return _deploy(options, pilot, robot, endpoint, recorder, connect)
        finally:
            recorder.close()
            if recorder.failure is not None:
                say(f"the recording is not complete: {recorder.failure}")


def _deploy(
    options: DeployOptions,
    pilot: Pilot,
    robot: Robot,
    endpoint: DdsEndpoint,
    recorder: Recorder | None,
    connect: Callable[[], DdsEndpoint],
) -> int:
    say(f"waiting for states on {options.net}")
    _await_robot(endpoint, robot, options.net)
    if options.release and not options.settings.dry_run:
        say(release_modes(endpoint, required=options.net != LOOPBACK))
    if not options.settings.dry_run:
        _be_alone(endpoint, options.settings.slower)
    say(f"remote control: Start, A, Select; {_KEYS}")
    side = RobotSide(pilot, robot, endpoint, options.settings, recorder, _tell, connect)
    listen(lambda line: side.ask(OF_KEY.get(line[:1] or " ", Request.STOP)))
    begin = time.perf_counter()
    try:
        side.run()
    finally:
        _tell(summary(side, time.perf_counter() - begin))
        _aside().finish()
    return FAULT if pilot.machine.faulty or side.fault is not None else 0


def _tell(event: object) -> None:
    """Print what happens."""
    _aside()(str(event))


@functools.cache
def _aside() -> Aside:
    """Return what prints, once in each process."""
    return Aside(say)


def _await_robot(endpoint: DdsEndpoint, robot: Robot, net: str) -> None:
    """Wait for the first state, which another robot may send."""
    end = time.perf_counter() + _PATIENCE
    while not endpoint.receive(_POLL):
        if (other := endpoint.foreign()) is not None:
            raise DeploymentError(f"the robot on {net} sends {other}, so it is no {robot.name}; name it with --robot")
        if time.perf_counter() > end:
            raise DeploymentError(
                f"no state has arrived on {net} for {_PATIENCE:g} s; check the robot, the network and the domain"
            )


def _be_alone(endpoint: Endpoint, slower: float) -> None:
    """Refuse a robot that another program commands."""
    endpoint.rivals()
    time.sleep(_LISTEN * slower)
    if endpoint.rivals():
        raise DeploymentError(f"{RIVAL}; end that program first: with two, a robot falls")


def summary(side: RobotSide, wall: float) -> str:
    """Return a summary of the measured times."""
    intake, timing, report = side.intake, side.timing, side.pilot.control.log.report()
    lines = [
        f"{intake.received} states in {wall:.1f} s: {intake.wrong_sum} with a wrong check sum, {intake.old} old, "
        f"{intake.torn} of a wrong size, longest gap {1e3 * intake.gap:.0f} ms",
        f"{side.sent} commands sent",
        f"latency from state to command: {timing.latency}",
        f"commands later than the controller's period, or left out: {timing.missed} of {timing.latency.count}, "
        f"at most {timing.longest_miss} in a row",
        f"jitter of the publishing thread: {timing.jitter}",
        *([str(side.captures)] if side.captures.received else []),
        *report.messages,
    ]
    return "\n".join(lines)


def _build(header: dict[str, Any]) -> tuple[Robot, Pilot, float]:
    """Return robot, pilot and the age of the readings [s], of a deployment or of its recording."""
    try:
        arena, limits, age = Arena(header["robot"]), Limits(**header["limits"]), float(header["age"])
        spec = ControllerSpec(header["controller"], header["policy"]).told(arena)
        script, task, seed = header["script"], header["task"], header["seed"]
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ConfigError(f"the recording does not say what was run ({error}); record it again") from error
    robot = arena.known_robot
    source = _source(script, task, seed, robot)
    arms = UpperBodySource(robot=robot)
    pilot = Pilot(spec.build(), source, robot, limits=limits, upper_body=arms, tell=_tell)
    return robot, pilot, age


def _check_replay(options: DeployOptions, header: dict[str, Any]) -> None:
    """Refuse options that a replay does not use, and programs that only the recording names."""
    given, default = ({**vars(one), **vars(one.settings)} for one in (options, DeployOptions()))
    for name, value in given.items():
        if name not in ("replay", "settings") and value not in (default[name], header.get(name)):
            raise ConfigError(f"a replay runs what was recorded; leave --{name.replace('_', '-')} out")
    check_recorded(header, {name: (given[name],) for name in ("controller", "policy", "task")})


def _source(script: str | None, task: str | None, seed: int, robot: Robot) -> CommandSource:
    """Return the source of commands: a task's behaviour, a script, or the sticks."""
    if task is not None:
        check_seed(seed)
        sized = load_task(task).sized(robot)
        return BehaviourSource(sized.behaviour_in(sized.scene.draw(seed)))
    return Sticks(robot) if script is None else load_script(script, robot)


def _replay(options: DeployOptions, path: pathlib.Path) -> int:
    """Replay a recording and compare its commands; return the exit code."""
    recording = Recording(path)
    _check_replay(options, recording.header)
    robot, pilot, age = _build(recording.header)
    result = replay(recording, pilot, Messages(robot), age)
    _aside().finish()
    if not result.decisions:
        raise ConfigError(f"{path} has no commands to compare: it was cut off; record it again with --record")
    same = "all equal bit for bit" if not result.different else f"{result.different} differ, first at {result.first} s"
    say(f"{result.states} states, {result.decisions} commands: {same}")
    if result.last is not None:
        say("joints in the last state, and in the nominal pose [rad]:")
        for name, q, nominal in zip(robot.joint_names, result.last.q, robot.nominal, strict=True):
            say(f"  {name:<26} {q:7.3f} {nominal:7.3f}")
    return FAULT if result.different else 0
