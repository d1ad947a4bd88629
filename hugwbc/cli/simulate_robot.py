"""`hugwbc simulate-robot`: a robot in simulation, behind the messages of a real one."""

import dataclasses
import math
import time
from collections.abc import Sequence

import tyro

from hugwbc.cli.output import parse_settings, say, say_arena
from hugwbc.controller import JointCommand
from hugwbc.deploy.dds import LOOPBACK, DdsEndpoint
from hugwbc.deploy.messages import Messages
from hugwbc.deploy.relay import Slower
from hugwbc.deploy.remote import listen
from hugwbc.deploy.simulated_robot import HOIST_WORDS, Happening, Radio, Schedule, SimulatedRobot
from hugwbc.errors import ConfigError
from hugwbc.settings import Positive, settings
from hugwbc.sim import Arena, Simulation, load_scene
from hugwbc.tasks import Ending, Task, load_task
from hugwbc.tasks.record import TaskWatch

_LISTEN = 0.5  # [s] for states of another robot


@settings
class SimulateRobotOptions:
    """Simulate a robot that is read and driven by messages alone, on this machine; Ctrl-C stops."""

    domain: int = 1  # DDS domain
    # What its remote control and its hoist do, and when, from the first sound command on [s]: "1 Start, 4 lower, 7 A, 8
    # release, 9 ly=0.5, 30 Select"
    schedule: str = ""
    # Stand among the objects of this task (docs/tasks.md), and say at the end whether it was done: a task of the suite,
    # or the path of a Python file with one
    task: str | None = None
    scene: str | None = None  # Stand among the objects of this scene file (docs/scenes.md)
    mode: str = ""  # Motion mode that is active at first, such as normal; commands are refused until it is released
    slower: Slower = 1.0  # How many times slower than the wall clock it runs
    lockstep: bool = False  # Wait for the answer to each state, from `hugwbc deploy --lockstep`
    duration: Positive | None = None  # End after this time [s]; by default on Ctrl-C
    seed: int = 0  # Seed of the sensors' errors, of the packets' fates and of the objects
    radio: tyro.conf.OmitArgPrefixes[Radio] = dataclasses.field(default_factory=Radio)
    arena: tyro.conf.OmitArgPrefixes[Arena] = dataclasses.field(default_factory=Arena)


def run(words: Sequence[str]) -> int:
    """Parse the options and simulate; return the exit code."""
    options = parse_settings(SimulateRobotOptions, words, "simulate-robot")
    say_arena(options.arena)
    schedule = Schedule.parse(options.schedule)
    if options.task is not None and options.scene is not None:
        raise ConfigError("--task has a scene of its own; leave --scene out")
    task = None if options.task is None else load_task(options.task).sized(options.arena.known_robot)
    scene = task.scene if task is not None else None if options.scene is None else load_scene(options.scene)
    simulation = options.arena.simulation(latency=0.0, seed=options.seed, scene=scene)
    judge = None if task is None else Judge(task, simulation)
    package = Messages(simulation.robot).package
    # Never on a real network, where it could be taken for a real robot.
    endpoint = DdsEndpoint(package=package, robot=True, net=LOOPBACK, domain=options.domain)
    endpoint.rivals()
    time.sleep(_LISTEN)
    if endpoint.rivals():
        raise ConfigError(
            f"another robot is simulated in domain {options.domain}, and both would follow the same commands; end it, "
            "or give another --domain here and to deploy"
        )
    robot = SimulatedRobot(
        simulation,
        endpoint,
        radio=options.radio,
        schedule=schedule,
        mode=options.mode,
        latency=options.arena.profile.latency,
        seed=options.seed,
        tell=say,
        watch=judge or (lambda command: None),
    )
    say(f"simulating {simulation.robot.name} on {LOOPBACK}, domain {options.domain}; words: {', '.join(HOIST_WORDS)}")
    listen(lambda line: schedule.add(Happening(max(robot.scheduled, 0.0), line)) if line in HOIST_WORDS else None)
    try:
        robot.run(options.duration or math.inf, slower=options.slower, lockstep=options.lockstep)
    finally:
        say(summary(robot))
        if (other := endpoint.foreign()) is not None:
            say(f"another program sends {other}, which {simulation.robot.name} does not read: it reads {package}")
        if judge is not None:
            say(judge.words())
        endpoint.close()
    return 0


class Judge:
    """Judges a task while the joints are driven: not before, and not when they are damped at the end."""

    def __init__(self, task: Task, simulation: Simulation) -> None:
        """Wait for the first command that drives the joints of a simulation."""
        self._task, self._simulation = task, simulation
        self._watch: TaskWatch | None = None
        self._start = 0.0

    def __call__(self, command: JointCommand) -> None:
        """Look at the world after a physics step with a command."""
        if command.kp.any():
            if self._watch is None:
                self._watch, self._start = TaskWatch(self._simulation), self._simulation.time
            self._watch.look()
            self._watch.sample(self._simulation.time - self._start)

    def words(self) -> str:
        """Return the verdict, for people."""
        if self._watch is None:
            return f"{self._task.name}: the joints were never driven"
        return f"{self._task.name}: {self._task.judge(self._watch.record(Ending(True))).words}"


def summary(robot: SimulatedRobot) -> str:
    """Return what happened, for people."""
    simulation, most = robot.simulation, robot.extremes
    refused = ", ".join(f"{count} for their {reason}" for reason, count in robot.tally.counts.items()) or "none"
    return "\n".join(
        [
            f"{robot.time:.1f} s simulated, {robot.tally.received} commands received, refused: {refused}",
            f"largest joint speed {most.speed:.2f} and torque {most.torque:.2f} of the limit, {most.beyond:.3f} rad "
            f"beyond a joint's range, lowest pelvis {most.lowest:.2f} m, longest silence {most.silence:.3f} s",
            f"the robot {'has fallen' if simulation.fallen else 'is up'}",
        ]
    )
