"""The contents of a picture of a robot at one time, the same whether it is drawn live or replayed from a record."""

import dataclasses

import numpy as np

from hugwbc.numeric import floats
from hugwbc.runtime.guard import Guard
from hugwbc.runtime.safety_report import SafetyLog


@dataclasses.dataclass(frozen=True, eq=False)
class Snapshot:
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


SNAPSHOT_FIELDS = tuple(field.name for field in dataclasses.fields(Snapshot))
SCENE_FIELDS = ("hand_force", "object_pose")  # which a record has only of a robot among objects


class PlanView:
    """A controller's plan, as far as it has one and gives it in its form (`hugwbc.controller.Controller`)."""

    def __init__(self, guard: Guard, log: SafetyLog) -> None:
        """Look at the controller behind a guard; the log counts what it raises."""
        self._guard, self._log = guard, log

    def _read(self, name: str, shape: tuple[int, ...]) -> np.ndarray | None:
        guard = self._guard
        value = self._log.ask("failures", f"{name} of {guard.name}", lambda: getattr(guard.controller, name, None))
        return floats(value, shape)

    @property
    def phase(self) -> float:
        """The common gait phase in [0, 1); NaN without one."""
        phase = self._read("phase", ())
        return np.nan if phase is None else float(phase)

    @property
    def footholds(self) -> np.ndarray:
        """The planned footholds, world x and y [m], shape (2, 2); NaN without a plan. The array is the caller's."""
        footholds = self._read("footholds", (2, 2))
        return np.full((2, 2), np.nan) if footholds is None else footholds.copy()

    @property
    def acceleration(self) -> np.ndarray | None:
        """The planned joint accelerations [rad/s^2], shape (n,); None without a plan."""
        return self._read("planned_acceleration", self._guard.robot.kp.shape)
