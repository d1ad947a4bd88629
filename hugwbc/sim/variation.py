"""Differences of a robot from its description: payloads, friction, joint gains, motor strength."""

from typing import Annotated

import mujoco
import numpy as np
from pydantic import Field

from hugwbc import rotations
from hugwbc.robot import Robot
from hugwbc.settings import Positive, settings
from hugwbc.sim.footing import PLANE_NAME


@settings
class Variation:
    """Differences of one robot from its description; by default there are none.

    Attributes:
        payload: mass added at the trunk's centre of mass [kg]; negative to remove mass.
        friction: coefficient of sliding friction between robot and ground; None for that of the description.
        gain: factor on the stiffness and damping that a controller commands.
        strength: factor on the torque that the motors deliver, including their limit.
        hand_payload: mass in each hand, at its frame [kg].
    """

    payload: Annotated[float, Field(ge=-10.0, le=50.0)] = 0.0
    friction: Positive | None = None
    gain: Positive = 1.0
    strength: Positive = 1.0
    hand_payload: Annotated[float, Field(ge=0.0, le=20.0)] = 0.0

    def apply_to(self, model: mujoco.MjModel, robot: Robot) -> None:
        """Change a newly compiled model of a robot.

        Only the torque limits take `strength` here; the simulation applies `gain` and `strength` to the PD law.
        """
        root = model.body(robot.base).id
        if self.payload:
            model.body_mass[model.body(robot.trunk).id] += self.payload
            mujoco.mj_setConst(model, mujoco.MjData(model))
        if self.hand_payload:
            for link in robot.hand_links:
                _add_mass(model, model.body(link).id, self.hand_payload, robot.hand)
            mujoco.mj_setConst(model, mujoco.MjData(model))
        if self.friction is not None:
            # MuJoCo uses the larger of two coefficients, so the ground's must not exceed the requested one.
            ground = np.array([model.geom(i).name in ("floor", PLANE_NAME) for i in range(model.ngeom)])
            own = model.body_rootid[model.geom_bodyid] == root
            model.geom_friction[own, 0] = self.friction
            model.geom_friction[ground, 0] = np.minimum(model.geom_friction[ground, 0], self.friction)
        drives = [i for i in range(model.nu) if model.body_rootid[_body_of(model, i)] == root]
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
