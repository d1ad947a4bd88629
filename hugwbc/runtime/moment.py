"""The contents of a picture of a robot at one time, the same whether it is drawn live or replayed from a record."""

import dataclasses

import numpy as np

from hugwbc.controller import Controller, HasFootholds, HasPhase, HasPlannedAcceleration


@dataclasses.dataclass(frozen=True, eq=False)
class Moment:
    """One robot at one time, in the world frame.

    Attributes:
        qpos: pelvis position [m], quaternion (w, x, y, z) and joint positions [rad], shape (26,).
        gait: value of `Gait`.
        phase: the controller's common gait phase in [0, 1); NaN without one.
        foot_contact: whether the left and the right foot are on the ground, shape (2,), bool.
        foot_force: ground reaction on each foot [N], shape (2, 3).
        pressure_centre: point where that force acts [m], shape (2, 3); NaN for a foot in the air.
        foothold: where the controller plans to put the centre of each sole next, x and y [m], shape (2, 2); NaN for a
            foot without a plan.
        hand_target_world: targets of both hands [m], shape (2, 3); NaN without one.
        arm_target: arm joint positions that the inverse kinematics or a motion asks for [rad], shape (8,); NaN where
            the controller moves the arms.
        hand_force: force on each hand from outside [N], shape (2, 3).
        object_pose: position [m] and quaternion (w, x, y, z) of every body of the scene, in the order of
            `Scene.body_names`, shape (bodies, 7).
    """

    qpos: np.ndarray
    gait: int
    phase: float
    foot_contact: np.ndarray
    foot_force: np.ndarray
    pressure_centre: np.ndarray
    foothold: np.ndarray
    hand_target_world: np.ndarray
    arm_target: np.ndarray
    hand_force: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((2, 3)))
    object_pose: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((0, 7)))


MOMENT_FIELDS = tuple(field.name for field in dataclasses.fields(Moment))
SCENE_FIELDS = ("hand_force", "object_pose")  # which a record has only of a robot among objects


class PlanView:
    """A controller's plan, as far as it has one; its parts are determined once, here.

    See `hugwbc.controller.HasPhase`, `HasFootholds` and `HasPlannedAcceleration`.
    """

    def __init__(self, controller: Controller) -> None:
        """Look at a controller."""
        self._phase = controller if isinstance(controller, HasPhase) else None
        self._footholds = controller if isinstance(controller, HasFootholds) else None
        self._acceleration = controller if isinstance(controller, HasPlannedAcceleration) else None

    @property
    def phase(self) -> float:
        """The common gait phase in [0, 1); NaN without one."""
        return np.nan if self._phase is None else self._phase.phase

    @property
    def footholds(self) -> np.ndarray:
        """The planned footholds, world x and y [m], shape (2, 2); NaN without a plan. The array is the caller's."""
        return np.full((2, 2), np.nan) if self._footholds is None else self._footholds.footholds.copy()

    @property
    def acceleration(self) -> np.ndarray | None:
        """The planned joint accelerations [rad/s^2], shape (19,); None without a plan."""
        return None if self._acceleration is None else self._acceleration.planned_acceleration
