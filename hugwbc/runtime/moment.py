"""What a picture of a robot shows, at one time: the same whether it is drawn live or replayed from a record."""

import dataclasses

import numpy as np

from hugwbc.controller import Controller


@dataclasses.dataclass(frozen=True, eq=False)
class Moment:
    """One robot at one time, all in the world frame.

    Attributes:
        qpos: pelvis position, quaternion (w, x, y, z) and joint positions, shape (26,).
        gait: value of `Gait`.
        phase: the controller's common phase of the gait, in [0, 1); NaN where it keeps none.
        foot_contact: whether the left and the right foot are on the ground, shape (2,), bool.
        foot_force: ground reaction on each foot [N], shape (2, 3).
        pressure_centre: where it acts [m], NaN for a foot in the air, shape (2, 3).
        foothold: where the controller plans to put the middle of each sole next, x and y [m], shape (2, 2); NaN for a
            foot that it has no plan for.
        hand_target_world: targets of both hands [m], NaN where there is none, shape (2, 3).
        arm_target: arm joint positions that the inverse kinematics or a motion wants [rad], shape (8,); NaN where the
            arms are the controller's.
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


MOMENT_FIELDS = tuple(field.name for field in dataclasses.fields(Moment))


def gait_plan(controller: Controller) -> tuple[float, np.ndarray]:
    """A controller's `phase` and `footholds`, members that it may have or not; NaN, shape (2, 2), in their place."""
    phase = getattr(controller, "phase", np.nan)
    footholds = getattr(controller, "footholds", np.full((2, 2), np.nan))
    return phase, footholds
