"""Differences of a robot from its description: payloads, friction, joint gains, motor strength."""

import dataclasses
import math

import mujoco
import numpy as np

from hugwbc import rotations
from hugwbc.errors import ConfigError
from hugwbc.robot import SIDES
from hugwbc.sim.footing import PLANE_NAME


@dataclasses.dataclass(frozen=True)
class Variation:
    """Differences of one robot from its description; by default there are none.

    Attributes:
        payload: mass added at the torso's centre of mass [kg]; negative to remove mass.
        friction: coefficient of sliding friction between robot and ground; None for that of the description.
        gain: factor on the stiffness and damping that a controller commands.
        strength: factor on the torque that the motors deliver, including their limit.
        hand_payload: mass in each hand, at the tip of the forearm [kg].
    """

    payload: float = 0.0
    friction: float | None = None
    gain: float = 1.0
    strength: float = 1.0
    hand_payload: float = 0.0

    def __post_init__(self) -> None:
        if not -10.0 <= self.payload <= 50.0:
            raise ConfigError(f"payload is {self.payload} kg; give -10 to 50 kg")
        if not 0.0 <= self.hand_payload <= 20.0:
            raise ConfigError(f"payload of each hand is {self.hand_payload} kg; give 0 to 20 kg")
        if self.friction is not None and not 0.0 < self.friction < math.inf:
            raise ConfigError(f"friction is {self.friction}; give a finite coefficient above 0, or None")
        for name in ("gain", "strength"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ConfigError(f"{name} factor is {getattr(self, name)}; give a finite factor above 0")

    def apply_to(self, model: mujoco.MjModel) -> None:
        """Change a newly compiled model.

        Only the torque limits take `strength` here; the simulation applies `gain` and `strength` to the PD law.
        """
        if self.payload:
            model.body_mass[model.body("torso_link").id] += self.payload
            mujoco.mj_setConst(model, mujoco.MjData(model))
        if self.hand_payload:
            for side in SIDES:
                _add_mass(model, model.body(f"{side}_elbow_link").id, self.hand_payload, model.site(f"{side}_hand").pos)
            mujoco.mj_setConst(model, mujoco.MjData(model))
        if self.friction is not None:
            # MuJoCo uses the larger of two coefficients, so the ground's must not exceed the requested one.
            ground = np.array([model.geom(i).name in ("floor", PLANE_NAME) for i in range(model.ngeom)])
            robot = model.body_rootid[model.geom_bodyid] == model.body("pelvis").id
            model.geom_friction[robot, 0] = self.friction
            model.geom_friction[ground, 0] = np.minimum(model.geom_friction[ground, 0], self.friction)
        drives = [i for i in range(model.nu) if model.body_rootid[_body_of(model, i)] == model.body("pelvis").id]
        model.actuator_forcerange[drives] *= self.strength


def _body_of(model: mujoco.MjModel, actuator: int) -> int:
    """Return the body that an actuator moves."""
    return int(model.jnt_bodyid[model.actuator_trnid[actuator, 0]])


def _add_mass(model: mujoco.MjModel, body: int, mass: float, point: np.ndarray) -> None:
    """Add a point mass [kg] to a body, at a point in the body's frame [m]."""
    own, centre = float(model.body_mass[body]), model.body_ipos[body].copy()
    turn = rotations.to_matrix(model.body_iquat[body])
    middle = (own * centre + mass * point) / (own + mass)
    inertia = turn @ np.diag(model.body_inertia[body]) @ turn.T
    for part, place in ((own, centre), (mass, point)):
        arm = place - middle
        inertia += part * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    principal, axes = np.linalg.eigh(inertia)
    axes[:, 2] *= np.sign(np.linalg.det(axes))  # a rotation, not a reflection
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, axes.ravel())
    model.body_mass[body], model.body_ipos[body] = own + mass, middle
    model.body_inertia[body], model.body_iquat[body] = principal, quaternion
