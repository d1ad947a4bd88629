"""The control loop of one robot in simulation: sense, upper body, controller behind the safety filter, joints."""

import dataclasses
import time
from typing import Protocol, runtime_checkable

import numpy as np

from hugwbc import rotations
from hugwbc.commands import Command
from hugwbc.controller import Controller, JointCommand, UpperBody
from hugwbc.errors import ConfigError
from hugwbc.runtime.estimation import StateEstimator
from hugwbc.runtime.moment import Moment, gait_plan
from hugwbc.runtime.safety import SafetyFilter
from hugwbc.sim import Simulation
from hugwbc.state import RobotState
from hugwbc.targets import HandTargets
from hugwbc.upper_ik import BodyReach, HandBack, IKSolution

CONTACT_FORCE = 1.0  # [N] above which a foot counts as on the ground


class UpperBodySource(Protocol):
    """What turns hand targets into arm joint targets: `hugwbc.upper_ik.UpperBodySource`, or another."""

    @property
    def solution(self) -> IKSolution | None:
        """The last IK solution; None while the arms are the controller's."""
        ...

    def reset(self) -> None:
        """Give the arms back at once, for a new run."""
        ...

    def update(
        self, state: RobotState, hands: HandTargets | None, dt: float, commanded: np.ndarray | None = None
    ) -> UpperBody:
        """Arm targets for the next `dt` seconds; no hands gives the arms back.

        `commanded` is the arm part of the last joint command, None at the start [rad], shape (8,).
        """
        ...


class CommandSource(Protocol):
    """What gives commands and hand targets over time: a `hugwbc.scripts.script.Script`, or a `Constant`."""

    def command_at(self, t: float) -> Command:
        """The command at time t [s]."""
        ...

    def hands_at(self, t: float) -> HandTargets | None:
        """The hand targets at time t [s]; None leaves the arms to the controller."""
        ...


@runtime_checkable
class FollowingSource(CommandSource, Protocol):
    """A command source whose commands depend on where the robot is."""

    def follow(self, state: RobotState) -> None:
        """See the true state, before each `command_at`."""
        ...


@dataclasses.dataclass(frozen=True)
class Constant:
    """The same command and hand targets at all times; without targets the arms are the controller's."""

    command: Command
    hands: HandTargets | None = None

    def command_at(self, t: float) -> Command:
        """The command."""
        return self.command

    def hands_at(self, t: float) -> HandTargets | None:
        """The hand targets."""
        return self.hands


def substeps_of(period: float, timestep: float, name: str) -> int:
    """Physics steps in a period of a controller.

    Raises:
        ConfigError: if the period is no multiple of the time step.
    """
    substeps = round(period / timestep)
    if substeps < 1 or abs(substeps * timestep - period) > 1e-9:
        raise ConfigError(
            f"the period of controller '{name}' is {period:g} s, no multiple of the physics time step {timestep:g} s; "
            "choose a time step that divides it, such as 0.002 s"
        )
    return substeps


class ControlLoop:
    """Everything between the sensors and the joints, at the controller's period.

    Attributes:
        safe: the controller behind its safety filter.
        simulation: the robot.
        period: of the controller [s].
        substeps: physics steps in a period.
        estimator: gives the controller the state from noisy sensors; None where it reads `Simulation.sense` itself.
        hands: the last hand targets, None where the arms are the controller's.
        ik_s: time that the last call of the upper-body source took [s].
    """

    def __init__(
        self,
        controller: Controller,
        source: CommandSource,
        simulation: Simulation,
        upper_body: UpperBodySource | None = None,
        estimator: StateEstimator | None = None,
    ) -> None:
        """Connect the parts; call `reset` before the first `decide`.

        Raises:
            ConfigError: if the controller's period is no multiple of the physics time step.
        """
        self.safe = SafetyFilter(controller)
        self.source = source
        self._following = source if isinstance(source, FollowingSource) else None
        self.simulation = simulation
        self.upper_body = upper_body
        self.estimator = estimator
        self.period = self.safe.period
        self.substeps = substeps_of(self.period, simulation.timestep, controller.name)
        self.hands: HandTargets | None = None
        self.ik_s = 0.0
        self._commanded_arms: np.ndarray | None = None
        self._hand_back = HandBack()
        self._body_reach: BodyReach | None = None

    def reset(self) -> None:
        """Stand the robot up at the origin and start all parts from there."""
        self.simulation.reset()
        reading = self.simulation.sense()
        self._estimate = reading if self.estimator is None else self.estimator.reset(reading)
        self.safe.reset(self._estimate)
        self.hands, self.ik_s = None, 0.0
        self._commanded_arms = None
        self._hand_back.reset()
        self._body_reach = None
        if self.upper_body is not None:
            self.upper_body.reset()

    def decide(self, t: float) -> JointCommand:
        """The joint command for the next period, from what the sensors say at time t [s]."""
        state = self.simulation.sense() if self.estimator is None else self._estimate
        arms = UpperBody.none()
        if self.upper_body is not None:
            self.hands = self.source.hands_at(t)
            begin = time.perf_counter()
            arms = self.upper_body.update(state, self.hands, self.period, self._commanded_arms)
            self.ik_s = time.perf_counter() - begin
        if self._following is not None:
            self._following.follow(self.simulation.state())
        wanted = self._reached(self.source.command_at(t), state)
        filtered = self.safe.act(state, wanted, arms)
        command = self._hand_back(filtered, arms, self.period)
        if command is not filtered:  # a sum of two commands within the limits need not be
            command = self.safe.limited(command)
        self._commanded_arms = command.q[self.simulation.robot.arms]
        return command

    def _reached(self, command: Command, state: RobotState) -> Command:
        """The command, with h, p and w as hand targets need them that ask for the whole body.

        Targets that the arms do not follow, such as the last ones of a stream that has ended, ask for nothing.
        """
        followed = self.upper_body is not None and self.upper_body.solution is not None
        hands = self.hands if followed else None
        if self._body_reach is None:
            if hands is None or not hands.whole_body:
                return command
            self._body_reach = BodyReach()
        return self._body_reach.update(hands, state, command, self.period)

    def step(self, command: JointCommand, duration: float) -> RobotState:
        """Apply a joint command for a duration [s], the estimator following every physics step; the true state."""
        if self.estimator is None:
            return self.simulation.step(command, duration)
        timestep = self.simulation.timestep
        planned = getattr(self.safe.controller, "planned_acceleration", None)  # not every controller plans
        for _ in range(max(1, round(duration / timestep))):
            self.simulation.step(command, timestep)
            self._estimate = self.estimator.update(self.simulation.sense(), planned)
        return self.simulation.state()

    def moment(self) -> Moment:
        """What a picture shows now."""
        state, simulation = self.simulation.state(), self.simulation
        assert state.foot_force is not None
        phase, foothold = gait_plan(self.safe.controller)
        return Moment(
            qpos=simulation.data.qpos.copy(),
            gait=int(self.safe.command.gait),
            phase=phase,
            foot_contact=foot_contacts(state),
            foot_force=state.foot_force.copy(),
            pressure_centre=simulation.pressure_centres,
            foothold=foothold.copy(),
            hand_target_world=world_targets(self.hands, state),
            arm_target=self._arm_target(),
        )

    def _arm_target(self) -> np.ndarray:
        if self.upper_body is None or self.hands is None:
            return np.full(8, np.nan)
        if self.hands.joints is not None:
            return self.hands.joints.copy()
        solution = self.upper_body.solution
        return np.full(8, np.nan) if solution is None else solution.q.copy()

    @property
    def reachable(self) -> np.ndarray:
        """Whether there is a left and a right hand target that can be reached, shape (2,), bool."""
        solution = None if self.upper_body is None else self.upper_body.solution
        if solution is None or self.hands is None:
            return np.zeros(2, dtype=bool)
        return solution.reachable & self.hands.given


def foot_contacts(state: RobotState) -> np.ndarray:
    """Whether the left and the right foot are on the ground, shape (2,), bool."""
    assert state.foot_force is not None
    return state.foot_force[:, 2] > CONTACT_FORCE


def world_targets(hands: HandTargets | None, state: RobotState) -> np.ndarray:
    """Hand targets in the world at this state [m], shape (2, 3); NaN where there is none."""
    if hands is None:
        return np.full((2, 3), np.nan)
    if hands.frame == "world":
        return hands.array()
    assert state.position is not None
    turn = rotations.to_matrix(state.orientation) if hands.frame == "pelvis" else rotations.rotation_z(state.yaw)
    return state.position + hands.array() @ turn.T
