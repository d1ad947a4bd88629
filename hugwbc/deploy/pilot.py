"""The decisions of a deployment: from each state and request to the joint command.

It has neither threads nor a clock of its own. What it does follows from the states, requests and faults that it is
given, in their order, so that a recording of these can be replayed bit for bit.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence

from hugwbc.controller import Controller, JointCommand
from hugwbc.deploy.capture import Capture, CapturedWorld
from hugwbc.deploy.messages import StateMessage
from hugwbc.deploy.remote import ButtonPresses, Request
from hugwbc.deploy.state_machine import Event, Mode, StateMachine
from hugwbc.deploy.watchdogs import BodyLimits, Limits, run_refusal, start_refusal
from hugwbc.robot import Robot
from hugwbc.runtime.control_period import ControlPeriod, Due
from hugwbc.runtime.estimation import StateEstimator
from hugwbc.runtime.guard import HOLD_TIME
from hugwbc.runtime.sight import Sight
from hugwbc.scripts.view import CommandSource, Grip
from hugwbc.state import RobotState
from hugwbc.upper_ik import UpperBodySource

_ROUNDING = 1e-9  # [s]


@dataclasses.dataclass(frozen=True, eq=False)
class Decision:
    """The response to a state."""

    time: float  # of the state, on the robot's clock [s]
    command: JointCommand | None  # for the joints; None while nothing is to be sent
    new: bool  # whether it was computed from this state, and is not that of an earlier one
    skipped: int = 0  # periods before it without a call of the controller


class Pilot:
    """State estimator, state machine, and the control period with the controller."""

    def __init__(
        self,
        controller: Controller,
        source: CommandSource,
        robot: Robot,
        *,
        limits: Limits | None = None,
        upper_body: UpperBodySource | None = None,
        tell: Callable[[Event], None] | None = None,
    ) -> None:
        """Connect the parts.

        Args:
            controller: any object with the members of `Controller`.
            source: gives commands and hand targets over time, from the moment when the controller starts; if it has
                a method `steer(remote, time)`, it is told the sticks before each `command_at`.
            robot: robot as the estimator and the limits know it.
            limits: when to damp; None for the defaults.
            upper_body: turns hand targets into arm targets; None ignores hand targets.
            tell: called with each transition and refusal.
        """
        self.limits = limits or Limits()
        self.machine = StateMachine(robot, tell)  # the modes
        # A hoist may carry a part of the robot, so the legs alone must tell which feet stand. The default also assumes
        # that nothing but the feet carries the floating base, which under a taut rope leads to a fall.
        self.estimator = StateEstimator(robot, base_weight=0.0)
        self._world = CapturedWorld(self._note)
        self.control = ControlPeriod(
            controller,
            source,
            Sight(self._world, robot),
            robot=robot,
            estimator=self.estimator,
            upper_body=upper_body,
        )
        self.control.log.tell = self._note
        self.estimate: RobotState | None = None  # the last one
        self._robot = robot
        self._steer = getattr(source, "steer", None)
        self._watch, self._buttons = BodyLimits(robot, self.limits), ButtonPresses()
        self._weight = robot.weight
        self._estimating = False
        self._last: JointCommand | None = None
        self._last_time = math.inf
        self._due, self._run_start, self._decided = Due(self.control.period), 0.0, 0.0

    @property
    def mode(self) -> Mode:
        """The current mode."""
        return self.machine.mode

    def _note(self, problem: str) -> None:
        self.machine.note(problem, self._last_time)

    @property
    def carried(self) -> float:
        """Part of the weight that the feet carry, as the torques of the legs tell."""
        return float(self.estimator.foot_force[:, 2].sum()) / self._weight

    @property
    def grips(self) -> tuple[Grip, ...]:
        """What the source requested of the idealised grippers at the last call of the controller, in a run."""
        return self._world.grips if self.mode is Mode.RUN else ()

    def see(self, capture: Capture) -> None:
        """Take a motion capture of robot and objects, for a source that uses it."""
        self._world.take(capture)

    def observe(
        self,
        message: StateMessage,
        requests: Sequence[Request] = (),
        fault: str | None = None,
        *,
        behind: bool = False,
    ) -> Decision:
        """Take a state that is newer than all before, and return the joint command that holds from now on.

        Args:
            message: the state.
            requests: what the operator has asked for since the last state, by other means than the remote control.
            fault: a fault that the watchdogs outside the pilot have found since the last state.
            behind: whether a newer state waits, for which the controller is called instead.
        """
        state = message.state
        self._estimate(state, behind)
        fault = fault or self._fault(message)
        if fault is not None:
            self.machine.fail(fault, state)
        if self.mode is Mode.IDLE:
            self.machine.enter(Mode.ZERO_TORQUE, "the robot sends states", state)
        for request in (*self._buttons.update(message.remote.pressed), *requests):
            self._take(request, state)
        self._last_time = state.time
        if self.mode is Mode.RUN:
            return self._run(message, behind)
        self._last = self.machine.command(state.time)
        return Decision(state.time, self._last, new=True)

    def _estimate(self, state: RobotState, behind: bool) -> None:
        control = self.control
        if self._estimating and state.time >= self._last_time:
            control.observe(state, state.time, driven=self.mode is Mode.RUN, behind=behind)
        elif state.is_usable:  # the first one, also of a robot that was restarted: its clock is back at 0
            self._estimating = True
            control.locate(state, state.time)
        self.estimate = control.estimate if self._estimating else state

    def _fault(self, message: StateMessage) -> str | None:
        """Return the fault of the body, of the time between two states or of the controller; None if there is none."""
        fault = self._watch.fault(message)
        gap = message.state.time - self._last_time
        if fault is None and gap > self.limits.silence + _ROUNDING:
            return f"no state for {gap * 1e3:.0f} ms by their ticks"
        if fault is None and self.mode is Mode.RUN and self.control.guard.damps:
            # In a simulation it may begin again. Here, people may be beside a robot that hangs limply in its hoist.
            return f"no joint command from {self.control.guard.name} for {HOLD_TIME * 1e3:.0f} ms"
        return fault

    def _take(self, request: Request, state: RobotState) -> None:
        machine = self.machine
        if request is Request.STOP:
            if self.mode is not Mode.DAMPING:
                machine.enter(Mode.DAMPING, "asked to stop", state)
        elif request is Request.START and self.mode is Mode.ZERO_TORQUE:
            refusal = start_refusal(state, self._robot, self.limits)
            if refusal is None:
                where = "hanging or held" if self.carried < self.limits.carried else "with its weight on its feet"
                machine.enter(Mode.START_POSE, f"asked to start, {where}", state)
            else:
                machine.refuse(refusal, state.time)
        elif request is Request.RUN and self.mode is Mode.START_POSE:
            refusal = run_refusal(state, self.carried, self._robot, self.limits)
            if not machine.in_start_pose(state.time):
                machine.refuse("asked to run, but the robot is still on its way to the start pose", state.time)
            elif refusal is not None:
                machine.refuse(refusal, state.time)
            else:
                self._begin(state)
        else:
            machine.refuse(f"asked to {request.value}, which {self.mode.value} does not lead to", state.time)

    def _begin(self, state: RobotState) -> None:
        """Start the controller from a robot that stands still."""
        self.machine.enter(Mode.RUN, f"asked to run, with {100 * self.carried:.0f} % of the weight on the feet", state)
        self.control.start(state, state.time)
        self.estimate = self.control.estimate
        self._run_start = self._decided = state.time
        self._due.restart(state.time)

    def _run(self, message: StateMessage, behind: bool) -> Decision:
        """Call the controller if its period is over and this state is the newest; else repeat its last command."""
        time = message.state.time
        if self._last is not None and (behind or not self._due(time)):
            return Decision(time, self._last, new=False)
        if (steer := self._steer) is not None:
            self.control.log.ask("source_failures", "steer of the source", lambda: (steer(message.remote, time),))
        self._world.advance(time)
        self._last = self.control.decide(time - self._run_start)
        self.machine.faulty |= self.control.kneels
        periods, self._decided = round((time - self._decided) / self.control.period), time
        return Decision(time, self._last, new=True, skipped=max(periods - 1, 0))
