"""placo's solver of one step that brings both hands to points, with the arms alone or with the body."""

import numpy as np
import placo

from hugwbc.robot import SIDES, Robot
from hugwbc.upper_ik.config import ArmIKConfig
from hugwbc.upper_ik.self_collision import upper_body

FRAMES = tuple(f"{side}_hand" for side in SIDES)


class ArmSolver:
    """Tasks of both hands, posture, damping and collisions, within the limits of the arm joints; all are soft.

    Attributes:
        lower, upper: joint position limits minus the margin [rad], shape (k,).
        velocity_limit: highest joint speeds [rad/s], shape (k,).
        placo: placo's robot.
        columns: places of the arm joints in its configuration, shape (k,).
        solver: placo's solver, to which further tasks may be added.
        hands: task of each hand, of weight 1.
        damping: task that keeps the step short.
    """

    def __init__(self, robot: Robot, config: ArmIKConfig, still: tuple[str, ...], *, on_column: bool = False) -> None:
        """Build the solver of a robot whose joints `still` do not move, `on_column` as in `upper_body`."""
        arms, names, self._config = robot.arms, robot.arm_names, config
        self.lower = robot.lower[arms] + config.limit_margin
        self.upper = robot.upper[arms] - config.limit_margin
        self.velocity_limit = robot.velocity_limit[arms] * config.speed_fraction
        self.placo = upper_body(robot, on_column=on_column)
        for name, lower, upper, speed in zip(names, self.lower, self.upper, self.velocity_limit, strict=True):
            self.placo.set_joint_limits(name, float(lower), float(upper))
            self.placo.set_velocity_limit(name, float(speed))
        self.columns = np.array([self.placo.get_joint_offset(name) for name in names])
        self.solver = placo.KinematicsSolver(self.placo)
        self.solver.mask_fbase(True)
        for name in still:
            self.solver.mask_dof(name)
        self.solver.enable_joint_limits(True)
        self.solver.enable_velocity_limits(True)
        self.hands = [self.solver.add_position_task(frame, np.zeros(3)) for frame in FRAMES]
        for frame, task in zip(FRAMES, self.hands, strict=True):
            task.configure(frame, "soft", 1.0)
        posture = self.solver.add_joints_task()
        posture.set_joints(dict(zip(names, robot.nominal[arms].tolist(), strict=True)))
        posture.configure("posture", "soft", config.posture_weight)
        self.damping = self.solver.add_regularization_task(1.0)
        self.damping.configure("damping", "soft", 1.0)
        self._avoid_collisions()

    def _avoid_collisions(self) -> None:
        self._collisions = self.solver.add_avoid_self_collisions_constraint()
        self._collisions.self_collisions_margin = self._config.collision_margin
        self._collisions.self_collisions_trigger = self._config.collision_trigger
        self._collisions.configure("collisions", "soft", self._config.collision_weight)

    def solve_without_collisions(self) -> None:
        """Take the step without regard to collisions.

        Raises:
            RuntimeError: if placo cannot solve it.
        """
        self.solver.remove_constraint(self._collisions)  # type: ignore[arg-type]  placo's stubs lack the base class
        try:
            self.solver.solve(True)
        finally:
            self._avoid_collisions()

    def hand_points(self) -> np.ndarray:
        """Return the positions of the hands at the posture for which placo's kinematics are up to date, (2, 3) [m]."""
        return np.array([self.placo.get_T_world_frame(frame)[:3, 3] for frame in FRAMES])
