"""One step of velocity-level inverse kinematics of both arms, with placo."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import placo

from hugwbc.robot import SIDES, Robot, load_robot
from hugwbc.upper_ik.config import ArmIKConfig

# Nearer by less than this part of the step asked for: the hand has arrived at the nearest point it can reach.
STALL = 0.02


class Descent:
    """The arms on their way down the distance to the hand targets; all in the pelvis frame, where legs move no hand.

    A step solves

        min over dq:  sum over hands |J dq - e|^2  +  w_posture |q + dq - q_nominal|^2  +  lambda |dq|^2
        subject to    lower + margin <= q + dq <= upper - margin,   |dq| <= v_max dt,

    where e is the hand's error, cut to the length that `hand_speed` allows in one step, and lambda = damping + |e|
    (Sugihara's error-damped Levenberg-Marquardt). Both together make the steps towards a target out of reach settle
    at the nearest pose, where plain Gauss-Newton steps would overshoot and chatter across the stretched arm. Every
    task is soft, so that the problem always has a solution.

    Attributes:
        q: arm joint positions [rad], shape (8,).
        hands: where they put the hands [m], shape (2, 3).
        residual: distances from the targets after the last step [m], shape (2,).
        stalled: whether a hand was off its target and the last step brought it no nearer, shape (2,), bool.
        lower, upper: joint position limits less the margin [rad], shape (8,).
        velocity_limit: highest joint speeds [rad/s], shape (8,).
    """

    def __init__(self, config: ArmIKConfig) -> None:
        self.config = config
        self._robot = load_robot()
        arms = self._robot.arms
        self.lower = self._robot.lower[arms] + config.limit_margin
        self.upper = self._robot.upper[arms] - config.limit_margin
        self.velocity_limit = self._robot.velocity_limit[arms] * config.speed_fraction
        self._placo = _arms_on_a_fixed_pelvis(self._robot)
        self._columns = np.array([self._placo.get_joint_offset(name) for name in self._robot.arm_names])
        self._waist_column = self._placo.get_joint_offset("torso_joint")
        self._frames = [f"{side}_hand" for side in SIDES]
        self._build_solver()
        self.residual = np.full(2, np.nan)
        self.stalled = np.zeros(2, dtype=bool)
        self.place(self._robot.nominal[arms], 0.0)

    def _build_solver(self) -> None:
        names = self._robot.arm_names
        limits = zip(names, self.lower, self.upper, self.velocity_limit, strict=True)
        for name, lower, upper, speed in limits:
            self._placo.set_joint_limits(name, float(lower), float(upper))
            self._placo.set_velocity_limit(name, float(speed))
        self._solver = placo.KinematicsSolver(self._placo)
        self._solver.mask_fbase(True)
        self._solver.mask_dof("torso_joint")
        self._solver.enable_joint_limits(True)
        self._solver.enable_velocity_limits(True)
        self._hand_tasks = [self._solver.add_position_task(frame, np.zeros(3)) for frame in self._frames]
        for frame, task in zip(self._frames, self._hand_tasks, strict=True):
            task.configure(frame, "soft", 1.0)
        posture = self._solver.add_joints_task()
        nominal = self._robot.nominal[self._robot.arms].tolist()
        posture.set_joints(dict(zip(names, nominal, strict=True)))
        posture.configure("posture", "soft", self.config.posture_weight)
        self._damping_task = self._solver.add_regularization_task(1.0)
        self._damping_task.configure("damping", "soft", 1.0)

    def place(self, q: np.ndarray, waist: float) -> None:
        """Go to arm positions (8,) and a waist angle [rad]."""
        self.q = np.clip(q, self.lower, self.upper)
        self._put(self.q, waist)

    def forward(self, q: np.ndarray, waist: float) -> np.ndarray:
        """Positions of both hands [m], shape (2, 3), at arm positions (8,) and a waist angle; forgets its own."""
        self._put(q, waist)
        return self.hands

    def _put(self, q: np.ndarray, waist: float) -> None:
        configuration = self._placo.state.q.copy()
        configuration[self._columns] = q
        # placo finds a problem infeasible if any joint, even a masked one, is the least outside its limits.
        index = self._robot.waist
        configuration[self._waist_column] = np.clip(waist, self._robot.lower[index], self._robot.upper[index])
        self._placo.state.q = configuration
        self._locate_hands()

    def _locate_hands(self) -> None:
        self._placo.update_kinematics()
        self.hands = np.array([self._placo.get_T_world_frame(frame)[:3, 3] for frame in self._frames])

    def step(self, goal: np.ndarray, dt: float) -> None:
        """Go one step of `dt` [s] towards the targets (2, 3) [m].

        Raises:
            RuntimeError: if placo cannot solve it.
        """
        error = goal - self.hands
        distance = np.linalg.norm(error, axis=1)
        step = np.minimum(distance, self.config.hand_speed * dt)
        aim = self.hands + error * (step / np.maximum(distance, 1e-9))[:, None]
        for task, point in zip(self._hand_tasks, aim, strict=True):
            task.target_world = point
        self._damping_task.set_weight(self.config.damping + float(step.max()))
        self._solver.dt = dt
        self._solver.solve(True)
        # The solver meets its limits to rounding only.
        self.q = np.clip(self._placo.state.q[self._columns], self.lower, self.upper)
        self._locate_hands()
        self.residual = np.linalg.norm(goal - self.hands, axis=1)
        self.stalled = (distance - self.residual < STALL * step) & (self.residual > self.config.tolerance)


def _arms_on_a_fixed_pelvis(robot: Robot) -> placo.RobotWrapper:
    """The upper body, without geometry and with the legs stiff."""
    root = ElementTree.parse(robot.urdf_path).getroot()
    for link in root.findall("link"):
        for shape in (*link.findall("visual"), *link.findall("collision")):
            link.remove(shape)
    legs = {robot.joint_names[index] for index in robot.legs}
    for joint in root.findall("joint"):
        if joint.get("name") in legs:
            joint.set("type", "fixed")
    return placo.RobotWrapper("h1", placo.Flags.ignore_collisions, ElementTree.tostring(root, encoding="unicode"))
