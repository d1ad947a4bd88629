"""One step of velocity-level inverse kinematics of both arms, with placo."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import pinocchio as pin
import placo

from hugwbc import rotations
from hugwbc.robot import Robot
from hugwbc.upper_ik.arm_solver import FRAMES, ArmIKConfig, ArmSolver
from hugwbc.upper_ik.self_collision import Clearance, still_names

# A hand that gets nearer by less than this share of its step has arrived at the nearest point it can reach.
STALL = 0.02
TOUCHING = 0.03  # share of the grip's weight where the arms are at the margin from each other; full at twice of it
NOWHERE = np.full((2, 3), np.nan)


def lengths(vectors: np.ndarray) -> np.ndarray:
    """Return the lengths of row vectors (n, 3), shape (n,)."""
    return np.sqrt(np.add.reduce(vectors * vectors, 1))


def _to_level(axis: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return the shortest turn of one unit vector to another, as its axis times its angle [rad]; shapes (3,)."""
    about = rotations.cross(axis, up)
    sine = math.sqrt(about @ about)
    return about * (math.atan2(sine, axis @ up) / max(sine, 1e-9))


@dataclasses.dataclass(frozen=True, eq=False)
class Goal:
    """The goal of both hands in the pelvis frame."""

    points: np.ndarray  # target positions [m], shape (2, 3)
    # unit vectors from the elbows to the hands, shape (2, 3); NaN where they do not matter
    directions: np.ndarray = dataclasses.field(default_factory=lambda: NOWHERE)
    together: bool = False  # whether the hands hold one object; their relative position then has priority
    # axes of the left and the right hand, shape (3, 3); None where they do not matter
    turns: Sequence[np.ndarray | None] = (None, None)
    # whether the hands only have to be level; the third of these axes is then up; shape (2,), bool
    level: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(2, dtype=bool))
    weight: float | None = None  # of the orientations [m^2/rad^2]; None for that of the settings
    speed: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(2))  # speed of each target [m/s], shape (2,)
    # speed at which the body carries each hand away from it [m/s], shape (2,)
    carried: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(2))


class Descent:
    """Descent of both arms towards the hand targets, in the pelvis frame, in which the legs do not move the hands.

    A step solves, for the joint step dq,

        min over dq:  sum over hands |J dq - e|^2  +  w_pointing |J_elbow dq - e_elbow|^2
                      +  w_turn |J_turn dq - e_turn|^2  +  w_posture |q + dq - q_nominal|^2  +  lambda |dq|^2
        subject to    lower + margin <= q + dq <= upper - margin,   |dq| <= v_max dt,
        softly to     the distance of every pair of links that could touch stays above a margin,
                      and, for hands that hold one object, J_right dq - J_left dq = their relative error,

    where e is the hand's error, cut to the length of one step, and lambda = damping + |e| (after Sugihara's
    error-damped Levenberg-Marquardt method, IEEE T-RO 2011, in which lambda grows with the squared error). The cut
    and the damping let steps towards a target out of reach settle at the nearest pose, where plain Gauss-Newton steps
    overshoot and chatter across the stretched arm. A hand's speed is limited so that it can stop at its target with a
    given deceleration. Every task is soft, so that the problem always has a solution. If the solver fails nevertheless,
    the step is repeated without collision avoidance.

    Attributes:
        q: arm joint positions [rad], shape (k,).
        hands: hand positions at `q` [m], shape (2, 3).
        residual: distances to the targets after the last step [m], shape (2,).
        stalled: whether a hand is off its target and the last step brought it hardly nearer, shape (2,), bool.
        lower, upper: joint position limits minus the margin [rad], shape (k,).
        velocity_limit: highest joint speeds [rad/s], shape (k,).
        placo: placo's robot, at the posture `q`.
        clearance: measures the distances of the arms at that posture.
        without_collisions: number of steps that had to be solved without collision avoidance.
    """

    def __init__(self, config: ArmIKConfig, robot: Robot) -> None:
        self.config = config
        self._robot = robot
        body = (robot.joint_names[robot.waist], *still_names(robot))
        self._arms = arms = ArmSolver(self._robot, config, still=body)
        self.lower, self.upper, self.velocity_limit = arms.lower, arms.upper, arms.velocity_limit
        self.placo, self._columns, self._solver = arms.placo, arms.columns, arms.solver
        self.clearance = Clearance(self.placo, self._robot)
        self._body = self._robot.indices(body)
        self._body_low, self._body_high = self._robot.lower[self._body], self._robot.upper[self._body]
        self._body_columns = np.array([self.placo.get_joint_offset(name) for name in body])
        self._elbows = robot.moved["elbow"]
        # A point on the axis replaces placo's own axis task, which gives NaN once the axis points as asked.
        self._elbow_tasks = [self._solver.add_position_task(frame, np.zeros(3)) for frame in self._elbows]
        for elbow, pointing in zip(self._elbows, self._elbow_tasks, strict=True):
            pointing.configure(elbow, "soft", 0.0)
        self._pointing = np.zeros(2, dtype=bool)
        self._turn_tasks: list[placo.OrientationTask | None] = [None, None]  # of hands with an orientation
        self._grip: placo.JointSpaceHalfSpacesConstraint | None = None
        self.residual = np.full(2, np.nan)
        self.stalled = np.zeros(2, dtype=bool)
        self.without_collisions = 0
        self.place(self._robot.nominal[self._robot.arms], self._robot.nominal)

    def place(self, q: np.ndarray, body: np.ndarray) -> None:
        """Move to arm positions (k,) [rad], with waist, hips and held joints from joint positions (n,) [rad]."""
        self.q = np.minimum(np.maximum(q, self.lower), self.upper)
        self.forward(self.q, body)
        # Near an obstacle, a hand moves only as fast as its arm can still stop.
        self._safe_speed = [self.stoppable(clearance) for clearance in self.clearance()]

    def stoppable(self, clearance: float) -> float:
        """Return the speed of a hand from which it can stop within its arm's clearance [m/s]."""
        room = max(clearance - self.config.collision_margin, 0.0)
        stopping = math.sqrt(2.0 * self.config.collision_deceleration * room)
        return min(max(stopping, self.config.touch_speed), self.config.hand_speed)

    def forward(self, q: np.ndarray, body: np.ndarray) -> np.ndarray:
        """Return both hands' positions [m], shape (2, 3), at arms (k,) and body (n,); overwrites the posture."""
        configuration = self.placo.state.q.copy()
        configuration[self._columns] = q
        # placo calls a problem infeasible if any joint, even a masked one, is slightly outside its limits.
        configuration[self._body_columns] = np.minimum(np.maximum(body[self._body], self._body_low), self._body_high)
        self.placo.state.q = configuration
        self._locate_hands()
        return self.hands

    def _locate_hands(self) -> None:
        self.placo.update_kinematics()
        self.hands = self._arms.hand_points()

    def jacobians(self) -> np.ndarray:
        """Return the Jacobians of both hands at the present posture by their arms' joints, shape (2, 3, k / 2)."""
        columns = (self._columns - 1).reshape(2, -1)
        return np.array(
            [
                self.placo.frame_jacobian(frame, "local_world_aligned")[:3, arm]
                for frame, arm in zip(FRAMES, columns, strict=True)
            ]
        )

    def descend(self, goal: Goal, dt: float, count: int) -> None:
        """Take `count` steps of `dt` [s] towards the goal.

        Raises:
            RuntimeError: if placo cannot solve a step.
        """
        self._solver.dt = dt
        error = goal.points - self.hands
        self.residual = distance = lengths(error)
        steps = [0.0, 0.0]
        for _ in range(count):
            distance = self.residual
            steps = self._step(goal, error, dt)
            error = goal.points - self.hands
            self.residual = lengths(error)
        nearer = STALL * np.array(steps)
        self.stalled = (distance - self.residual < nearer) & (self.residual > self.config.tolerance)

    def _step(self, goal: Goal, error: np.ndarray, dt: float) -> list[float]:
        """Take one step from the hands' errors (2, 3) and return the requested travel of each hand [m]."""
        steps, parts = [], []
        rows = zip(self.residual.tolist(), self._safe_speed, goal.speed.tolist(), goal.carried.tolist(), strict=True)
        for distance, safe, speed, carried in rows:
            fastest = min(math.sqrt(2.0 * self.config.hand_deceleration * distance), self.config.hand_speed) + speed
            # Next to an obstacle, the target's own speed does not count; the speed of what carries the arm still does.
            fastest = carried + (fastest if safe == self.config.hand_speed else min(fastest, safe))
            steps.append(min(distance, fastest * dt))
            parts.append([steps[-1] / max(distance, 1e-9)])
        if goal.together:  # a hand next to an obstacle slows the other one down
            parts = [min(parts)] * 2
        aim = self.hands + error * np.array(parts)
        for task, point in zip(self._arms.hands, aim, strict=True):
            task.target_world = point
        self._point(goal, dt)
        self._turn(goal, dt)
        self._hold_together(aim if goal.together else None)
        self._arms.damping.set_weight(self.config.damping + max(steps))
        self._solve()
        # The solver meets its limits only up to rounding.
        self.q = np.minimum(np.maximum(self.placo.state.q[self._columns], self.lower), self.upper)
        self._locate_hands()
        return steps

    def _solve(self) -> None:
        try:
            self._solver.solve(True)
        except RuntimeError:
            self.without_collisions += 1
            self._arms.solve_without_collisions()

    def _point(self, goal: Goal, dt: float) -> None:
        """Set each elbow's target: the hand at its target, the forearm in the desired direction."""
        for hand, direction in enumerate(goal.directions):
            wanted = bool(direction[0] == direction[0])  # false for NaN
            if wanted:
                error = goal.points[hand] - self._robot.forearm * direction - self.elbow(hand)
                longest = self.config.hand_speed * dt
                error *= min(1.0, longest / max(float(np.linalg.norm(error)), 1e-9))
                self._elbow_tasks[hand].target_world = self.elbow(hand) + error
            if wanted != self._pointing[hand]:
                weight = self.config.pointing_weight if wanted else 0.0
                self._elbow_tasks[hand].configure(self._elbows[hand], "soft", weight)
                self._pointing[hand] = wanted

    def _turn(self, goal: Goal, dt: float) -> None:
        """Set each hand's orientation: as far on the way to the goal's as it can turn in a step."""
        config, weight = self.config, self.config.orientation_weight if goal.weight is None else goal.weight
        for hand, axes in enumerate(goal.turns):
            task = self._turn_tasks[hand]
            if axes is None:
                if task is not None:
                    self._solver.remove_task(task)  # type: ignore[arg-type]
                    self._turn_tasks[hand] = None
                continue
            if task is None:
                task = self._turn_tasks[hand] = self._solver.add_orientation_task(FRAMES[hand], np.eye(3))
            now = self.placo.get_T_world_frame(FRAMES[hand])[:3, :3]
            error = _to_level(now[:, 2], axes[:, 2]) if goal.level[hand] else pin.log3(axes @ now.T)
            angle = math.sqrt(error @ error)
            fastest = min(config.turn_speed, math.sqrt(2.0 * config.turn_deceleration * angle))
            task.R_world_frame = pin.exp3(min(1.0, fastest * dt / max(angle, 1e-9)) * error) @ now
            task.mask.set_axises("xy" if goal.level[hand] else "xyz", "custom")
            task.mask.R_custom_world = axes.T
            task.configure(f"{FRAMES[hand]}_turn", "soft", weight)

    def elbow(self, hand: int) -> np.ndarray:
        """Return the position of an elbow [m], shape (3,)."""
        return self.placo.get_T_world_frame(self._elbows[hand])[:3, 3]

    def _hold_together(self, aim: np.ndarray | None) -> None:
        """Tie the hands to their relative position at the aims (2, 3) [m], or untie them."""
        if aim is None:
            if self._grip is not None:
                self._solver.remove_constraint(self._grip)  # type: ignore[arg-type]
                self._grip = None
            return
        configuration = self.placo.state.q
        left, right = (self.placo.frame_jacobian(frame, "local_world_aligned")[:3] for frame in FRAMES)
        # placo's half-spaces are in the configuration, which is one number longer than the velocity (the quaternion).
        rows = np.zeros((3, configuration.size))
        rows[:, self._columns] = (right - left)[:, self._columns - 1]
        wanted = (aim[1] - aim[0]) - (self.hands[1] - self.hands[0]) + rows @ configuration
        matrix, bound = np.concatenate((rows, -rows)), np.concatenate((wanted, -wanted))
        if self._grip is None:
            self._grip = self._solver.add_joint_space_half_spaces_constraint(matrix, bound)
        # Hands that cannot be as near to each other as they should would swing along each other for ever.
        share = min(max(self.clearance.between / self.config.collision_margin - 1.0, TOUCHING), 1.0)
        self._grip.configure("grip", "soft", share * self.config.grip_weight)
        self._grip.A, self._grip.b = matrix, bound
