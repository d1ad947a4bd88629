"""Common base of a scene's objects: name, place, friction, colour, and how they become bodies."""

import dataclasses
import math
import re
from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Self

import mujoco
import numpy as np
from pydantic import AfterValidator

from hugwbc import rotations
from hugwbc.errors import SceneError
from hugwbc.settings import settings
from hugwbc.sim.footing import FOOT_CONTACT_BIT
from hugwbc.sim.scenes.varied import Colour, Number, between, drawn, options, scaled, settled, varies

FARTHEST = 50.0  # [m] from the origin, along x and y, of a declared position; twice as far away is out of the world
# Contacts with torsional and nearly no sliding friction throw things into the air: MuJoCo's friction pyramid gets the
# steeper, the smaller sliding friction is beside torsional friction.
LEAST_FRICTION = 0.005
# Of MuJoCo's collision masks. The soles of a robot on a height field have a bit of their own.
_TOUCHED, _TOUCHES = 1 | FOOT_CONTACT_BIT, 1
# Of two things that touch, the one of higher priority decides the friction: movable things, then fixed ones, then robot
# and ground. Of two things of the same priority, MuJoCo takes the larger coefficient.
FIXED_PRIORITY, MOVABLE_PRIORITY = 1, 2
# Contacts of movable things. With the ground's time constant of 5 ms, the contacts of a box between two hands break and
# close again all the time, and it slips; with MuJoCo's default impedance, it creeps by twice as much (docs/scenes.md).
MOVABLE_TIME_CONSTANT = 0.01  # [s]
MOVABLE_IMPEDANCE = (0.98, 0.99, 0.001)
_DRAWN_GROUP = 1  # of MuJoCo's groups of geoms: drawn, and not of a robot's shell
_TORSION, _ROLLING = 0.005, 0.0001  # [m]
_HIGHEST = 10.0  # [m] above what a thing stands on


def _name(name: str) -> str:
    if not re.fullmatch("[A-Za-z][A-Za-z0-9_-]{0,62}", name):
        raise ValueError("should be up to 63 letters, digits, - and _, first a letter")
    return name


def _position(position: tuple[Number, ...]) -> tuple[Number, ...]:
    ranges = ((-FARTHEST, FARTHEST), (-FARTHEST, FARTHEST), (0.0, _HIGHEST))
    good = all(
        low <= value <= high for entry, (low, high) in zip(position, ranges, strict=False) for value in options(entry)
    )
    if len(position) not in (2, 3) or not good:
        raise ValueError(f"should be [x, y] or [x, y, height], within {FARTHEST:g} m, and 0 to {_HIGHEST:g} m high")
    return position


@dataclasses.dataclass(frozen=True)
class Placement:
    """Where a thing stands."""

    base: tuple[float, float, float] = (0.0, 0.0, 0.0)  # middle of its lowest side in the world [m]
    yaw: float = 0.0  # its heading [rad]

    @property
    def quaternion(self) -> np.ndarray:
        """The heading as a quaternion (w, x, y, z), shape (4,)."""
        return rotations.from_yaw_pitch_roll(self.yaw, 0.0, 0.0)

    def above(self, height: float) -> list[float]:
        """Return the point at a height above the base, in the world [m]."""
        x, y, z = self.base
        return [x, y, z + height]

    def shifted(self, x: float, y: float, z: float, yaw: float) -> "Placement":
        """Return the placement of what stands at a point of this one's own axes [m], turned by a yaw [rad]."""
        forward, left = math.cos(self.yaw), math.sin(self.yaw)
        base = (self.base[0] + x * forward - y * left, self.base[1] + x * left + y * forward, self.base[2] + z)
        return Placement(base, self.yaw + yaw)


# Powers of the length with which figures grow at the same density: forces grow as masses, torques by one power more.
_LENGTHS = ("position", "size", "height", "radius", "boards", "handle", "travel", "cup_radius", "cup_height")
_POWERS: dict[str, int] = {name: 1 for name in _LENGTHS}
_POWERS |= {"mass": 3, "cup_mass": 3, "force": 3, "resistance": 3, "closer": 4}


@settings(kw_only=True)
class Thing:
    """One object of a scene; numbers and colours may be a `Uniform` or a `Choice`.

    Attributes:
        name: up to 63 letters, digits, - and _, beginning with a letter.
        position: x and y of the middle of its lowest side, and its height above what it stands on (0 if left out) [m];
            in the axes of what it stands on, from the middle of that surface.
        yaw: heading, relative to that of what it stands on [rad].
        on: name of the object on whose top it stands, or NAME/2 for the second board of a shelf; None for the ground.
        friction: coefficient of sliding friction.
        colour: "#rrggbb".
    """

    kind: ClassVar[str]  # by which a file names it: its class in lower case
    movable: ClassVar[bool] = False

    name: Annotated[str, AfterValidator(_name)]
    position: Annotated[tuple[Number, ...], AfterValidator(_position)] = (0.0, 0.0)
    yaw: Annotated[Number, between(-2.0 * math.pi, 2.0 * math.pi)] = 0.0
    on: str | None = None
    friction: Annotated[Number, between(LEAST_FRICTION, 5.0)] = 0.8
    colour: Colour = "#b9a58a"

    def __init_subclass__(cls, **more: Any) -> None:  # noqa: ANN401
        super().__init_subclass__(**more)
        cls.kind = vars(cls).get("kind", cls.__name__.lower())

    @property
    def label(self) -> str:
        """Its name in messages."""
        return f"{self.kind} '{self.name}'"

    @property
    def varies(self) -> bool:
        """Whether it differs from episode to episode."""
        return any(varies(getattr(self, field.name)) for field in dataclasses.fields(self))

    def draw(self, rng: np.random.Generator) -> Self:
        """Return it with every value drawn for one episode."""
        if not self.varies:
            return self
        values = {field.name: drawn(getattr(self, field.name), rng) for field in dataclasses.fields(self)}
        return dataclasses.replace(self, **values)

    def scaled(self, size: float) -> Self:
        """Return it with lengths times a factor, and as dense and as slippery as before."""
        powers = {field.name: _POWERS.get(field.name, 0) for field in dataclasses.fields(self)}
        values = {name: scaled(getattr(self, name), size**power) for name, power in powers.items() if power}
        return dataclasses.replace(self, **values)

    def surface(self, part: str | None) -> float:
        """Return the height above its base of a part, or of its top, where other things stand [m], once it is drawn."""
        raise SceneError(
            f"nothing can stand on {self.label}; use a table, shelf, step, box, cart or tray, or the ground"
        )

    def _only_top(self, part: str | None, height: float) -> float:
        if part is not None:
            raise SceneError(f"{self.label} has no part '{part}'; leave /{part} out")
        return height

    def body_names(self) -> tuple[str, ...]:
        """Return the names of the bodies that `build` makes; the first is that of the thing."""
        return (self.name,)

    def build(self, spec: mujoco.MjSpec, place: Placement) -> None:
        """Add its bodies to a model; it must have been drawn."""
        raise NotImplementedError

    def _body(self, spec: mujoco.MjSpec, place: Placement, height: float, name: str | None = None) -> Any:  # noqa: ANN401
        """Add a body whose origin is at a height above the base [m]."""
        body = spec.worldbody.add_body(name=name or self.name, pos=place.above(height))
        body.quat = place.quaternion
        return body

    def _geom(
        self,
        body: Any,  # noqa: ANN401  MuJoCo's body
        kind: mujoco.mjtGeom,
        size: Sequence[float],
        pos: Sequence[float] = (0.0, 0.0, 0.0),
        *,
        mass: float = 0.0,
        friction: float | None = None,
        rgb: str | None = None,
        **more: Any,  # noqa: ANN401  further fields of MuJoCo's geom
    ) -> None:
        """Add a shape that is drawn and collides; sizes are halves, as MuJoCo's."""
        movable, round_shape = self.movable, kind != mujoco.mjtGeom.mjGEOM_BOX
        fields: dict[str, Any] = {
            "contype": _TOUCHED,
            "conaffinity": _TOUCHES,
            "condim": 6 if movable and round_shape else 4 if movable else 3,
            "priority": MOVABLE_PRIORITY if movable else FIXED_PRIORITY,
            "group": _DRAWN_GROUP,
            "rgba": [*rgb_of(rgb or str(self.colour)), 1.0],
            **more,
        }
        if movable:
            fields.update(solref=[MOVABLE_TIME_CONSTANT, 1.0], solimp=[*MOVABLE_IMPEDANCE, 0.5, 2.0])
        friction = settled(self.friction) if friction is None else friction
        geom = body.add_geom(type=kind, size=[*size, *[0.0] * (3 - len(size))], pos=list(pos), **fields)
        geom.friction = [friction, _TORSION, _ROLLING]
        geom.mass = mass


def rgb_of(colour: str) -> tuple[float, float, float]:
    """Return red, green and blue of "#rrggbb", each in [0, 1]."""
    red, green, blue = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return red, green, blue


def darker(colour: str, share: float = 0.7) -> str:
    """Return a darker "#rrggbb", its brightness times a share."""
    return "#" + "".join(f"{round(255 * share * value):02x}" for value in rgb_of(colour))
