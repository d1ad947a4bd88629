"""Jumping on two feet and hopping on one: contact forces in stance, footholds and foot trajectories in flight."""

import numpy as np

from hugwbc import rotations
from hugwbc.mbc.command_filter import SmoothCommand
from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.gait_plan import GaitPlan, Mode
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.qp import CONTACT_POINTS
from hugwbc.mbc.rigid_body_mpc import ForcePlan, RigidBody, RigidBodyMpc, Stance, TakeOff
from hugwbc.mbc.swing import SwingTrajectory
from hugwbc.mbc.tasks import CentreOfMassMotionTask, PelvisOrientationTask
from hugwbc.robot import SIDES, load_robot
from hugwbc.state import GRAVITY

_DAMPING = 1e-3  # [m^2], of the inverse of a leg's Jacobian, so that a straight knee stays harmless


class Leap:
    """Plans the forces of the feet on the ground and the paths of those in the air.

    Attributes:
        motion: task of the centre of mass in stance.
        trajectories: of the left and right foot in flight.
        forces: planned, on every contact point [N], shape (4, 3); None in flight.
        momentum_rate: planned, of the angular momentum, world axes [N m], shape (3,); None in flight.
        failures: force plans that were not solved since the reset.
    """

    def __init__(self, params: ControllerParams) -> None:
        self._params = params
        robot = load_robot()
        ankle = float(robot.torque_limit[robot.index("left_ankle_joint")])
        self._mpc = {legs: RigidBodyMpc(params, 2 * legs, ankle) for legs in (1, 2)}
        self._legs = robot.legs.reshape(len(SIDES), -1)
        self.motion = CentreOfMassMotionTask(params)
        self.trajectories = tuple(SwingTrajectory(params) for _ in SIDES)
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self.forces: np.ndarray | None = None
        self.momentum_rate: np.ndarray | None = None
        self.failures = 0
        self._swing_momentum = np.zeros(3)
        self._plan: ForcePlan | None = None
        self._age = np.inf
        for mpc in self._mpc.values():
            mpc.reset()

    def fly(self) -> None:
        """The feet leave the ground: no forces."""
        self._plan = None
        self.forces = None
        self.momentum_rate = None
        self._age = np.inf

    def push(
        self,
        dynamics: Dynamics,
        command: SmoothCommand,
        plan: GaitPlan,
        orientation: PelvisOrientationTask,
        velocity: np.ndarray,
        height: float,
        dt: float,
    ) -> None:
        """Forces of the feet that stand; planned anew every `mpc_period`.

        Args:
            dynamics: updated.
            command: to follow.
            plan: in a leap or a landing.
            orientation: with this tick's targets; its yaw is the heading.
            velocity: planned velocity, heading frame [m/s], shape (2,).
            height: of the pelvis at take-off, in the world [m].
            dt: [s].
        """
        self._age += dt
        # A foot that lands before its time carries on through the stance to come.
        time_left = plan.remaining + plan.step_time * plan.airborne
        to_heading = rotations.rotation_z(-orientation.yaw)
        young = self._age < self._params.mpc_period - 0.5 * dt
        if not young and (self._plan is None or time_left > self._params.mpc_shortest_stance):
            self._solve(dynamics, command, plan, orientation, velocity, height, time_left)
        self._use(dynamics, plan, to_heading.T)

    def _solve(
        self,
        dynamics: Dynamics,
        command: SmoothCommand,
        plan: GaitPlan,
        orientation: PelvisOrientationTask,
        velocity: np.ndarray,
        height: float,
        time_left: float,
    ) -> None:
        self._age = 0.0
        landing = plan.mode is Mode.LANDING
        flight = 0.0 if landing else plan.step_time
        turn = command.omega * (time_left + 0.5 * flight)
        horizontal = np.zeros(2) if landing else rotations.rotation_z(turn)[:2, :2] @ velocity
        to_heading = rotations.rotation_z(-orientation.yaw)
        pelvis = dynamics.frame("pelvis")
        target = TakeOff(
            float(height + dynamics.com[2] - pelvis.position[2]),
            np.array([*horizontal, 0.5 * GRAVITY * flight]),
            np.array([0.0, orientation.pitch_rate, orientation.yaw_rate]),
            flight,
        )
        body = self._body(dynamics, plan, to_heading, -orientation.evaluate(dynamics).error)
        self._plan = self._mpc[len(plan.legs)].solve(body, self._stance(dynamics, plan, to_heading, time_left), target)
        self._swing_momentum = -(to_heading.T @ body.coupling[:, :2] @ target.velocity[:2])
        self.failures += not self._plan.solved
        self.motion.velocity = to_heading.T @ target.velocity

    def _body(self, dynamics: Dynamics, plan: GaitPlan, to_heading: np.ndarray, tilt: np.ndarray) -> RigidBody:
        """The robot as a body whose leaping legs keep their feet where they are.

        Of the motions of the whole robot that leaves those of the pelvis, [v, omega], which all velocities follow from.
        """
        base = np.zeros((dynamics.nv, 6))
        rotation = dynamics.frame("pelvis").rotation
        base[:3, :3] = base[3:6, 3:] = rotation.T @ to_heading.T
        for foot in plan.legs:
            sole, columns = dynamics.frame(f"{SIDES[foot]}_sole"), dynamics.columns[self._legs[foot]]
            jacobian = np.vstack((sole.jacobian[:3], (sole.rotation.T @ sole.jacobian[3:])[1:]))
            leg = jacobian[:, columns]
            square = leg.T @ leg + _DAMPING * np.eye(columns.size)
            base[columns] = -np.linalg.solve(square, leg.T @ jacobian[:, :6] @ base[:6])
        com = to_heading @ dynamics.com_jacobian @ base
        momentum = to_heading @ dynamics.momentum_jacobian @ base
        # Exchange the pelvis's velocity for that of the centre of mass.
        coupling = np.linalg.solve(com[:, :3].T, momentum[:, :3].T).T
        return RigidBody(
            dynamics.mass,
            momentum[:, 3:] - coupling @ com[:, 3:],
            coupling,
            to_heading @ dynamics.inertia @ to_heading.T,
            to_heading @ dynamics.com,
            to_heading @ dynamics.com_velocity,
            tilt,
            to_heading @ dynamics.momentum,
        )

    def _stance(self, dynamics: Dynamics, plan: GaitPlan, to_heading: np.ndarray, time_left: float) -> Stance:
        points = [dynamics.point(CONTACT_POINTS[2 * foot + end]) for foot in plan.legs for end in (0, 1)]
        ankles = [dynamics.point(f"{SIDES[foot]}_ankle_link") for foot in plan.legs]
        lateral = [dynamics.frame(f"{SIDES[foot]}_sole").rotation[:, 1] for foot in plan.legs]
        return Stance(
            np.array(points) @ to_heading.T,
            np.array(ankles) @ to_heading.T,
            np.array(lateral) @ to_heading.T,
            time_left,
        )

    def _use(self, dynamics: Dynamics, plan: GaitPlan, from_heading: np.ndarray) -> None:
        """Give the plan's forces of this moment to the tasks, with what they do to the body."""
        assert self._plan is not None
        planned = self._plan.at(self._age) @ from_heading.T
        points = [2 * foot + end for foot in plan.legs for end in (0, 1)]
        self.forces = np.zeros((len(CONTACT_POINTS), 3))
        self.forces[points] = planned
        arms = np.array([dynamics.point(CONTACT_POINTS[point]) for point in points]) - dynamics.com
        self.momentum_rate = np.cross(arms, planned).sum(axis=0)
        self.motion.feedforward = planned.sum(axis=0) / dynamics.mass - [0.0, 0.0, GRAVITY]

    def foothold(
        self,
        dynamics: Dynamics,
        command: SmoothCommand,
        plan: GaitPlan,
        yaw: float,
        velocity: np.ndarray,
        foot: int,
        ground: float,
    ) -> np.ndarray:
        r"""Where a foot's centre of pressure should be after the flight, in the world [m], shape (2,).

        The centre of mass then passes over the middle of the feet in the middle of the stance,
        :math:`p = c + \dot c\, t + \dot c\, T / 2 + k (\dot c - \dot c_d)`, with t the time to the landing and T the
        stance; the last term slows down what is too fast.

        Args:
            dynamics: updated.
            command: to follow.
            plan: in flight.
            yaw: heading now [rad].
            velocity: planned velocity, heading frame [m/s], shape (2,).
            foot: 0 left or 1 right.
            ground: height of the ground [m].
        """
        params = self._params
        half = 0.5 * plan.step_time
        moving = dynamics.com_velocity[:2]
        wanted = rotations.rotation_z(yaw + command.omega * plan.remaining)[:2, :2] @ velocity
        if len(plan.legs) == 1:
            # The leg leans inwards: the foot stands on its outer edge.
            inwards = rotations.rotation_z(yaw)[:2, 1] * (-1.0 if foot == 0 else 1.0)
            return self._single_foothold(dynamics, plan, wanted, ground) + dynamics.robot.sole_y[1] * inwards
        middle = dynamics.com[:2] + moving * (plan.remaining + half) + params.leap_placement * (moving - wanted)
        sideways = rotations.rotation_z(self.landing_yaw(command, plan, yaw))[:2, 1]
        return middle + sideways * (0.5 - foot) * params.leap_width

    def _single_foothold(self, dynamics: Dynamics, plan: GaitPlan, wanted: np.ndarray, ground: float) -> np.ndarray:
        r"""Where a single foot should be after the flight, in the world [m], shape (2,).

        The angular momentum about the foot changes by gravity alone. Between falling and rising at g T / 2, under
        constant acceleration, it becomes what is wanted at the end of the stance when the centre of mass passes the
        foot, in the middle of the stance and after :math:`T (3 \dot c + \dot c^*) / 8`, at a distance of

        .. math:: d = \frac{1}{2 m g T} (\hat z \times (k - k^*) - m (z - g T^2 / 6) (\dot c - \dot c^*))

        with z the height at both ends. The friction in stance only decides how much of it is left in the velocity and
        how much in the turning.
        """
        params = self._params
        moving, stance = dynamics.com_velocity[:2], plan.step_time
        height = dynamics.com[2] + dynamics.com_velocity[2] * plan.remaining - 0.5 * GRAVITY * plan.remaining**2
        lever = height - ground - GRAVITY * stance**2 / 6.0
        excess = (dynamics.momentum - self._swing_momentum)[:2]
        turning = np.array([-excess[1], excess[0]]) / dynamics.mass
        distance = (turning - lever * (moving - wanted)) / (2.0 * GRAVITY * stance)
        middle = dynamics.com[:2] + moving * plan.remaining + stance * (3.0 * moving + wanted) / 8.0
        return middle - params.hop_placement * distance

    @staticmethod
    def landing_yaw(command: SmoothCommand, plan: GaitPlan, yaw: float) -> float:
        """Heading of the feet at the landing: the pelvis's in the middle of the stance [rad]."""
        return yaw + command.omega * (plan.remaining + 0.5 * plan.step_time)
