"""The modes of a deployment, from idle to damping, and the joint commands of all but the run itself."""

import dataclasses
import enum
from collections.abc import Callable

import numpy as np

from hugwbc.controller import JointCommand
from hugwbc.numeric import smooth_step
from hugwbc.robot import Robot
from hugwbc.state import RobotState

START_TIME = 5.0  # [s] from the present posture to the start pose
DAMPING_GAIN = 8.0  # [N*m*s/rad]; the maker's deploy_real.py ends with it


class Mode(enum.Enum):
    """What the robot side does."""

    IDLE = "idle"
    ZERO_TORQUE = "zero torque"
    START_POSE = "start pose"
    RUN = "run"
    DAMPING = "damping"


@dataclasses.dataclass(frozen=True)
class Event:
    """A transition, a refused one, or a note."""

    time: float  # on the robot's clock [s]
    before: Mode  # mode until then
    after: Mode  # mode from then on; `before` again for a request that was refused, and for a note
    reason: str  # why
    refused: bool = False  # whether a request was refused

    def __str__(self) -> str:
        """Return the event as a line of the log."""
        what = self.before.value if self.before is self.after else f"{self.before.value} -> {self.after.value}"
        what = f"{what}: refused" if self.refused else what
        return f"[{self.time:9.3f} s] {what}: {self.reason}"


class StateMachine:
    """The mode of a deployment and the record of its changes."""

    def __init__(self, robot: Robot, tell: Callable[[Event], None] | None = None) -> None:
        """Begin idle; `tell` is called with each event."""
        self._robot, self._tell = robot, tell
        self.mode = Mode.IDLE
        self.events: list[Event] = []  # all so far
        self.faulty = False  # whether a fault, and not the operator, has led to damping, or made the robot kneel
        self._from, self._since = robot.nominal, 0.0

    def enter(self, mode: Mode, reason: str, state: RobotState) -> None:
        """Change the mode; a start pose begins with the posture of the state."""
        event = Event(state.time, self.mode, mode, reason)
        self.mode, self._since = mode, state.time
        if np.isfinite(state.q).all():
            self._from = np.clip(state.q, self._robot.lower, self._robot.upper)
        self._log(event)

    def note(self, what: str, time: float) -> None:
        """Log what else the operator must know, at a time [s]."""
        self._log(Event(time, self.mode, self.mode, what))

    def refuse(self, reason: str, time: float) -> None:
        """Log a refused request at a time [s]; a repetition of the last refusal is not logged."""
        event = Event(time, self.mode, self.mode, reason, refused=True)
        if not self.events or (self.events[-1].reason, self.events[-1].refused) != (reason, True):
            self._log(event)

    def fail(self, reason: str, state: RobotState) -> None:
        """Damp the joints because of a fault; a robot whose joints are limp stays as it is."""
        if self.active:
            self.faulty = True
            self.enter(Mode.DAMPING, reason, state)

    @property
    def active(self) -> bool:
        """Whether the joints are driven, so that a fault must end it."""
        return self.mode in (Mode.START_POSE, Mode.RUN)

    def _log(self, event: Event) -> None:
        self.events.append(event)
        if self._tell is not None:
            self._tell(event)

    def in_start_pose(self, time: float) -> bool:
        """Return whether the way to the start pose is over at a time [s]."""
        return self.mode is Mode.START_POSE and time - self._since >= START_TIME

    def command(self, time: float) -> JointCommand | None:
        """Return the joint command of the mode at a time [s]; None while idle, and for a run, which has its controller.

        On the way to the start pose the gains grow with the progress, so that a robot in any posture starts without a
        jolt.
        """
        robot, zero = self._robot, np.zeros_like(self._robot.kp)
        if self.mode is Mode.ZERO_TORQUE:
            return JointCommand(q=self._from, dq=zero, kp=zero, kd=zero, tau=zero)
        if self.mode is Mode.START_POSE:
            part = smooth_step((time - self._since) / START_TIME)
            q = self._from + part * (robot.nominal - self._from)
            return JointCommand(q=q, dq=zero, kp=part * robot.kp, kd=part * robot.kd, tau=zero)
        return damping(robot) if self.mode is Mode.DAMPING else None


def damping(robot: Robot) -> JointCommand:
    """Return the command that only slows the joints down."""
    zero = np.zeros_like(robot.kp)
    return JointCommand(q=robot.nominal, dq=zero, kp=zero, kd=np.full_like(zero, DAMPING_GAIN), tau=zero)
