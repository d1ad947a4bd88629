"""The control loop of one robot in simulation: sensors, arms, controller behind the safety filter, joints."""

import time
from typing import Protocol

import numpy as np

from hugwbc import rotations
from hugwbc.commands import Command
from hugwbc.controller import Controller, JointCommand, UpperBody
from hugwbc.errors import ConfigError
from hugwbc.robot import Robot
from hugwbc.runtime.estimation import StateEstimator, estimator_for
from hugwbc.runtime.moment import Moment, PlanView
from hugwbc.runtime.safety import SafetyFilter
from hugwbc.runtime.sight import Sight, SimulatedWorld, carry_out
from hugwbc.runtime.trace import CONTACT_FORCE
from hugwbc.scripts.command_source import CommandSource, FollowingSource, SeeingSource
from hugwbc.sim import Engine
from hugwbc.state import RobotState
from hugwbc.targets import HandTargets
from hugwbc.upper_ik import IKSolution


class ArmSource(Protocol):
    """An object that turns hand targets into arm joint targets, such as `hugwbc.upper_ik.UpperBodySource`."""

    @property
    def solution(self) -> IKSolution | None:
        """The last IK solution; None while the controller moves the arms."""
        ...

    def reset(self) -> None:
        """Give the arms back at once, for a new run."""
        ...

    def update(
        self,
        state: RobotState,
        hands: HandTargets | None,
        command: Command,
        dt: float,
        commanded: np.ndarray | None = None,
    ) -> tuple[UpperBody, Command]:
        """Return the arm targets for the next `dt` seconds, and the command as the hands need it.

        Args:
            state: the robot now.
            hands: the hand targets; None gives the arms back to the controller.
            command: the user's command; its h, p and w may change for targets that ask for the whole body.
            dt: length of the control period [s].
            commanded: the arm part of the last joint command [rad], shape (8,); None at the start.
        """
        ...


def substeps_of(period: float, timestep: float, name: str) -> int:
    """Return the number of physics steps in a control period.

    Args:
        period: the controller's period [s].
        timestep: of the physics [s].
        name: the controller's name, for the message.
    """
    substeps = round(period / timestep)
    if substeps < 1 or abs(substeps * timestep - period) > 1e-9:
        raise ConfigError(
            f"the period of controller '{name}' is {period:g} s, not a multiple of the physics time step "
            f"{timestep:g} s; choose a time step that divides it, such as 0.002 s"
        )
    return substeps


class ControlLoop:
    """Everything between the sensors and the joints, run at the controller's period.

    One tick goes downhill, each part once: the source of commands, the arms, the safety filter with the controller
    inside it, the joints.

    Attributes:
        safe: the controller behind its safety filter.
        simulation: the robot.
        period: the controller's period [s].
        substeps: physics steps in a period.
        estimator: gives the controller the state from noisy sensors; None where the sensors tell it.
        hands: the last hand targets, None where the controller moves the arms.
        ik_s: time that the last call of the arms' source took [s].
    """

    def __init__(
        self,
        controller: Controller,
        source: CommandSource,
        simulation: Engine,
        upper_body: ArmSource | None = None,
        estimator: StateEstimator | None = None,
        robot: Robot | None = None,
    ) -> None:
        """Connect the parts; call `reset` before the first `decide`.

        Args:
            controller: any object with the members of `Controller`.
            source: gives commands and hand targets over time.
            simulation: the robot.
            upper_body: turns hand targets into arm targets; None ignores hand targets.
            estimator: estimates the state from the sensors; None for one that knows the simulated robot, or for none
                where the sensors tell the state.
            robot: robot whose limits the safety filter keeps, and whose weight and friction the servo of the arms makes
                up for; None for the simulated one with its drives. What the controller, the hand IK and the estimator
                are told is up to them.
        """
        self.safe = SafetyFilter(controller, robot=robot or simulation.known_robot)
        self.source = source
        self._following = source if isinstance(source, FollowingSource) else None
        self._seeing = source if isinstance(source, SeeingSource) else None
        self._plan = PlanView(controller)
        self.simulation = simulation
        self.upper_body = upper_body
        self.estimator = estimator or estimator_for(simulation)
        self.period = self.safe.period
        self.substeps = substeps_of(self.period, simulation.timestep, controller.name)
        self.hands: HandTargets | None = None
        self.ik_s = 0.0
        self._commanded_arms: np.ndarray | None = None
        sensing = simulation.sensing
        self._sight = Sight(
            SimulatedWorld(simulation),
            self.safe.robot,
            noisy=bool(sensing.object_position or sensing.object_attitude),
            drifting=not sensing.position,
        )
        self._free_arms = UpperBody.none()

    def reset(self) -> None:
        """Stand the robot up at the origin and start all parts from there."""
        self.simulation.reset()
        reading = self.simulation.sense()
        self._estimate = reading if self.estimator is None else self.estimator.reset(reading)
        self.safe.reset(self._estimate)
        self.hands, self.ik_s = None, 0.0
        self._commanded_arms = None
        if self.upper_body is not None:
            self.upper_body.reset()
        if self._seeing is not None:
            self._seeing.restart()
            self._sight.reset()

    def decide(self, t: float) -> JointCommand:
        """Return the joint command for the next period, from what the sensors say at time t [s]."""
        state = self.simulation.sense() if self.estimator is None else self._estimate
        if self._following is not None:
            self._following.follow(self.simulation.state())
        placed = state if self._seeing is None else self._look(self._seeing, t, state)
        command, arms = self.source.command_at(t), self._free_arms
        if self.upper_body is not None:
            self.hands = self.source.hands_at(t)
            begin = time.perf_counter()
            arms, command = self.upper_body.update(placed, self.hands, command, self.period, self._commanded_arms)
            self.ik_s = time.perf_counter() - begin
        joints = self.safe.act(state, command, arms)
        self._commanded_arms = joints.q[self.simulation.robot.arms]
        return joints

    def _look(self, source: SeeingSource, t: float, state: RobotState) -> RobotState:
        """Show the source what is known now and carry its grips out; return the state in the world that it sees."""
        view = self._sight.look(t, state)
        source.see(view)
        if source.grips:
            carry_out(source.grips, self.simulation)
        return view.state

    def step(self, command: JointCommand, duration: float) -> RobotState:
        """Apply a joint command for a duration [s] and return the true state; the estimator sees every physics step."""
        if self.estimator is None:
            return self.simulation.step(command, duration)
        timestep = self.simulation.timestep
        planned, steps = self._plan.acceleration, max(1, round(duration / timestep))
        states = [self._observed_step(self.estimator, command, timestep, planned) for _ in range(steps)]
        return states[-1]

    def _observed_step(
        self, estimator: StateEstimator, command: JointCommand, timestep: float, planned: np.ndarray | None
    ) -> RobotState:
        """Make one physics step, show the estimator its reading, and return the true state."""
        state = self.simulation.step(command, timestep)
        self._estimate = estimator.update(self.simulation.sense(), planned)
        return state

    @property
    def estimate(self) -> RobotState:
        """What the controller knows of the robot: the last estimate, or the last reading without an estimator."""
        return self._estimate

    def moment(self) -> Moment:
        """Return what a picture shows now."""
        state, simulation = self.simulation.state(), self.simulation
        assert state.foot_force is not None
        return Moment(
            qpos=simulation.qpos,
            gait=int(self.safe.command.gait),
            phase=self._plan.phase,
            foot_contact=foot_contacts(state),
            foot_force=state.foot_force.copy(),
            pressure_centre=simulation.pressure_centres,
            foothold=self._plan.footholds,
            hand_target_world=world_targets(self.hands, state),
            arm_target=self._arm_target(),
            hand_force=np.zeros((2, 3)) if state.hand_force is None else state.hand_force.copy(),
            object_pose=simulation.objects.poses,
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
        """Whether the left and the right hand have a target within reach, shape (2,), bool."""
        solution = None if self.upper_body is None else self.upper_body.solution
        if solution is None or self.hands is None:
            return np.zeros(2, dtype=bool)
        return solution.reachable & self.hands.given


def foot_contacts(state: RobotState) -> np.ndarray:
    """Return whether the left and the right foot are on the ground, shape (2,), bool."""
    assert state.foot_force is not None
    return state.foot_force[:, 2] > CONTACT_FORCE


def world_targets(hands: HandTargets | None, state: RobotState) -> np.ndarray:
    """Return the hand targets in the world frame at this state [m], shape (2, 3); NaN for a hand without one."""
    if hands is None:
        return np.full((2, 3), np.nan)
    if hands.frame == "world":
        return hands.array()
    assert state.position is not None
    turn = rotations.to_matrix(state.orientation) if hands.frame == "pelvis" else rotations.rotation_z(state.yaw)
    return state.position + hands.array() @ turn.T
