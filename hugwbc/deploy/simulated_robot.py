"""A simulated robot behind the messages of a real one, with its network, its hoist, and a schedule of what happens."""

import dataclasses
import heapq
import math
import time
from collections.abc import Callable, Sequence
from typing import Annotated, Generic, TypeVar

import numpy as np
from pydantic import Field

from hugwbc.controller import JointCommand
from hugwbc.deploy.capture import GRIPS, OBJECTS, Capture, grips_of
from hugwbc.deploy.messages import TICK, Messages
from hugwbc.deploy.remote import BUTTONS, STICKS, Remote
from hugwbc.deploy.timing import real_time
from hugwbc.deploy.transport import Endpoint, SimulatedSwitcher
from hugwbc.errors import CaptureError, ConfigError
from hugwbc.robot import SIDES
from hugwbc.runtime.sight import carry_out
from hugwbc.settings import NotNegative, settings
from hugwbc.sim import Simulation
from hugwbc.state import GRAVITY
from hugwbc.streams import Tally

AMBIENT = 30.0  # [degrees Celsius] of the motors; heating is not simulated
_PATIENCE = 5.0  # [s] of the wall clock for an answer in lockstep; the robot side waits twice as long for a state
_POLL = 0.002  # [s]

Content = TypeVar("Content")


@settings
class Radio:
    """What a network does to messages, in each direction."""

    loss: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0  # part of the messages that is lost
    delay: NotNegative = 0.0  # time that a message takes [s]
    jitter: NotNegative = 0.0  # largest additional time, drawn evenly [s]; messages may overtake each other


class Channel(Generic[Content]):
    """Messages on their way in one direction."""

    def __init__(self, radio: Radio, rng: np.random.Generator, delay: float = 0.0) -> None:
        """Begin empty; the delay [s] comes in addition to the radio's."""
        self._radio, self._rng, self._delay = radio, rng, radio.delay + delay
        self._waiting: list[tuple[float, int, Content]] = []
        self._count = self.lost = 0  # messages sent and lost

    def put(self, message: Content, now: float) -> None:
        """Send a message at a time [s]."""
        loss, jitter = self._rng.uniform(size=2)
        if loss < self._radio.loss:
            self.lost += 1
            return
        self._count += 1
        heapq.heappush(self._waiting, (now + self._delay + jitter * self._radio.jitter, self._count, message))

    def take(self, now: float) -> list[Content]:
        """Return what has arrived by a time [s], in the order of arrival."""
        arrived = []
        while self._waiting and self._waiting[0][0] <= now + 1e-9:
            arrived.append(heapq.heappop(self._waiting)[2])
        return arrived


_HOOK = np.array([0.0, 0.0, 0.5])  # on the torso, between the shoulders and the head, in the link's frame [m]
_ROPE = 1.0  # [m] from the hook up to the pulley, when the robot stands
_STIFFNESS, _DAMPING = 5000.0, 500.0  # [N/m], [N*s/m]; the maker's 200 N/m lets an H1 sink by 3 m
_SPEED = 0.1  # [m/s] of the winch
# Heights above the stand at which the rope would carry the whole weight [m]. A lowered robot has more than half of its
# weight on its feet (an H1 57 %, a G1 72 %), and the rope keeps it upright until its controller runs.
LIFTED, LOWERED = 0.1, -0.085


class Hoist:
    """A rope from a pulley above the robot to a hook on its torso, and a winch. The rope only pulls.

    Attributes:
        attached: whether the rope holds the robot.
        height: where the winch would hold the hook, above its height in the stand [m].
    """

    def __init__(self, simulation: Simulation, height: float = LIFTED) -> None:
        """Hang up a robot that has just been reset and touches the ground; the winch first goes to a height [m]."""
        self._simulation = simulation
        self._row = simulation.link_names.index(simulation.robot.trunk)
        self._body = simulation.model.body(simulation.robot.trunk).id
        self._pulley = self._hook() + np.array([0.0, 0.0, _ROPE])
        self._weight = simulation.robot.mass * GRAVITY
        self._distance = _ROPE
        self.attached, self.height, self._target = True, 0.0, height

    def lift(self) -> None:
        """Let the winch lift the robot off the ground."""
        self._target = LIFTED

    def lower(self) -> None:
        """Let the winch lower the robot until its feet carry most of its weight."""
        self._target = LOWERED

    def release(self) -> None:
        """Let go."""
        self.attached = False
        self._simulation.external_force[self._row] = 0.0

    def update(self) -> None:
        """Move the winch for one physics step, and pull."""
        if not self.attached:
            return
        simulation, dt = self._simulation, self._simulation.timestep
        self.height += float(np.clip(self._target - self.height, -_SPEED * dt, _SPEED * dt))
        hook = self._hook()
        rope = self._pulley - hook
        distance = float(np.linalg.norm(rope))
        speed, self._distance = (distance - self._distance) / dt, distance
        # At its height, the rope is stretched by the robot's weight.
        stretch = distance - (_ROPE - self.height - self._weight / _STIFFNESS)
        pull = max(_STIFFNESS * stretch + _DAMPING * speed, 0.0) if stretch > 0.0 else 0.0
        force = pull * rope / distance
        simulation.external_force[self._row, :3] = force
        simulation.external_force[self._row, 3:] = np.cross(hook - simulation.data.xipos[self._body], force)

    def _hook(self) -> np.ndarray:
        data = self._simulation.data
        return data.xpos[self._body] + data.xmat[self._body].reshape(3, 3) @ _HOOK


HOIST_WORDS = ("lift", "lower", "release")
_PRESS = 0.2  # [s] for which a button is held


@dataclasses.dataclass(frozen=True)
class Happening:
    """One event."""

    time: float  # when [s]
    word: str  # a button, a stick or a word for the hoist
    value: float = 0.0  # of a stick


class Schedule:
    """A list of events, and the next one to come."""

    def __init__(self, happenings: Sequence[Happening] = ()) -> None:
        """Begin before the first one."""
        self._next = sorted(happenings, key=lambda one: one.time)
        self._held: dict[str, float] = {}
        self._sticks: dict[str, float] = dict.fromkeys(STICKS, 0.0)
        self.remote = Remote()  # the remote control now

    @classmethod
    def parse(cls, text: str) -> "Schedule":
        """Read a schedule such as "1 Start, 7 lower, 10 A, 12 ly=0.5, 30 Select"."""
        return cls([_happening(item.strip()) for item in text.split(",") if item.strip()])

    def update(self, now: float) -> list[str]:
        """Return the hoist commands due at a time [s], and set the remote control."""
        words = []
        while self._next and self._next[0].time <= now + 1e-9:
            one = self._next.pop(0)
            if one.word in HOIST_WORDS:
                words.append(one.word)
            elif one.word in BUTTONS:
                self._held[one.word] = one.time + _PRESS
            else:
                self._sticks[one.word] = one.value
        self._held = {name: until for name, until in self._held.items() if now < until}
        self.remote = Remote(frozenset(self._held), **self._sticks)
        return words

    def add(self, happening: Happening) -> None:
        """Add something, such as what a person asks for while the robot runs."""
        self._next = sorted([*self._next, happening], key=lambda one: one.time)


def _happening(item: str) -> Happening:
    valid = f"give TIME and one of {', '.join((*BUTTONS, *HOIST_WORDS))}, or lx, ly, rx or ry = -1 to 1"
    words = item.split()
    try:
        time = float(words[0])
        name, _, number = words[1].partition("=")
        value = float(number) if number else 0.0
    except (IndexError, ValueError):
        raise ConfigError(f"'{item}' in the schedule is not valid; {valid}") from None
    known = name in STICKS if number else name in (*BUTTONS, *HOIST_WORDS)
    if len(words) != 2 or not known or not 0.0 <= time < math.inf or not -1.0 <= value <= 1.0:
        raise ConfigError(f"'{item}' in the schedule is not valid; {valid}")
    return Happening(time, name, value)


@dataclasses.dataclass(frozen=True)
class Extremes:
    """The largest values of a run."""

    speed: float = 0.0  # of a joint, as a part of its limit
    torque: float = 0.0  # of a joint, as a part of its limit
    beyond: float = 0.0  # distance of a joint beyond its range [rad]
    lowest: float = math.inf  # lowest height of the pelvis above the ground [m]
    silence: float = 0.0  # longest time for which the same command was held because none came [s]


class SimulatedRobot:
    """A simulated robot that is read and driven by messages alone.

    At each physics step it sends what its sensors say, takes the commands that have arrived, and computes the PD law of
    every joint. Its clock is `tick`. Without commands the motors are off; when commands stop, it does the worst: it
    goes on with the last one.
    """

    def __init__(
        self,
        simulation: Simulation,
        endpoint: Endpoint,
        *,
        radio: Radio | None = None,
        schedule: Schedule | None = None,
        hoist: float | None = 0.1,
        mode: str = "",
        latency: float = 0.0,
        seed: int = 0,
        tell: Callable[[str], None] = lambda text: None,
        watch: Callable[[JointCommand], None] = lambda command: None,
    ) -> None:
        """Hang up the robot and turn it on.

        Args:
            simulation: the physics, whose sensors have no latency of their own.
            endpoint: the robot's end of the connection.
            radio: what happens to messages in each direction; None for nothing.
            schedule: what the remote control and the hoist do, from the first sound command on; None for nothing.
            hoist: height to which the hoist lifts the robot [m]; None for a robot that stands without one.
            mode: name of the motion mode that is active at first; empty for none.
            latency: age of a state when it is sent [s].
            seed: of losses and jitter.
            tell: called with messages for the operator.
            watch: called after each physics step, with the command that the drives had.
        """
        if simulation.sensing.latency > 0.0:
            raise ConfigError("the simulation's sensors have a latency; give it to the simulated robot instead")
        if abs(simulation.timestep / TICK - round(simulation.timestep / TICK)) > 1e-9:
            raise ConfigError(f"time step is {simulation.timestep} s; the robot's clock counts milliseconds")
        self.simulation = simulation
        self._endpoint, self._tell, self._watcher = endpoint, tell, watch
        self._messages = Messages(simulation.robot)
        radio, rng = radio or Radio(), np.random.default_rng(seed)
        self._states: Channel[bytes] = Channel(radio, rng, latency)
        self._commands: Channel[tuple[float, JointCommand]] = Channel(radio, rng)
        self._schedule = schedule or Schedule()
        zero = np.zeros_like(simulation.robot.kp)
        self._command = JointCommand(q=zero, dq=zero, kp=zero, kd=zero, tau=zero)  # the motors are off
        self._command_sent = -math.inf
        self._sent_tick = 0
        self._first: float | None = None
        self._last_arrival = 0.0
        self._shown = -math.inf
        simulation.reset()
        self.hoist = Hoist(simulation, 0.0 if hoist is None else hoist)  # what it hangs on
        if hoist is None:
            self.hoist.release()
        self.switcher = SimulatedSwitcher(mode)  # its motion modes; while one is active, it refuses commands
        endpoint.serve(self.switcher)
        endpoint.texts(GRIPS)  # from now on they are heard
        self.temperature = np.full(simulation.robot.kp.size, AMBIENT)  # of the motors [degrees Celsius]
        # Commands that have arrived; commands and texts with grips that were refused, by reason.
        self.tally = Tally("refused", lambda text: tell(f"[{self.time:.2f} s] {text}"), lambda: self.time)
        self.extremes = Extremes()  # largest values so far

    @property
    def time(self) -> float:
        """The robot's clock [s]."""
        return self.simulation.time

    @property
    def scheduled(self) -> float:
        """Time of the schedule since the first valid command [s]; negative before it."""
        return -1.0 if self._first is None else self.time - self._first

    def send(self) -> int:
        """Read the sensors and send the states that are due; return their number."""
        for word in self._schedule.update(self.scheduled):
            getattr(self.hoist, word)()
            self._tell(f"[{self.time:.2f} s] hoist: {word}")
        # The count begins at 1: clients take a tick of 0 for a robot that does not send yet.
        tick = round(self.time / TICK) + 1
        reading = self.simulation.sense()
        self._states.put(self._messages.pack_state(reading, tick, self.temperature, self._schedule.remote), self.time)
        self._show()
        due = self._states.take(self.time)
        for message in due:
            self._endpoint.send(message)
            self._sent_tick = self._messages.tick(message)
        return len(due)

    def _show(self) -> None:
        """Send what the motion capture sees, whenever it has a new picture."""
        picture = self.simulation.objects.picture()
        if picture is None or picture.time <= self._shown:
            return
        self._shown = picture.time
        gripper = self.simulation.gripper
        held = [None if gripper is None else gripper.held(side) for side in SIDES]
        names = self.simulation.objects.names
        capture = Capture(picture.time + TICK, picture.robot, names, picture.poses, (held[0], held[1]))
        self._endpoint.publish(OBJECTS, capture.text())

    def _take_grips(self) -> None:
        for text in self._endpoint.texts(GRIPS):
            try:
                carry_out(grips_of(text), self.simulation)
            except CaptureError as error:
                self.tally.note("grips", str(error))

    def take(self, timeout: float = 0.0) -> int | None:
        """Take commands that arrive within `timeout` [s]; return which state the last valid one answers, if any."""
        answers = None
        for message in self._endpoint.receive(timeout):
            self.tally.arrived()
            reason = self._refusal(message)
            if reason is not None:
                self.tally.note(*reason)
                continue
            content = self._messages.unpack_command(message)
            if not content.command.is_finite:
                self.tally.note("numbers", "a number in a command is not finite: going on with the last command")
                continue
            answers = content.answers
            self._first = self.time if self._first is None else self._first
            self._commands.put((self.time, content.command), self.time)
        return answers

    def _refusal(self, message: bytes) -> tuple[str, str] | None:
        """Return kind and text of a refusal of a command; None if it is accepted."""
        refusal = self._messages.refusal(self._messages.command, message)
        if refusal is None and self.switcher.active:
            return "motion mode", f"motion mode '{self.switcher.active}' is active; release it first"
        return refusal

    def move(self) -> None:
        """Make one physics step with the newest command."""
        for sent, command in self._commands.take(self.time):
            if sent >= self._command_sent:  # a command that was overtaken is too old
                self._command, self._command_sent, self._last_arrival = command, sent, self.time
        self._take_grips()
        self.hoist.update()
        self.simulation.step(self._command, self.simulation.timestep)
        self._measure()
        self._watcher(self._command)

    def _measure(self) -> None:
        simulation, before = self.simulation, self.extremes
        robot, state = simulation.robot, simulation.state()
        beyond = np.maximum(robot.lower - state.q, state.q - robot.upper)
        assert state.position is not None
        self.extremes = Extremes(
            speed=max(before.speed, float(np.max(np.abs(state.dq) / robot.velocity_limit))),
            torque=max(before.torque, float(np.max(np.abs(simulation.torque) / robot.torque_limit))),
            beyond=max(before.beyond, float(np.max(beyond))),
            lowest=min(before.lowest, float(state.position[2])),
            silence=max(before.silence, self.time - self._last_arrival if self.tally.received else 0.0),
        )

    def run(self, duration: float, *, slower: float = 1.0, lockstep: bool = False) -> None:
        """Run for a duration of the robot's clock [s], infinite for until Ctrl-C.

        It runs so many times slower than the wall clock, or still slower if the computer is. In lockstep it waits for
        the answer to each state while a robot side is connected.
        """
        pace = self.simulation.timestep * slower
        slot, answered = time.perf_counter(), False
        end = self.time + duration
        with real_time():
            while self.time < end - 1e-9:
                sent = self.send()
                if lockstep and answered:
                    answered = self._await_answer() if sent else True
                    slot = time.perf_counter()
                else:
                    slot = max(slot + pace, time.perf_counter() - pace)
                    time.sleep(max(slot - time.perf_counter(), 0.0))
                    answered = bool(self.take())
                self.move()

    def _await_answer(self) -> bool:
        """Wait for the answer to the state that was sent last; return whether it came."""
        end = time.perf_counter() + _PATIENCE
        while time.perf_counter() < end:
            if self.take(_POLL) == self._sent_tick:
                return True
        self._tell(f"[{self.time:.2f} s] no answer for {_PATIENCE:g} s: going on with the last command")
        return False
