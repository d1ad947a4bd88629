"""Things that move freely: boxes, cylinders, carts, and trays with a cup."""

from typing import Annotated, Any, ClassVar

import mujoco

from hugwbc.settings import settings
from hugwbc.sim.scenes.thing import Placement, Thing, darker
from hugwbc.sim.scenes.varied import Length, Mass, Number, between, settled

_BOX, _CYLINDER = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER
_SPHERE = mujoco.mjtGeom.mjGEOM_SPHERE
_Side = Annotated[Number, between(0.2, 10.0)]  # [m], of a cart
_Edge = Annotated[Number, between(0.05, 10.0)]  # [m], of a tray


@settings(kw_only=True)
class Movable(Thing):
    """A thing that moves freely."""

    movable: ClassVar[bool] = True

    mass: Mass = 1.0  # of the whole thing, a tray's without the cup [kg]

    def _free(self, spec: mujoco.MjSpec, place: Placement, height: float, name: str | None = None) -> Any:  # noqa: ANN401
        body = self._body(spec, place, height, name)
        body.add_freejoint(name=name or self.name)
        return body


@settings(kw_only=True)
class Box(Movable):
    """A box; its pose is that of its centre.

    Attributes:
        size: length along x, width along y, and height [m].
    """

    size: tuple[Length, Length, Length]

    def surface(self, part: str | None) -> float:  # noqa: D102
        return self._only_top(part, settled(self.size[2]))

    def build(self, spec: mujoco.MjSpec, place: Placement) -> None:  # noqa: D102
        half = [settled(value) / 2 for value in self.size]
        self._geom(self._free(spec, place, half[2]), _BOX, half, mass=settled(self.mass))


@settings(kw_only=True)
class Cylinder(Movable):
    """An upright cylinder; its pose is that of its centre.

    Attributes:
        radius: [m].
        height: [m].
    """

    radius: Length
    height: Length

    def surface(self, part: str | None) -> float:  # noqa: D102
        return self._only_top(part, settled(self.height))

    def build(self, spec: mujoco.MjSpec, place: Placement) -> None:  # noqa: D102
        half = settled(self.height) / 2
        body = self._free(spec, place, half)
        self._geom(body, _CYLINDER, [settled(self.radius), half], mass=settled(self.mass))


@settings(kw_only=True)
class Cart(Movable):
    """A platform on four castors with a handle across its rear end (-x); its pose is that of the platform's centre.

    A castor is a ball that slides with the friction of rolling, the same in every direction: it has no axle to turn
    first.

    Attributes:
        size: length along x, width along y, and height of the platform's top [m].
        handle: height of the handle above the ground, at least 0.1 m above the platform's top [m].
        rolling: rolling resistance, as a coefficient of friction.
    """

    size: tuple[_Side, _Side, Annotated[Number, between(0.15, 2.0)]] = (0.8, 0.5, 0.25)
    mass: Mass = 20.0
    handle: Annotated[Number, between(0.3, 2.0)] = 1.0
    rolling: Annotated[Number, between(0.0, 1.0)] = 0.02

    def surface(self, part: str | None) -> float:  # noqa: D102
        return self._only_top(part, settled(self.size[2]))

    def build(self, spec: mujoco.MjSpec, place: Placement) -> None:  # noqa: D102
        length, width, top = (settled(value) for value in self.size)
        mass, handle = settled(self.mass), max(settled(self.handle), top + 0.1)
        board, radius, post = 0.03, 0.05, 0.015
        body = self._free(spec, place, top - board / 2)
        ground = board / 2 - top  # height of the ground in the body's axes
        metal = darker(str(self.colour))
        self._geom(body, _BOX, [length / 2, width / 2, board / 2], mass=0.7 * mass)
        for x in (-length / 2 + radius, length / 2 - radius):
            for y in (-width / 2 + radius, width / 2 - radius):
                rolling, dark = settled(self.rolling), "#2b2d31"
                wheel = [x, y, ground + radius]
                self._geom(body, _SPHERE, [radius], wheel, mass=0.02 * mass, friction=rolling, rgb=dark, condim=3)
                gap = -ground - board / 2 - 2 * radius  # between wheel and board
                fork = [x, y, ground + 2 * radius + gap / 2]
                self._geom(body, _BOX, [0.015, 0.015, gap / 2], fork, mass=0.01 * mass, rgb=metal)
        bar, rear = ground + handle, -length / 2
        for side in (-1, 1):
            middle = [rear, side * (width / 2 - post), (bar + board / 2) / 2]
            self._geom(body, _BOX, [post, post, (bar - board / 2) / 2], middle, mass=0.06 * mass, rgb=metal)
        self._geom(body, _BOX, [post, width / 2, post], [rear, 0.0, bar], mass=0.06 * mass, rgb=metal)


@settings(kw_only=True)
class Tray(Movable):
    """A tray with a rim, and a cup that stands freely on its middle, as a thing of its own: NAME/cup.

    The tray's pose is that of the middle of its plate, the cup's that of its centre.

    Attributes:
        size: length along x, width along y, and thickness of the plate [m].
        cup_radius, cup_height: [m].
        cup_mass: [kg].
    """

    size: tuple[_Edge, _Edge, Length] = (0.35, 0.45, 0.012)
    mass: Mass = 0.6
    cup_radius: Annotated[Number, between(0.001, 0.2)] = 0.032
    cup_height: Annotated[Number, between(0.001, 0.5)] = 0.13
    cup_mass: Mass = 0.25

    def surface(self, part: str | None) -> float:  # noqa: D102
        return self._only_top(part, settled(self.size[2]))

    def body_names(self) -> tuple[str, ...]:  # noqa: D102
        return self.name, f"{self.name}/cup"

    def build(self, spec: mujoco.MjSpec, place: Placement) -> None:  # noqa: D102
        length, width, thick = (settled(value) for value in self.size)
        mass, rim, edge = settled(self.mass), 0.02, 0.008
        body = self._free(spec, place, thick / 2)
        self._geom(body, _BOX, [length / 2, width / 2, thick / 2], mass=0.8 * mass)
        colour = darker(str(self.colour), 0.85)
        for side in (-1, 1):
            for half, at in (
                ([edge / 2, width / 2, rim / 2], [side * (length - edge) / 2, 0.0, (thick + rim) / 2]),
                ([length / 2 - edge, edge / 2, rim / 2], [0.0, side * (width - edge) / 2, (thick + rim) / 2]),
            ):
                self._geom(body, _BOX, half, at, mass=0.05 * mass, rgb=colour)
        half = settled(self.cup_height) / 2
        cup = self._free(spec, place, thick + half, f"{self.name}/cup")
        self._geom(cup, _CYLINDER, [settled(self.cup_radius), half], mass=settled(self.cup_mass), rgb="#f2f2ee")
