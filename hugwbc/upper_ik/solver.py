"""Inverse kinematics of both arms with placo: two hand positions to eight joint targets.

Each call takes one or a few steps of the velocity-level problem

    min over dq:  sum over hands |J dq - e|^2  +  w_posture |q + dq - q_nominal|^2  +  lambda |dq|^2
    subject to    lower + margin <= q + dq <= upper - margin,   |dq| <= v_max dt,

where e is the hand's error, cut to the length that `hand_speed` allows in one step, and lambda = damping + |e|
(Sugihara's error-damped Levenberg-Marquardt). Both together make the steps towards a target out of reach settle
at the nearest pose, where plain Gauss-Newton steps would overshoot and chatter across the stretched arm. Every task is
soft, so that the problem always has a solution.
"""

import dataclasses
import math
import xml.etree.ElementTree as ElementTree

import numpy as np
import placo

from hugwbc import rotations
from hugwbc.errors import ConfigError, TargetError
from hugwbc.robot import SIDES, Robot, load_robot
from hugwbc.state import RobotState
from hugwbc.targets import HandTargets

LONGEST_STEP = 0.005  # [s]; a longer tick is cut into equal steps, so that slow loops converge as fast loops do


@dataclasses.dataclass(frozen=True)
class ArmIKConfig:
    """Settings of the solver.

    Attributes:
        limit_margin: distance kept from the joint position limits [rad].
        speed_fraction: of the joint velocity limits that the solution may use; half leaves the joint's controller
            room to catch up after a disturbance.
        hand_speed: highest speed of a hand towards its target [m/s].
        posture_weight: of the pull towards the nominal posture, against 1 for the hands [m^2/rad^2]; small, because
            it is also the error it leaves in the hands (below 0.5 mm everywhere with the default).
        damping: lambda where the hands are on target [m^2/rad^2].
        tolerance: distance within which a hand counts as on target [m].
    """

    limit_margin: float = 0.02
    speed_fraction: float = 0.5
    hand_speed: float = 1.5
    posture_weight: float = 1e-5
    damping: float = 1e-3
    tolerance: float = 0.005

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not 0.0 < value < np.inf:
                raise ConfigError(f"ArmIKConfig.{field.name} is {value}; give a finite number above 0")
        if self.speed_fraction > 1.0:
            raise ConfigError(f"ArmIKConfig.speed_fraction is {self.speed_fraction}; give a fraction up to 1")


@dataclasses.dataclass(frozen=True, eq=False)
class IKSolution:
    """Arm targets for one tick; joints in the order of `Robot.arms`, hands in the order left, right.

    Attributes:
        q: joint positions [rad], shape (8,).
        dq: their velocities [rad/s], shape (8,).
        residual: distance of each hand at `q` from its target [m], shape (2,); NaN while no target was ever usable.
        reachable: False where the hand is off its target and no longer gets nearer: `q` is the nearest pose the solver
            found. Shape (2,), bool.
        ok: False if the target or the state was unusable and `q` holds its last value.
    """

    q: np.ndarray
    dq: np.ndarray
    residual: np.ndarray
    reachable: np.ndarray
    ok: bool


class ArmIK:
    """Tracks hand targets with an arm configuration of its own, which it integrates from call to call.

    The measured arms are read at `reset` only: feeding them back would make the sag of soft joints drift into the
    targets. All is solved in the pelvis frame, in which the legs do not move the hands and the waist does.

    Attributes:
        rejected: how many calls had unusable numbers (a target or the waist angle that is not finite, a target in the
            world frame without a known pelvis position, a time step that is not positive); each held the last
            configuration.
        failures: how many steps the solver failed in; each held the last configuration.
    """

    def __init__(self, config: ArmIKConfig | None = None) -> None:
        """Build the kinematics from the robot's URDF, at the nominal arm posture."""
        self.config = config or ArmIKConfig()
        self.robot = load_robot()
        self.rejected = 0
        self.failures = 0
        arms = self.robot.arms
        self.lower = self.robot.lower[arms] + self.config.limit_margin
        self.upper = self.robot.upper[arms] - self.config.limit_margin
        self.velocity_limit = self.robot.velocity_limit[arms] * self.config.speed_fraction
        self._placo = _arms_on_a_fixed_pelvis(self.robot)
        self._columns = np.array([self._placo.get_joint_offset(name) for name in self.robot.arm_names])
        self._waist_column = self._placo.get_joint_offset("torso_joint")
        self._hand_frames = [f"{side}_hand" for side in SIDES]
        self._build_solver()
        self._q = np.clip(self.robot.nominal[arms], self.lower, self.upper)
        self._residual = np.full(2, np.nan)
        self._reachable = np.ones(2, dtype=bool)

    def _build_solver(self) -> None:
        config, names = self.config, self.robot.arm_names
        limits = zip(names, self.lower, self.upper, self.velocity_limit, strict=True)
        for name, lower, upper, speed in limits:
            self._placo.set_joint_limits(name, float(lower), float(upper))
            self._placo.set_velocity_limit(name, float(speed))
        self._solver = placo.KinematicsSolver(self._placo)
        self._solver.mask_fbase(True)
        self._solver.mask_dof("torso_joint")
        self._solver.enable_joint_limits(True)
        self._solver.enable_velocity_limits(True)
        self._hand_tasks = [self._solver.add_position_task(frame, np.zeros(3)) for frame in self._hand_frames]
        for frame, task in zip(self._hand_frames, self._hand_tasks, strict=True):
            task.configure(frame, "soft", 1.0)
        posture = self._solver.add_joints_task()
        posture.set_joints(dict(zip(names, self.robot.nominal[self.robot.arms].tolist(), strict=True)))
        posture.configure("posture", "soft", config.posture_weight)
        self._damping_task = self._solver.add_regularization_task(1.0)
        self._damping_task.configure("damping", "soft", 1.0)

    @property
    def q(self) -> np.ndarray:
        """The current arm configuration [rad], shape (8,)."""
        return self._q.copy()

    def reset(self, q: np.ndarray) -> None:
        """Continue from arm positions (8,) [rad], moved into the limits; values that are not finite are ignored."""
        q = np.where(np.isfinite(q), q, self._q)
        self._q = np.clip(q, self.lower, self.upper)
        self._residual = np.full(2, np.nan)
        self._reachable = np.ones(2, dtype=bool)

    def hands(self, q: np.ndarray, waist: float) -> np.ndarray:
        """Positions of both hands in the pelvis frame [m], shape (2, 3), at arm positions (8,) and a waist angle."""
        configuration = self._placo.state.q.copy()
        configuration[self._columns] = q
        # placo finds a problem infeasible if any joint, even a masked one, is the least outside its limits.
        index = self.robot.waist
        configuration[self._waist_column] = np.clip(waist, self.robot.lower[index], self.robot.upper[index])
        self._placo.state.q = configuration
        self._placo.update_kinematics()
        return self._hand_positions()

    def _hand_positions(self) -> np.ndarray:
        return np.array([self._placo.get_T_world_frame(frame)[:3, 3] for frame in self._hand_frames])

    def solve(self, targets: HandTargets, state: RobotState, dt: float) -> IKSolution:
        """Advance the arm configuration by one tick towards the targets. Never raises on bad numbers: holds, counts.

        Args:
            targets: hand positions, in the pelvis or the world frame.
            state: gives the waist angle and, for targets in the world frame, the pelvis pose.
            dt: time since the last call [s].
        """
        goal = targets_in_pelvis(targets, state)
        waist = float(state.q[self.robot.waist])
        if goal is None or not np.isfinite(waist) or not 0.0 < dt < np.inf:
            self.rejected += 1
            return self._hold()
        count = max(1, math.ceil(dt / LONGEST_STEP - 1e-9))
        before = self._q
        hands = self.hands(before, waist)
        try:
            for _ in range(count):
                hands = self._step(hands, goal, dt / count)
        except RuntimeError:  # placo reports an infeasible problem so
            self.failures += 1
            return self._hold()
        return IKSolution(self.q, (self._q - before) / dt, self._residual.copy(), self._reachable.copy(), ok=True)

    def _step(self, hands: np.ndarray, goal: np.ndarray, dt: float) -> np.ndarray:
        """One step from the configuration that is set, whose hands are at `hands`; returns where they are after it."""
        error = goal - hands
        distance = np.linalg.norm(error, axis=1)
        step = np.minimum(distance, self.config.hand_speed * dt)
        aim = hands + error * (step / np.maximum(distance, 1e-9))[:, None]
        for task, point in zip(self._hand_tasks, aim, strict=True):
            task.target_world = point
        self._damping_task.set_weight(self.config.damping + float(step.max()))
        self._solver.dt = dt
        self._solver.solve(True)
        # The solver meets its limits to rounding only.
        self._q = np.clip(self._placo.state.q[self._columns], self.lower, self.upper)
        self._placo.update_kinematics()
        hands = self._hand_positions()
        self._residual = np.linalg.norm(goal - hands, axis=1)
        # Nearer by less than 2 % of the step asked for: the hand has arrived at the nearest point it can reach.
        stalled = distance - self._residual < 0.02 * step
        self._reachable = ~(stalled & (self._residual > self.config.tolerance))
        return hands

    def _hold(self) -> IKSolution:
        return IKSolution(self._q.copy(), np.zeros(8), self._residual.copy(), self._reachable.copy(), ok=False)


def check_targets(targets: HandTargets, state: RobotState) -> None:
    """Tell a user, before a loop starts, that the loop would have to reject these targets.

    Raises:
        TargetError: if a position is not finite, or if the frame is the world's and the state has no position.
    """
    HandTargets.of(targets.left, targets.right, targets.frame)
    if targets.frame == "world" and state.position is None:
        raise TargetError(
            "hand targets in the world frame need the pelvis position, but the state has none; "
            "add an estimator, or give the targets in the pelvis frame"
        )


def targets_in_pelvis(targets: HandTargets, state: RobotState) -> np.ndarray | None:
    """Both target positions in the pelvis frame [m], shape (2, 3), or None if they or the pelvis pose are unusable."""
    if np.shape(targets.left) != (3,) or np.shape(targets.right) != (3,):
        return None
    points = targets.array()
    if targets.frame == "world":
        if state.position is None:
            return None
        points = rotations.rotate_inverse(state.orientation, points - state.position)
    return points if np.all(np.isfinite(points)) else None


def _arms_on_a_fixed_pelvis(robot: Robot) -> placo.RobotWrapper:
    """The upper body: geometry is not needed, and the legs do not move the hands in the pelvis frame."""
    root = ElementTree.parse(robot.urdf_path).getroot()
    for link in root.findall("link"):
        for shape in (*link.findall("visual"), *link.findall("collision")):
            link.remove(shape)
    legs = {robot.joint_names[index] for index in robot.legs}
    for joint in root.findall("joint"):
        if joint.get("name") in legs:
            joint.set("type", "fixed")
    return placo.RobotWrapper("h1", placo.Flags.ignore_collisions, ElementTree.tostring(root, encoding="unicode"))
