"""A part of a scene that the user has described in MuJoCo's own format, MJCF."""

import os.path
from typing import Any, ClassVar

import mujoco
import numpy as np

from hugwbc.errors import SceneError
from hugwbc.settings import Beside, settings
from hugwbc.sim.scenes.thing import FARTHEST, Placement, Thing

# Parts of a file that concern a whole simulation and not the things in it.
_SHARED_OPTIONS = ("timestep", "iterations", "ls_iterations", "integrator", "jacobian", "cone", "impratio")
# Numbers of a compiled model that MuJoCo does not check itself.
_ARRAYS = (
    "body_pos", "body_quat", "body_mass", "body_inertia", "body_ipos", "geom_pos", "geom_quat", "geom_size",
    "geom_friction", "geom_solref", "geom_solimp", "geom_margin", "geom_gap", "jnt_pos", "jnt_axis", "jnt_range",
    "jnt_stiffness", "dof_damping", "dof_armature", "dof_frictionloss", "qpos0", "qpos_spring", "eq_data",
    "tendon_stiffness", "tendon_damping", "actuator_gainprm", "actuator_biasprm",
)  # fmt: skip
_LIGHTEST, _HEAVIEST = 1e-6, 1e4  # [kg], of a body that moves
_FEET = 2  # the bit of MuJoCo's collision masks that the soles on a height field have (`sim.footing`)


@settings(kw_only=True)
class Mjcf(Thing):
    """The bodies of an MJCF file, with the prefix NAME/.

    Masses, friction, joints and colours are those of the file; `friction` and `colour` here have no effect.
    The file's world comes to the position; its keyframes, its options and a ground plane in its world are left out.

    Attributes:
        mjcf: path of the file; relative paths in it start from its folder.
    """

    kind: ClassVar[str] = "mjcf"
    movable: ClassVar[bool] = True

    mjcf: Beside

    def __post_init__(self) -> None:
        if not os.path.isfile(self.mjcf):
            raise SceneError(f"{self.label}: there is no file {self.mjcf}; give the path of an MJCF file", at=("mjcf",))
        spec = self._read()
        try:
            model = spec.compile()
        except (ValueError, mujoco.FatalError) as error:
            raise SceneError(f"{self.label}: MuJoCo refuses {self.mjcf}: {_one_line(error)}; fix the file") from error
        if model.nbody < 2:
            raise SceneError(f"{self.label}: {self.mjcf} has no bodies; put its geoms into a body with a name")
        self._check_numbers(model)

    def _check_numbers(self, model: mujoco.MjModel) -> None:
        """Refuse what MuJoCo compiles but cannot simulate: NaN, distant bodies, extreme masses."""
        for name in _ARRAYS:
            if not np.all(np.isfinite(getattr(model, name))):
                raise SceneError(f"{self.label}: {self.mjcf} has a {name} that is not finite; give finite numbers")
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        for body in range(1, model.nbody):
            what, mass = f"{self.label}: body '{model.body(body).name}'", float(model.body_subtreemass[body])
            if not np.all(np.abs(data.xpos[body]) <= FARTHEST):
                raise SceneError(f"{what} of {self.mjcf} is more than {FARTHEST:g} m from the file's origin; move it")
            if model.body_dofnum[body] > 0 and not _LIGHTEST <= mass <= _HEAVIEST:
                wanted = f"give {_LIGHTEST:g} to {_HEAVIEST:g} kg, what hangs on it included"
                raise SceneError(f"{what} of {self.mjcf} moves and has a mass of {mass:g} kg; {wanted}")

    def _read(self) -> mujoco.MjSpec:
        """Return the file without what concerns a whole simulation, and with a name for every body."""
        try:
            spec = mujoco.MjSpec.from_file(str(self.mjcf))
        except (ValueError, mujoco.FatalError) as error:
            raise SceneError(f"{self.label}: cannot read {self.mjcf}: {_one_line(error)}; give valid MJCF") from error
        planes = [geom for geom in spec.worldbody.geoms if geom.type == mujoco.mjtGeom.mjGEOM_PLANE]
        for element in (*spec.keys, *planes):
            spec.delete(element)
        spec.memory, spec.nkey = -1, 0  # what a file asks for may be more than there is
        for kind in ("actuator", "body", "cam", "geom", "jnt", "sensor", "site", "tendon"):
            setattr(spec, f"nuser_{kind}", -1)
        for number, body in enumerate(spec.bodies):
            body.name = body.name or f"body_{number}"
        return spec

    def body_names(self) -> tuple[str, ...]:  # noqa: D102
        return tuple(f"{self.name}/{body.name}" for body in self._read().bodies if body.name != "world")

    def build(self, spec: mujoco.MjSpec, place: Placement) -> None:  # noqa: D102
        child = self._read()
        for option in _SHARED_OPTIONS:  # MuJoCo attaches only what agrees with the rest
            setattr(child.option, option, getattr(spec.option, option))
        for geom in child.geoms:
            if geom.contype & 1:
                geom.contype |= _FEET
        frame: Any = spec.worldbody.add_frame(pos=place.above(0.0))
        frame.quat = np.asarray(place.quaternion)
        spec.attach(child, prefix=f"{self.name}/", frame=frame)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()).removeprefix("Error: ")
