"""A part of a scene that the user has described in MuJoCo's own format, MJCF."""

import dataclasses
import os.path
from collections.abc import Iterator
from typing import Any, ClassVar
from xml.etree.ElementTree import ParseError

import mujoco
import numpy as np

from hugwbc.errors import SceneError
from hugwbc.settings import Beside, settings
from hugwbc.sim.footing import FOOT_CONTACT_BIT
from hugwbc.sim.scenes.mjcf_size import SizeCheck
from hugwbc.sim.scenes.thing import FARTHEST, Placement, Thing

# Parts of a file that concern a whole simulation and not the things in it.
_SHARED_OPTIONS = ("timestep", "iterations", "ls_iterations", "integrator", "jacobian", "cone", "impratio")
# Kinds of numbers of a compiled model that a scene keeps, and how many there are of each.
_KINDS = {"body": "nbody", "geom": "ngeom", "jnt": "njnt", "dof": "nv", "qpos": "nq", "eq": "neq", "tendon": "ntendon",
          "actuator": "nu", "pair": "npair", "exclude": "nexclude"}  # fmt: skip
_WHOLE_NUMBERS = ("type", "limited", "contype", "conaffinity", "condim", "priority", "active0", "dim", "mocapid")
# Options that move things: their values in the arena, and how far a file's may be from them (air is admitted).
_MOVING = {"gravity": ((0.0, 0.0, -9.81), 0.01), "wind": (0.0, 0.0), "density": (0.0, 1.3), "viscosity": (0.0, 2e-5),
           "disableactuator": (0, 0)}  # fmt: skip
_FLAGS = ("CONSTRAINT", "EQUALITY", "FRICTIONLOSS", "LIMIT", "CONTACT", "SPRING", "DAMPER", "GRAVITY", "CLAMPCTRL",
          "FILTERPARENT", "ACTUATION")  # fmt: skip
_LEVEL = 0.01  # of the ground in a file: its height [m], and 1 minus the cosine of its tilt (8 degrees)
_STATIC = "world_shapes"  # the body of the geoms in a file's world
_OWN = {"name", "classname", "compiler", "frame", "id", "info", "parent", "plugin", "set_frame", "signature"}
_LIGHTEST, _HEAVIEST = 1e-6, 1e4  # [kg], of a body that moves


@settings(kw_only=True)
class Mjcf(Thing):
    """The bodies of an MJCF file, with the prefix NAME/.

    Masses, friction, joints and colours are those of the file; `friction` and `colour` here are refused.
    The file's world comes to the position; its keyframes, its options and a ground plane in its world are left out.
    Other shapes of its world become the body NAME/world_shapes. What a scene cannot keep is refused: the model in a
    scene is compared with that of the file alone.

    Attributes:
        mjcf: path of the file; relative paths in it start from its folder.
    """

    movable: ClassVar[bool] = True

    mjcf: Beside

    def scaled(self, size: float) -> "Mjcf":
        """Refuse: a file says nothing of what would scale."""
        raise SceneError(f"{self.label} has the size of its file; a scene with it fits the robot that it is made for")

    def __post_init__(self) -> None:
        if not os.path.isfile(self.mjcf):
            raise SceneError(f"{self.label}: there is no file {self.mjcf}; give the path of an MJCF file", at=("mjcf",))
        for field in dataclasses.fields(self):
            if field.name in ("friction", "colour") and getattr(self, field.name) != field.default:
                raise SceneError(f"{self.label}: its {field.name} is that of the file; say it there", at=(field.name,))
        here = mujoco.MjSpec()
        try:
            alone = self._read().compile()
            self.build(here, Placement())
            model = here.compile()
        except (ValueError, mujoco.FatalError) as error:
            raise SceneError(f"{self.label}: MuJoCo refuses {self.mjcf}: {_one_line(error)}; fix the file") from error
        if model.nbody < 2:
            raise SceneError(f"{self.label}: {self.mjcf} has no bodies; give it one")
        for problem in (*self._lost(alone, model), *self._impossible(alone)):
            raise SceneError(f"{self.label}: {self.mjcf} {problem}")

    def _lost(self, alone: mujoco.MjModel, here: mujoco.MjModel) -> Iterator[str]:
        """Yield which numbers are not finite, and which settings of the whole simulation a scene does not keep."""
        names = [here.geom(g).name.removeprefix(f"{self.name}/") for g in range(here.ngeom)]
        for kind, number in _KINDS.items():
            count = getattr(alone, number)
            rows = mine = list(range(kind == "body", count))  # without the world
            if kind == "geom":
                rows, mine = [alone.geom(name).id for name in names], list(range(here.ngeom))
            elif kind != "body" and count != getattr(here, number):
                yield f"has {count} {kind}, but {getattr(here, number)} in a scene; leave out those of its world"
                return
            for field in [field for field in dir(alone) if field.startswith(kind)]:
                numbers = getattr(alone, field)
                if getattr(numbers, "dtype", np.dtype(int)).kind == "f" or field.partition("_")[2] in _WHOLE_NUMBERS:
                    given, kept = numbers[rows], getattr(here, field)[mine]
                    if not np.all(np.isfinite(given)):
                        yield f"has a {field} that is not finite; give finite numbers"
                    for row in np.unique(np.argwhere(~np.isclose(given, kept, rtol=1e-6, atol=1e-9))[:, :1]):
                        named = getattr(alone, kind)(rows[row]).name if kind in ("body", "geom", "jnt") else rows[row]
                        yield (
                            f"gives {kind} '{named}' the {field} {given[row]}, but it is {kept[row]} in a scene, which "
                            "keeps nothing that a compiler says of all, as settotalmass; give it in the element"
                        )
        options, bits = alone.opt, mujoco.mjtDisableBit
        given = {name: getattr(options, name) for name in _MOVING}
        changed = [
            name for name, (ours, most) in _MOVING.items() if not np.all(np.abs(given[name] - np.array(ours)) <= most)
        ]
        changed += [flag.lower() for flag in _FLAGS if options.disableflags & getattr(bits, f"mjDSBL_{flag}", 0)]
        changed += ["override"] if options.enableflags & mujoco.mjtEnableBit.mjENBL_OVERRIDE else []
        if changed:
            yield f"changes {', '.join(changed)} of the whole simulation, which is the arena's; leave that out"
        for plane in {alone.geom(g).name for g in range(alone.ngeom)} - set(names):
            geom, upright = alone.geom(plane), 1.0 - 2.0 * np.sum(alone.geom(plane).quat[1:3] ** 2)
            if (geom.contype | geom.conaffinity) and (abs(geom.pos[2]) > _LEVEL or upright < 1.0 - _LEVEL):
                yield f"has the plane '{plane}', which is not the ground z = 0; make it a box"

    def _impossible(self, model: mujoco.MjModel) -> Iterator[str]:
        """Yield what MuJoCo compiles but a scene cannot simulate: flexible or distant bodies, extreme masses."""
        if model.nflex:
            yield "has flexible bodies (flexcomp), whose contacts no judge understands; leave them out"
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        for body in range(1, model.nbody):
            what, mass = f"has a body '{model.body(body).name}' that", float(model.body_subtreemass[body])
            if not np.all(np.abs(data.xpos[body]) <= FARTHEST):
                yield f"{what} is more than {FARTHEST:g} m from the file's origin; move it"
            if model.body_dofnum[body] > 0 and not _LIGHTEST <= mass <= _HEAVIEST:
                wanted = f"give {_LIGHTEST:g} to {_HEAVIEST:g} kg, what hangs on it included"
                yield f"{what} moves and has a mass of {mass:g} kg; {wanted}"

    def _read(self) -> mujoco.MjSpec:
        """Return the file with a name for every body and shape, and without keyframes and its demands on memory."""
        try:
            SizeCheck(self.mjcf)
            spec = mujoco.MjSpec.from_file(str(self.mjcf))
        except (ValueError, OSError, ParseError, RecursionError, SceneError, mujoco.FatalError) as error:
            raise SceneError(f"{self.label}: cannot read {self.mjcf}: {_one_line(error)}; give valid MJCF") from error
        for key in spec.keys:
            spec.delete(key)
        spec.memory, spec.nkey = -1, 0  # what a file asks for may be more than there is
        for kind in ("actuator", "body", "cam", "geom", "jnt", "sensor", "site", "tendon"):
            setattr(spec, f"nuser_{kind}", -1)
        spec.compiler.fusestatic = spec.compiler.discardvisual = False
        for number, body in enumerate(spec.bodies):
            body.name = body.name or f"body_{number}"
        for number, geom in enumerate(spec.geoms):
            geom.name = geom.name or f"geom_{number}"
            geom.contype |= FOOT_CONTACT_BIT * (geom.contype & 1)
        return spec

    def _taken(self) -> mujoco.MjSpec:
        """Return the file without its ground, and with the other shapes of its world in a body of their own."""
        spec = self._read()
        static: Any = None
        for geom in spec.worldbody.geoms:
            name = geom.name
            if geom.type != mujoco.mjtGeom.mjGEOM_PLANE:
                static = static or spec.worldbody.add_body(name=_STATIC)
                copy = static.add_geom()
                for field in {name for name in dir(copy) if not name.startswith("_")} - _OWN:
                    setattr(copy, field, getattr(geom, field))
                if geom.frame is not None:
                    copy.set_frame(_frame_in(static, geom.frame))
                spec.delete(geom)
                copy.name = name
            else:
                spec.delete(geom)
        return spec

    def body_names(self) -> tuple[str, ...]:  # noqa: D102
        return tuple(f"{self.name}/{body.name}" for body in self._taken().bodies if body.name != "world")

    def build(self, spec: mujoco.MjSpec, place: Placement) -> None:  # noqa: D102
        child = self._taken()
        for option in _SHARED_OPTIONS:  # MuJoCo attaches only what agrees with the rest
            setattr(child.option, option, getattr(spec.option, option))
        frame: Any = spec.worldbody.add_frame(pos=place.above(0.0))
        frame.quat = np.asarray(place.quaternion)
        spec.attach(child, prefix=f"{self.name}/", frame=frame)


def _frame_in(body: Any, frame: Any) -> Any:  # noqa: ANN401  MuJoCo's
    """Return a copy of a frame, and of those that it is in, in another body."""
    copy = body.add_frame(pos=frame.pos, quat=frame.quat)
    copy.alt = frame.alt
    if frame.frame is not None:
        copy.set_frame(_frame_in(body, frame.frame))
    return copy


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()).removeprefix("Error: ")
