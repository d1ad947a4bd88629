"""A robot that stands, as messages, and a simulated robot with its robot side in one process, for tests."""

import dataclasses
import pathlib
from collections.abc import Callable

import numpy as np
from local_endpoint import local_pair

from hugwbc import Command, Gait, JointCommand, UpperBody, load_robot
from hugwbc.controller import Controller
from hugwbc.deploy.messages import Messages, StateMessage
from hugwbc.deploy.pilot import Pilot
from hugwbc.deploy.recording import Recorder
from hugwbc.deploy.relay import Settings
from hugwbc.deploy.remote import Remote, Request
from hugwbc.deploy.robot_side import RobotSide
from hugwbc.deploy.simulated_robot import Schedule, SimulatedRobot
from hugwbc.deploy.state_machine import START_TIME, Mode
from hugwbc.robot import Robot
from hugwbc.runtime import Constant, HoldController
from hugwbc.scripts.view import CommandSource
from hugwbc.sim import Simulation
from hugwbc.sim.sensors import ROBOT
from hugwbc.state import RobotState

H1 = load_robot()
EXACT = dataclasses.replace(ROBOT, **{name: 0.0 for name, value in vars(ROBOT).items() if isinstance(value, float)})
PERIOD_MS = 2


class Counting(HoldController):
    """Holds the nominal pose, and counts its calls; it can be made to think for a while, or to fail."""

    period = 0.002

    def __init__(self) -> None:
        super().__init__(H1)
        self.calls = 0
        self.commands: list[Command] = []
        self.think: Callable[[], None] = lambda: None

    def act(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand:
        self.calls += 1
        self.commands.append(command)
        self.think()
        return super().act(state, command, upper_body)


@dataclasses.dataclass
class Standing:
    """States of a robot that stands still on its feet, one every 2 ms."""

    reading: RobotState
    messages: Messages
    tick: int = 1000

    def raw(self, remote: Remote | None = None, *, after: int = PERIOD_MS, hot: float = 30.0, **changes) -> bytes:
        """The next state as bytes, `after` milliseconds later than the last one, with some readings changed."""
        self.tick += after
        noise = 1e-5 * (self.tick // PERIOD_MS % 5)  # sensors that repeat themselves to the last digit hang
        own = {name: getattr(self.reading, name) + noise for name in ("q", "dq", "imu_gyro")}
        reading = dataclasses.replace(self.reading, **{**own, **changes})
        return self.messages.pack_state(reading, self.tick, np.full(19, hot), remote or Remote())

    def next(self, remote: Remote | None = None, **changes) -> StateMessage:
        """The next state, read."""
        return self.messages.unpack_state(self.raw(remote, **changes))


def make_pilot(controller: Controller | None = None, source: CommandSource | None = None, robot: Robot = H1) -> Pilot:
    return Pilot(controller or Counting(), source or Constant(Command(gait=Gait.STANDING)), robot)


def bring_to(mode: Mode, pilot: Pilot, standing: Standing) -> None:
    """Take a new pilot to a mode by requests, with a jump in time on the way to the start pose."""
    pilot.observe(standing.next())
    if mode is Mode.ZERO_TORQUE:
        return
    pilot.observe(standing.next(), [Request.START])
    assert pilot.mode is Mode.START_POSE
    if mode is Mode.START_POSE:
        return
    pilot.machine._since -= START_TIME
    for _ in range(30):
        pilot.observe(standing.next())
    pilot.observe(standing.next(), [Request.RUN])
    assert pilot.mode is Mode.RUN, pilot.machine.events[-1]
    if mode is Mode.DAMPING:
        pilot.observe(standing.next(), [Request.STOP])
    assert pilot.mode is mode


class RecordedSide:
    """A robot side whose states are told, recorded from its first state on; its controller runs with the next one."""

    def __init__(self, path: pathlib.Path, standing: Standing, source: CommandSource | None = None) -> None:
        self.robot_end, end = local_pair()
        self.told: list[str] = []
        self.recorder = Recorder(path, {"controller": "test"})
        self.side = RobotSide(make_pilot(source=source), H1, end, Settings(), self.recorder, self.told.append)
        self.standing, self.now = standing, 10.0
        self.slot()
        self.side.ask(Request.START)
        self.slot()
        standing.tick += 5100  # a jump of the clock instead of five seconds of states
        for _ in range(30):
            self.slot()
        self.side.ask(Request.RUN)

    def slot(self, raw: bytes | None = None) -> None:
        self.now += 0.002
        raw = self.standing.raw() if raw is None else raw
        state = self.side.accept(raw, self.now)
        if state is not None:
            self.side.handle(raw, state, self.now)
        self.side.publish(self.now)


class Pair:
    """A simulated robot and its robot side in lockstep, in one process."""

    def __init__(
        self, controller: Controller, schedule: str, source: CommandSource | None = None, robot: Robot = H1
    ) -> None:
        simulation = Simulation(robot=robot, latency=0.0, seed=5)
        robot_end, endpoint = local_pair()
        options = {"schedule": Schedule.parse(schedule), "latency": ROBOT.latency, "seed": 5, "hoist": 0.0}
        self.robot = SimulatedRobot(simulation, robot_end, tell=lambda line: None, **options)
        self.pilot = make_pilot(controller, source, robot)
        settings = Settings(lockstep=True, age=ROBOT.latency)
        self.side = RobotSide(self.pilot, simulation.robot, endpoint, settings)

    def run(self, until: float, *, alive: Callable[[], bool] = lambda: True) -> None:
        """Run until a time of the robot's clock [s]; the robot side answers as long as it is alive."""
        while self.robot.time < until - 1e-9:
            self.robot.send()
            if alive():
                self.side.answer(0.0)
            self.robot.take()
            self.robot.move()
