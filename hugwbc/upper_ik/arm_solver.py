"""Settings of the inverse kinematics, and placo's solver of one step of both hands, by arms alone or with the body."""

import numpy as np
import placo

from hugwbc.robot import SIDES, Robot
from hugwbc.settings import Positive, PositiveShare, settings
from hugwbc.upper_ik.self_collision import upper_body

FRAMES = tuple(f"{side}_hand" for side in SIDES)


@settings
class ArmIKConfig:
    """Settings of the inverse kinematics.

    Attributes:
        limit_margin: distance kept from the joint position limits [rad].
        speed_fraction: share of the joint velocity limits that the solution may use; half leaves the joint's controller
            room to catch up after a disturbance.
        acceleration: highest acceleration of a joint [rad/s^2].
        hand_speed: highest speed of a hand towards its target, in addition to the target's own speed [m/s].
        hand_deceleration: deceleration with which a hand can stop at its target [m/s^2].
        posture_weight: weight of the pull towards the nominal posture, relative to 1 for the hands [m^2/rad^2]. It is
            small, because it leaves an error in the hands (below 0.5 mm with the default).
        pointing_weight: weight of the elbow positions that make the forearms point as asked, relative to 1 for the
            hands. In a conflict, the hand is off its target by a hundredth of the elbow's error.
        orientation_weight: weight of the hands' orientations, where targets give none, relative to 1 for their
            positions [m^2/rad^2].
        turn_speed: highest speed at which a hand turns to its orientation [rad/s].
        turn_deceleration: deceleration with which it can stop there [rad/s^2].
        grip_weight: weight of the relative position of hands that hold one object; less while the arms nearly touch.
        collision_weight: weight of the distances between links, which may be violated if there is no other way.
        collision_margin: distance kept between links [m].
        collision_trigger: distance below which links are kept apart [m].
        collision_deceleration: deceleration with which a hand can stop before its forearm touches something [m/s^2].
        touch_speed: speed of a hand whose forearm is next to something [m/s].
        damping: lambda for hands on target [m^2/rad^2].
        tolerance: distance within which a hand counts as on target [m].
        detour_gain: how much nearer another posture must bring a stalled hand for a detour [m].
        detour_speed: highest joint speed on a detour [rad/s]; the hand is no faster than `hand_speed`.
    """

    limit_margin: Positive = 0.02
    speed_fraction: PositiveShare = 0.5
    acceleration: Positive = 60.0
    hand_speed: Positive = 1.5
    hand_deceleration: Positive = 6.0
    posture_weight: Positive = 1e-5
    pointing_weight: Positive = 1e-2
    orientation_weight: Positive = 0.03
    turn_speed: Positive = 6.0
    turn_deceleration: Positive = 150.0
    grip_weight: Positive = 100.0
    collision_weight: Positive = 1e3
    collision_margin: Positive = 0.01
    collision_trigger: Positive = 0.05
    collision_deceleration: Positive = 15.0
    touch_speed: Positive = 0.4
    damping: Positive = 1e-3
    tolerance: Positive = 0.005
    detour_gain: Positive = 0.02
    detour_speed: Positive = 4.0


class ArmSolver:
    """Soft tasks of both hands, posture, damping and collisions, within the limits of the arm joints.

    Attributes:
        lower, upper: joint position limits minus the margin [rad], shape (k,).
        velocity_limit: highest joint speeds [rad/s], shape (k,).
        placo: placo's robot.
        columns: places of the arm joints in the configuration of placo's robot, shape (k,).
        solver: placo's solver, to which further tasks may be added.
        hands: task of each hand, of weight 1.
        damping: task that keeps the step short.
    """

    def __init__(self, robot: Robot, config: ArmIKConfig, still: tuple[str, ...], *, on_column: bool = False) -> None:
        """Build the solver of a robot whose joints `still` do not move, `on_column` as in `upper_body`."""
        arms, names, self._config = robot.arms, robot.arm_names, config
        self.lower, self.upper = (limit[arms] for limit in robot.limits(config.limit_margin))
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
