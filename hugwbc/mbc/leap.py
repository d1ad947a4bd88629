"""Jumping on two feet and hopping on one: contact forces in stance, footholds and foot trajectories in flight."""

import numpy as np

from hugwbc import rotations
from hugwbc.mbc import feet
from hugwbc.mbc.command_filter import SmoothCommand
from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.gait_plan import GaitPlan, Mode
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.qp import CONTACT_POINTS
from hugwbc.mbc.reach import leap_lean
from hugwbc.mbc.references import References, Tick
from hugwbc.mbc.rigid_body_mpc import ForcePlan, RigidBody, RigidBodyMpc, Stance, TakeOff
from hugwbc.mbc.swing import SwingTrajectory
from hugwbc.mbc.tasks import CentreOfMassMotionTask, SwingFootTask, foot_axes
from hugwbc.robot import SIDES, Robot
from hugwbc.state import GRAVITY

_DAMPING = 1e-3  # [m^2], regularises the inverse of a leg's Jacobian, so that a straight knee does no harm


class Leap:
    """Plans the forces of the feet on the ground and the paths of the feet in the air.

    Attributes:
        motion: task of the centre of mass in stance.
        trajectories: paths of the left and the right foot in flight.
        forces: planned force on every contact point, world axes [N], shape (4, 3); None in flight.
        momentum_rate: planned rate of the angular momentum, world axes [N m], shape (3,); None in flight.
        failures: number of force plans since the reset that were not solved.
    """

    def __init__(self, params: ControllerParams, plan: GaitPlan, references: References, robot: Robot) -> None:
        """Set up for a gait plan and its references, which the caller updates first in every tick."""
        self._params, self._plan, self._references = params, plan, references
        ankle = float(robot.torque_limit[robot.pair("ankle_pitch")[0]])
        self._mpc = {legs: RigidBodyMpc(params, 2 * legs, ankle) for legs in (1, 2)}
        self._ankles = robot.moved["ankle_pitch"]
        self._legs = robot.legs.reshape(len(SIDES), -1)
        self.motion = CentreOfMassMotionTask(params)
        self.trajectories = tuple(SwingTrajectory(params) for _ in SIDES)
        self.reset()

    def reset(self) -> None:
        """Forget all plans and the count of failures."""
        self.failures = 0
        self._swing_momentum = np.zeros(3)
        for mpc in self._mpc.values():
            mpc.reset()
        self.release()

    def release(self) -> None:
        """Drop the force plan: the feet do not push."""
        self.forces: np.ndarray | None = None
        self.momentum_rate: np.ndarray | None = None
        self._force_plan: ForcePlan | None = None
        self._age = np.inf

    # --- stance

    def push(self, tick: Tick) -> None:
        """Plan the forces of the standing feet, again every `mpc_period`, and pass them to the tasks."""
        plan, params = self._plan, self._params
        self._age += tick.dt
        # A foot that lands before its time stays down through the stance to come.
        time_left = plan.remaining + plan.step_time * plan.airborne
        # Feet push for whole periods. Unless the plan knows, the last one adds up to 0.06 m/s to the take-off; hops
        # are tuned with that.
        overtime = -time_left % tick.dt if plan.on_both else 0.0
        young = self._age < params.mpc_period - 0.5 * tick.dt
        # Close to take-off the last plan runs out: a shorter one would correct small errors by large forces.
        if not young and (self._force_plan is None or time_left > params.mpc_shortest_stance):
            self._solve(tick, time_left + overtime, overtime)
        self._use(tick.dynamics)

    def _to_heading(self) -> np.ndarray:
        """Return the rotation from the world into the heading frame, shape (3, 3)."""
        return rotations.rotation_z(-self._references.orientation.yaw)

    def _solve(self, tick: Tick, time_left: float, overtime: float) -> None:
        """Plan the forces until take-off, `time_left` [s] away, and a flight that is shorter by the `overtime` [s]."""
        dynamics, plan, orientation = tick.dynamics, self._plan, self._references.orientation
        self._age = 0.0
        landing = plan.mode is Mode.LANDING
        flight = 0.0 if landing else plan.step_time - overtime
        # The commanded velocity turns with the robot; the flight should have the direction of the middle of the flight.
        turn = tick.command.omega * (time_left + 0.5 * flight)
        horizontal = np.zeros(2) if landing else rotations.rotation_z(turn)[:2, :2] @ tick.velocity
        to_heading = self._to_heading()
        pelvis = dynamics.frame(dynamics.robot.base)
        target = TakeOff(
            float(self._references.height.target + dynamics.com[2] - pelvis.position[2]),
            np.array([*horizontal, 0.5 * GRAVITY * flight]),  # rises and falls for half of the flight each
            np.array([0.0, orientation.pitch_rate, orientation.yaw_rate]),
            flight,
        )
        body = self._body(dynamics, to_heading, -orientation.error(dynamics))
        self._force_plan = self._mpc[len(plan.legs)].solve(body, self._stance(dynamics, to_heading, time_left), target)
        self._swing_momentum = -(to_heading.T @ body.coupling[:, :2] @ target.velocity[:2])
        self.failures += not self._force_plan.solved

    def _body(self, dynamics: Dynamics, to_heading: np.ndarray, tilt: np.ndarray) -> RigidBody:
        """Return the robot as a single body whose leaping legs keep their feet where they are.

        With these feet fixed and all other joints still, the velocity of the pelvis [v, omega] decides all joint
        velocities: the legs' by their (damped) inverse Jacobians. What is left of the centroidal momentum matrix has
        six columns.

        Args:
            dynamics: robot model at the current state.
            to_heading: rotation from the world into the heading frame, shape (3, 3).
            tilt: rotation from the desired to the actual orientation of the pelvis, heading frame [rad], shape (3,).
        """
        base = np.zeros((dynamics.nv, 6))
        rotation = dynamics.frame(dynamics.robot.base).rotation
        base[:3, :3] = base[3:6, 3:] = rotation.T @ to_heading.T
        for foot in self._plan.legs:
            sole, columns = dynamics.frame(feet.SOLES[foot]), dynamics.columns[self._legs[foot]]
            # A row for each joint: a line contact leaves the roll of the foot free.
            axes = foot_axes(dynamics.robot)
            jacobian = np.vstack((sole.jacobian[:3], (sole.rotation.T @ sole.jacobian[3:])[axes]))
            leg = jacobian[:, columns]
            square = leg.T @ leg + _DAMPING * np.eye(columns.size)
            base[columns] = -np.linalg.solve(square, leg.T @ jacobian[:, :6] @ base[:6])
        com = to_heading @ dynamics.com_jacobian @ base
        momentum = to_heading @ dynamics.momentum_jacobian @ base
        # Change variables from the velocity of the pelvis to that of the centre of mass, which the forces act on.
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

    def _stance(self, dynamics: Dynamics, to_heading: np.ndarray, time_left: float) -> Stance:
        """Return where the ground can push until take-off, in the heading frame."""
        legs = self._plan.legs
        points = [dynamics.point(CONTACT_POINTS[2 * foot + end]) for foot in legs for end in (0, 1)]
        ankles = [dynamics.point(self._ankles[foot]) for foot in legs]
        lateral = [dynamics.frame(feet.SOLES[foot]).rotation[:, 1] for foot in legs]
        return Stance(
            np.array(points) @ to_heading.T,
            np.array(ankles) @ to_heading.T,
            np.array(lateral) @ to_heading.T,
            time_left,
        )

    def _use(self, dynamics: Dynamics) -> None:
        """Pass the planned forces of this moment and the resulting accelerations to the tasks."""
        assert self._force_plan is not None
        planned = self._force_plan.at(self._age) @ self._to_heading()
        points = [2 * foot + end for foot in self._plan.legs for end in (0, 1)]
        self.forces = np.zeros((len(CONTACT_POINTS), 3))
        self.forces[points] = planned
        # Newton and Euler: the sum of the forces moves the centre of mass, their moments change the angular momentum.
        arms = np.array([dynamics.point(CONTACT_POINTS[point]) for point in points]) - dynamics.com
        self.momentum_rate = np.cross(arms, planned).sum(axis=0)
        self.motion.feedforward = planned.sum(axis=0) / dynamics.mass - [0.0, 0.0, GRAVITY]

    # --- flight

    def lift_off(self, dynamics: Dynamics) -> None:
        """Start a flight: the leaping feet leave the ground."""
        for foot in self._plan.legs:
            self.trajectories[foot].start(dynamics.frame(feet.SOLES[foot]).position)

    def fly(self, tick: Tick, foot: int, task: SwingFootTask) -> np.ndarray:
        """Move a foot along its path through the flight.

        Args:
            tick: current tick, of a flight.
            foot: 0 for left, 1 for right.
            task: task of that foot.

        Returns:
            Place where the centre of the sole should land, world x and y [m], shape (2,).
        """
        plan, references, trajectory = self._plan, self._references, self.trajectories[foot]
        yaw = self._landing_yaw(tick.command)
        foothold = feet.sole_about(self.foothold(tick, foot), yaw, references.balance, tick.dynamics.robot)
        elapsed = plan.step_time - plan.remaining
        trajectory.advance(foothold, tick.command.l, references.ground, elapsed, plan.remaining, tick.dt)
        back, command, speed = np.zeros(3), tick.command, float(tick.command.velocity[0])
        if plan.on_both:
            lean = leap_lean(self._params, command.h, command.f, command.l, speed, tick.dynamics.robot)
            back[:2] = -lean * references.to_heading[0]
        task.position = trajectory.position + (trajectory.position[2] - references.ground) * back
        task.velocity = trajectory.velocity + trajectory.velocity[2] * back
        task.acceleration = trajectory.acceleration + trajectory.acceleration[2] * back
        task.yaw, task.pitch = yaw, feet.swing_pitch(tick.dynamics, foot, references.to_heading)
        return foothold

    def lands(self, dynamics: Dynamics, foot: int) -> bool:
        """Return whether a foot touches the ground late enough in the flight for that to be its landing."""
        plan, params = self._plan, self._params
        if plan.step_time - plan.remaining <= params.early_contact_phase * plan.step_time:
            return False
        height = min(feet.end_heights(dynamics, foot)) - self._references.ground
        return height < params.early_contact_height

    def foothold(self, tick: Tick, foot: int) -> np.ndarray:
        r"""Return where a foot's centre of pressure should be after the flight, in the world [m], shape (2,).

        For a jump, the centre of mass should pass over the middle of the feet in the middle of the stance,
        :math:`p = c + \dot c\, t + \dot c\, T / 2 + k (\dot c - \dot c_d)`, with t the time to the landing and T the
        duration of the stance. The last term slows down a robot that is too fast (the foot placement of Raibert, Legged
        Robots That Balance, 1986).
        """
        params, plan, yaw = self._params, self._plan, self._references.yaw
        dynamics, command = tick.dynamics, tick.command
        half = 0.5 * plan.step_time
        moving = dynamics.com_velocity[:2]
        wanted = rotations.rotation_z(yaw + command.omega * plan.remaining)[:2, :2] @ tick.velocity
        if len(plan.legs) == 1:
            inwards = rotations.rotation_z(yaw)[:2, 1] * (-1.0 if foot == 0 else 1.0)
            return self._single_foothold(dynamics, wanted) + feet.hop_edge(dynamics.robot) * inwards
        middle = dynamics.com[:2] + moving * (plan.remaining + half) + params.leap_placement * (moving - wanted)
        sideways = rotations.rotation_z(self._landing_yaw(command))[:2, 1]
        return middle + sideways * (0.5 - foot) * params.leap_width

    def _single_foothold(self, dynamics: Dynamics, wanted: np.ndarray) -> np.ndarray:
        r"""Return where the contact line of a single foot should be after the flight, in the world [m], shape (2,).

        Only gravity changes the angular momentum about the foot. Let the body fall at g T / 2 at the landing, rise at
        g T / 2 at take-off, and accelerate constantly in between. The angular momentum is then the wanted one at the
        end of the stance if the centre of mass passes the foot in the middle of the stance, after it has travelled
        :math:`T (3 \dot c + \dot c^*) / 8`, at a distance of

        .. math:: d = \frac{1}{2 m g T} (\hat z \times (k - k^*) - m (z - g T^2 / 6) (\dot c - \dot c^*))

        with z its height at both ends. Friction in stance only decides how much of the momentum is in the velocity and
        how much in the turning.

        Args:
            dynamics: robot model at the current state.
            wanted: velocity wanted at take-off, world x and y [m/s], shape (2,).
        """
        plan = self._plan
        moving, stance = dynamics.com_velocity[:2], plan.step_time
        height = dynamics.com[2] + dynamics.com_velocity[2] * plan.remaining - 0.5 * GRAVITY * plan.remaining**2
        lever = height - self._references.ground - GRAVITY * stance**2 / 6.0
        # The legs will swing in the next flight: their momentum must be there at take-off, so it does not count.
        excess = (dynamics.momentum - self._swing_momentum)[:2]
        turning = np.array([-excess[1], excess[0]]) / dynamics.mass
        distance = (turning - lever * (moving - wanted)) / (2.0 * GRAVITY * stance)
        middle = dynamics.com[:2] + moving * plan.remaining + stance * (3.0 * moving + wanted) / 8.0
        return middle - distance

    def _landing_yaw(self, command: SmoothCommand) -> float:
        """Return the heading of the feet at the landing: that of the pelvis in the middle of the next stance [rad]."""
        return self._references.yaw + command.omega * (self._plan.remaining + 0.5 * self._plan.step_time)
