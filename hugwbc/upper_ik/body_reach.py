"""Whole-body reach: h, p and w that bring the hands to targets outside the arms' workspace."""

import dataclasses

import numpy as np

from hugwbc import rotations
from hugwbc.commands import Command, command_ranges
from hugwbc.robot import Robot
from hugwbc.state import RobotState
from hugwbc.targets import HandTargets
from hugwbc.upper_ik.arm_solver import ArmIKConfig, ArmSolver
from hugwbc.upper_ik.self_collision import HEIGHT_JOINT, PITCH_JOINT, still_names
from hugwbc.upper_ik.solver import LONGEST_TICK

BODY_NAMES = ("h", "p", "w")

SPEED = (0.15, 0.3, 0.6)  # [m/s, rad/s, rad/s] of h, p and w; both controllers follow it without losing balance
# Which of h, p and w bring a hand nearer to a target in a frame; the others would only carry the target along.
_HELPING = {
    "world": np.array([True, True, True]),
    **dict.fromkeys(("heading", "steady"), np.array([False, True, True])),
    "pelvis": np.array([False, False, True]),
}
# [m^2/rad^2], pull of h, p and w towards the command, relative to 1 for the hands. It is well above the weight of the
# arms' posture, so that the arms move first.
BODY_WEIGHT = 1e-3


class BodyReach:
    """A virtual robot on a column: pelvis height, pelvis pitch, waist and both arms move.

    In every tick it takes one step of the arms' inverse kinematics (see `Descent`) with h, p and w as three more
    joints, within the ranges of the gait. Their pull towards the commanded values is much stronger than the arms' pull
    towards their posture, so that they move noticeably only where the arms are not enough. The real arms are not
    affected: their own inverse kinematics continues from where the pelvis really is.

    Only w helps with a target in the pelvis frame, p and w with one in the heading frame, and all three with one in the
    world frame. A state does not tell the height of the ground, which is taken to be at z = 0 of the world: on a step
    of 0.1 m the body stays up to 0.1 m too high for a target in the world frame.

    Attributes:
        values: current h, p and w [m, rad, rad], shape (3,).
    """

    def __init__(self, robot: Robot) -> None:
        """Build the virtual robot."""
        self._robot, self._config = robot, ArmIKConfig()
        self._body = (HEIGHT_JOINT, PITCH_JOINT, robot.joint_names[robot.waist])
        self._arms = arms = ArmSolver(self._robot, self._config, still=still_names(robot), on_column=True)
        self.placo, self._solver = arms.placo, arms.solver
        for name, fastest in zip(self._body, SPEED, strict=True):
            self.placo.set_velocity_limit(name, fastest)
        self._columns = np.array([self.placo.get_joint_offset(name) for name in self._body])
        for joint in robot.held:
            self.placo.set_joint(robot.joint_names[joint], float(robot.nominal[joint]))
        self._body_task = self._solver.add_joints_task()
        self._body_task.set_joints(dict.fromkeys(self._body, 0.0))
        self._body_task.configure("body", "soft", BODY_WEIGHT)
        self.reset()

    def reset(self) -> None:
        """Forget the past: the next targets start from the measured arms and the commanded h, p and w."""
        self._active = False
        self.values = np.zeros(3)
        self._place_arms(self._robot.nominal[self._robot.arms])

    def _place_arms(self, q: np.ndarray) -> None:
        configuration = self.placo.state.q.copy()
        configuration[self._arms.columns] = q
        self.placo.state.q = configuration

    def update(self, hands: HandTargets | None, state: RobotState, command: Command, dt: float) -> Command:
        """Return the command with h, p and w as the hands need them.

        Bad numbers never raise: h, p and w keep their values.

        Args:
            hands: the targets; None, or targets that do not ask for the whole body, bring h, p and w back.
            state: gives heading and position of the pelvis, and the initial arm positions.
            command: the user's command.
            dt: time since the last tick [s]; at most `LONGEST_TICK` counts.
        """
        wanted = np.array([getattr(command, name) for name in BODY_NAMES])
        wants_body = hands is not None and hands.whole_body
        usable = bool(np.all(np.isfinite(wanted))) and 0.0 < dt < np.inf
        dt = min(dt, LONGEST_TICK)
        if not self._active:
            if not wants_body or not usable:
                return command
            self._active = True
            q, nominal = state.q[self._robot.arms], self._robot.nominal[self._robot.arms]
            self.start(np.clip(np.where(np.isfinite(q), q, nominal), self._arms.lower, self._arms.upper), wanted)
        ranges = np.array([command_ranges(command.gait, self._robot)[name].finishing for name in BODY_NAMES])
        if usable:
            # Another gait may have narrower ranges. A command beyond them passes: its clamp is counted elsewhere.
            self.values = np.clip(self.values, np.minimum(ranges[:, 0], wanted), np.maximum(ranges[:, 1], wanted))
        if usable and not wants_body:
            self.values = _towards(self.values, wanted, dt)
            self._active = bool(np.any(self.values != wanted))
        elif usable and hands is not None and hands.is_usable:
            self._follow(hands, state, ranges, wanted, dt)
        values = dict(zip(BODY_NAMES, self.values.tolist(), strict=True))
        return dataclasses.replace(command, **values)

    def _follow(self, hands: HandTargets, state: RobotState, ranges: np.ndarray, wanted: np.ndarray, dt: float) -> None:
        """Take a step of `dt` [s] to usable targets; those of h, p, w that cannot help go back to the wanted values."""
        low, high = ranges.T
        wanted, values = np.clip(wanted, low, high), np.clip(self.values, low, high)
        helping = _HELPING[hands.frame]
        values = np.where(helping, values, _towards(values, wanted, dt))
        points = on_column(hands, state, values, self._robot)
        if points is not None:
            self.allow(np.where(helping[:, None], ranges, values[:, None]))
            self.solve(points, hands.given, wanted, values, dt)
            self.values = np.clip(self.values, low, high)  # the solver's ranges are a little wider

    def allow(self, ranges: np.ndarray) -> None:
        """Set the ranges of h, p and w, shape (3, 2)."""
        for joint, (low, high) in zip(self._body, ranges, strict=True):
            # The solver needs a range with an interior, even where only one value is allowed.
            self.placo.set_joint_limits(joint, float(low) - 1e-6, float(high) + 1e-6)

    def solve(
        self, points: np.ndarray, given: np.ndarray, wanted: np.ndarray, values: np.ndarray, dt: float
    ) -> np.ndarray:
        """Take one step towards hand positions on the column and return the remaining distances [m], shape (2,).

        Args:
            points: hand targets in the column's frame, which is the nominal pelvis frame [m], shape (2, 3).
            given: which hands have a target, shape (2,), bool.
            wanted: h, p and w towards which the body is pulled, shape (3,).
            values: h, p and w to start from, shape (3,).
            dt: length of the step [s].
        """
        configuration = self.placo.state.q.copy()
        configuration[self._columns] = values
        self.placo.state.q = configuration
        self.placo.update_kinematics()
        hands = self.hands()
        error = np.where(given[:, None], points - hands, 0.0)
        distance = np.linalg.norm(error, axis=1)
        step = np.minimum(distance, self._config.hand_speed * dt)
        aim = hands + error * (step / np.maximum(distance, 1e-9))[:, None]
        for task, target, on in zip(self._arms.hands, aim, given, strict=True):
            task.target_world = target
            task.configure("hand", "soft", float(on))
        self._body_task.set_joints(dict(zip(self._body, wanted.tolist(), strict=True)))
        self._arms.damping.set_weight(self._config.damping + float(step.max()))
        self._solver.dt = dt
        try:
            self._solver.solve(True)
        except RuntimeError:
            self.placo.state.q = configuration
        self.placo.update_kinematics()
        self.values = self.placo.state.q[self._columns]
        return np.linalg.norm(np.where(given[:, None], points - self.hands(), 0.0), axis=1)

    def hands(self) -> np.ndarray:
        """Return the positions of the virtual hands in the column's frame [m], shape (2, 3)."""
        return self._arms.hand_points()

    def start(self, q_arm: np.ndarray, values: np.ndarray) -> None:
        """Move the virtual robot to arm positions (k,) [rad] and to h, p, w (3,), to search from there."""
        self._place_arms(q_arm)
        self.values = np.array(values, dtype=float)


def _towards(values: np.ndarray, wanted: np.ndarray, dt: float) -> np.ndarray:
    """Return h, p and w after `dt` [s] on the way to wanted values; all of shape (3,)."""
    step = np.array(SPEED) * dt
    return values + np.clip(wanted - values, -step, step)


def on_column(hands: HandTargets, state: RobotState, values: np.ndarray, robot: Robot) -> np.ndarray | None:
    """Return hand targets in the column's frame: that of a level pelvis at its nominal height above z = 0 of the world.

    Args:
        hands: the targets.
        state: gives heading and position.
        values: current h, p and w, shape (3,); targets in the pelvis and the heading frame move with them.
        robot: gives the nominal height.

    Returns:
        Positions [m], shape (2, 3), without meaning for a hand without a target; None if the targets are unusable.
    """
    if not hands.is_usable:
        return None
    points = np.where(hands.given[:, None], hands.array(), 0.0)
    if hands.frame == "world":
        if state.position is None:
            return None
        origin = np.array([*state.position[:2], robot.nominal_height])
        points = (points - origin) @ rotations.rotation_z(state.yaw)
    else:
        if hands.frame == "pelvis":
            points = points @ rotations.to_matrix(rotations.from_yaw_pitch_roll(0.0, float(values[1]), 0.0)).T
        points = points + np.array([0.0, 0.0, float(values[0])])
    return points if bool(np.all(np.isfinite(points))) else None
