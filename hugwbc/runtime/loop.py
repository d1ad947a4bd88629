"""The control loop of one robot in simulation: sensors, arms, controller, joints."""

import numpy as np

from hugwbc.commands import Command
from hugwbc.controller import Controller, JointCommand
from hugwbc.errors import ConfigError
from hugwbc.runtime.control_period import ControlPeriod
from hugwbc.runtime.controllers import ControllerSpec
from hugwbc.runtime.estimation import StateEstimator, estimator_for
from hugwbc.runtime.sight import Sight, SimulatedWorld
from hugwbc.runtime.trace import CONTACT_FORCE, Snapshot
from hugwbc.scripts.view import CommandSource, Constant, View
from hugwbc.sim import Engine
from hugwbc.state import RobotState
from hugwbc.targets import HandTargets, frame_axes
from hugwbc.upper_ik import UpperBodySource


def substeps_of(period: float, timestep: float, name: str) -> int:
    """Return the number of physics steps in a control period; raise a ConfigError if it is not whole."""
    substeps = round(period / timestep)
    if substeps < 1 or abs(substeps * timestep - period) > 1e-9:
        raise ConfigError(
            f"the period of controller '{name}' is {period:g} s, not a multiple of the physics time step "
            f"{timestep:g} s; give {max(1, substeps) * timestep:g} s, or choose a time step that divides it"
        )
    return substeps


class ControlLoop:
    """A controller, and everything around it, in a simulation.

    Attributes:
        control: what happens in a period.
        simulation: the robot.
        period: the controller's period [s].
        substeps: physics steps in a period.
    """

    def __init__(
        self,
        controller: Controller | str,
        source: CommandSource | Command,
        simulation: Engine,
        upper_body: UpperBodySource | None = None,
        estimator: StateEstimator | None = None,
    ) -> None:
        """Connect the parts; call `reset` before the first `decide`.

        The limits and the servo of the arms know the simulated robot with its drives. What a given controller, hand IK
        and estimator know is up to whoever made them.

        Args:
            controller: any object with the members of `Controller`, or its name; then it is told the robot.
            source: gives commands and hand targets over time; or one command for all times.
            simulation: the robot.
            upper_body: turns hand targets into arm targets; None ignores hand targets.
            estimator: estimates the state from the sensors; None for one that knows the simulated robot, or for none
                where the sensors tell the state.
        """
        if isinstance(controller, str):
            controller = ControllerSpec(controller).of_robot(simulation.robot.name).build(simulation.known_robot)
        source = Constant(source) if isinstance(source, Command) else source
        robot, sensing = simulation.known_robot, simulation.sensing
        sight = Sight(
            SimulatedWorld(simulation),
            robot,
            noisy=bool(sensing.object_position or sensing.object_attitude),
            drifting=not sensing.position,
        )
        estimator = estimator or estimator_for(simulation)
        self.control = ControlPeriod(controller, source, sight, robot=robot, estimator=estimator, upper_body=upper_body)
        self.simulation = simulation
        self.period = self.control.period
        self.substeps = substeps_of(self.period, simulation.timestep, controller.name)

    def reset(self) -> None:
        """Stand the robot up at the origin and start all parts from there."""
        self.simulation.reset()
        self.control.start(self.simulation.sense(), self.simulation.time)

    def look(self, t: float) -> View:
        """Return what a source that looks at robot and objects sees at time t [s], before `decide`."""
        if self.control.estimator is None:  # a push or a viewer may have changed the state since the last step
            self.control.observe(self.simulation.sense(), self.simulation.time)
        return self.control.look(t)

    def decide(self, t: float) -> JointCommand:
        """Return the joint command for the next period, from what the sensors say at time t [s]."""
        if self.control.estimator is None:
            self.control.observe(self.simulation.sense(), self.simulation.time)
        return self.control.decide(t)

    def step(self, command: JointCommand, duration: float) -> None:
        """Apply a joint command for a duration [s]."""
        for _ in range(max(1, round(duration / self.simulation.timestep))):
            self.step_physics(command)

    def step_physics(self, command: JointCommand) -> None:
        """Apply a joint command for one physics step; the estimator sees each."""
        simulation = self.simulation
        simulation.advance(command)
        if self.control.estimator is not None:
            self.control.observe(simulation.sense(), simulation.time)

    def snapshot(self) -> Snapshot:
        """Return what a picture shows now."""
        state, simulation = self.simulation.state(), self.simulation
        assert state.foot_force is not None
        return Snapshot(
            qpos=simulation.qpos,
            gait=int(self.control.chain.command.gait),
            phase=self.control.guard.phase,
            foot_contact=state.foot_force[:, 2] > CONTACT_FORCE,
            foot_force=state.foot_force.copy(),
            pressure_centre=simulation.pressure_centres,
            foothold=self.control.guard.footholds,
            hand_target_world=world_targets(self.control.hands, state),
            arm_target=self._arm_target(),
            hand_force=np.zeros((2, 3)) if state.hand_force is None else state.hand_force.copy(),
            object_pose=simulation.objects.poses,
        )

    def _arm_target(self) -> np.ndarray:
        hands, source = self.control.hands, self.control.upper_body
        if source is not None and hands is not None:
            if hands.joints is not None:
                return hands.joints.copy()
            if source.solution is not None:
                return source.solution.q.copy()
        return np.full(self.simulation.robot.arms.size, np.nan)

    @property
    def reachable(self) -> np.ndarray:
        """Whether the left and the right hand have a target within reach, shape (2,), bool."""
        solution = None if self.control.upper_body is None else self.control.upper_body.solution
        if solution is None or self.control.hands is None:
            return np.zeros(2, dtype=bool)
        return solution.reachable & self.control.hands.given


def world_targets(hands: HandTargets | None, state: RobotState) -> np.ndarray:
    """Return the hand targets in the world frame at this state [m], shape (2, 3); NaN for a hand without one."""
    if hands is None:
        return np.full((2, 3), np.nan)
    if hands.frame == "world":
        return hands.array()
    assert state.position is not None
    return state.position + hands.array() @ frame_axes(hands.frame, state.orientation).T
