"""A part of a scene that the user has described in MuJoCo's own format, MJCF."""

import dataclasses
import pathlib
from typing import Any, ClassVar

import mujoco
import numpy as np

from hugwbc.errors import SceneError
from hugwbc.sim.scenes.thing import Placement, Thing

# Parts of a file that concern a whole simulation and not the things in it.
_SHARED_OPTIONS = ("timestep", "iterations", "ls_iterations", "integrator", "jacobian", "cone", "impratio")
_FEET = 2  # the bit of MuJoCo's collision masks that the soles on a height field have (`sim.footing`)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Mjcf(Thing):
    """The bodies of an MJCF file, with the prefix NAME/.

    Masses, friction, joints and colours are those of the file; `friction` and `colour` here have no effect.
    The file's world comes to the position; its keyframes, its options and a ground plane in its world are left out.

    Attributes:
        mjcf: path of the file; relative paths in it start from its folder.
    """

    kind: ClassVar[str] = "mjcf"
    movable: ClassVar[bool] = True

    mjcf: pathlib.Path

    def __post_init__(self) -> None:
        super().__post_init__()
        if not pathlib.Path(self.mjcf).is_file():
            raise SceneError(f"{self.label}: there is no file {self.mjcf}; give the path of an MJCF file")
        spec = self._read()
        try:
            model = spec.compile()
        except (ValueError, mujoco.FatalError) as error:
            raise SceneError(f"{self.label}: MuJoCo refuses {self.mjcf}: {_one_line(error)}; mend the file") from error
        if model.nbody < 2:
            raise SceneError(f"{self.label}: {self.mjcf} has no bodies; put its geoms into a body with a name")

    def _read(self) -> mujoco.MjSpec:
        """Return the file without what concerns a whole simulation, and with a name for every body."""
        try:
            spec = mujoco.MjSpec.from_file(str(self.mjcf))
        except (ValueError, mujoco.FatalError) as error:
            raise SceneError(f"{self.label}: cannot read {self.mjcf}: {_one_line(error)}; give valid MJCF") from error
        planes = [geom for geom in spec.worldbody.geoms if geom.type == mujoco.mjtGeom.mjGEOM_PLANE]
        for element in (*spec.keys, *planes):
            spec.delete(element)
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
