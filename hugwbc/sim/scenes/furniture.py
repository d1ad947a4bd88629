"""Things that stand still: tables, shelves, walls and steps; the pose of each is that of its lowest side's middle."""

import itertools
from typing import Annotated

import mujoco
from pydantic import Field

from hugwbc.errors import SceneError
from hugwbc.settings import settings
from hugwbc.sim.scenes.thing import Placement, Thing, darker
from hugwbc.sim.scenes.varied import Colour, Length, Number, between, options, settled

_BOX = mujoco.mjtGeom.mjGEOM_BOX
_BOARD = 0.03  # [m], thickness of table tops and boards
_Long = Annotated[Number, between(0.001, 50.0)]  # [m]


@settings(kw_only=True)
class Table(Thing):
    """A table with four legs.

    Attributes:
        size: length along x and width along y of its top [m].
        height: of its top [m].
    """

    size: tuple[Length, Length] = (0.6, 1.0)
    height: Annotated[Number, between(0.1, 3.0)] = 0.8

    def surface(self, part: str | None) -> float:  # noqa: D102
        return self._only_top(part, settled(self.height))

    def build(self, spec: mujoco.MjSpec, place: Placement) -> None:  # noqa: D102
        length, width = (settled(value) for value in self.size)
        height, leg = settled(self.height), min(0.025, length / 4, width / 4)
        body = self._body(spec, place, 0.0)
        self._geom(body, _BOX, [length / 2, width / 2, _BOARD / 2], [0.0, 0.0, height - _BOARD / 2])
        long = (height - _BOARD) / 2
        for x in (-length / 2 + leg, length / 2 - leg):
            for y in (-width / 2 + leg, width / 2 - leg):
                self._geom(body, _BOX, [leg, leg, long], [x, y, long], rgb=darker(str(self.colour)))


@settings(kw_only=True)
class Shelf(Thing):
    """A shelf with boards, two sides and a back; it opens towards -x.

    Attributes:
        size: depth along x and width along y [m].
        boards: heights of the boards' upper sides, from below [m]; things stand `on: NAME/1`, `on: NAME/2` and so on.
    """

    size: tuple[Length, Length] = (0.35, 0.8)
    boards: Annotated[tuple[Annotated[Number, between(_BOARD, 3.0)], ...], Field(min_length=1)] = (0.4, 0.8, 1.2)

    def __post_init__(self) -> None:
        for low, high in itertools.pairwise(self.boards):
            if max(options(low)) + _BOARD >= min(options(high)):
                message = f"boards of {self.label} are not in ascending order; give the lowest first"
                raise SceneError(message, at=("boards",))

    def surface(self, part: str | None) -> float:  # noqa: D102
        count = len(self.boards)
        if part is not None and part not in [str(number) for number in range(1, count + 1)]:
            raise SceneError(f"{self.label} has no board '{part}'; give {self.name}/1 to {self.name}/{count}")
        return settled(self.boards[count - 1 if part is None else int(part) - 1])

    def build(self, spec: mujoco.MjSpec, place: Placement) -> None:  # noqa: D102
        depth, width = (settled(value) for value in self.size)
        body, side, top = self._body(spec, place, 0.0), 0.01, settled(self.boards[-1])
        for board in self.boards:
            at = [0.0, 0.0, settled(board) - _BOARD / 2]
            self._geom(body, _BOX, [depth / 2, width / 2, _BOARD / 2], at)
        dark = darker(str(self.colour), 0.85)
        for end in (-1, 1):
            at = [0.0, end * (width / 2 + side), top / 2]
            self._geom(body, _BOX, [depth / 2, side, top / 2], at, rgb=dark)
        self._geom(body, _BOX, [0.005, width / 2 + 2 * side, top / 2], [depth / 2 + 0.005, 0.0, top / 2], rgb=dark)


@settings(kw_only=True)
class _Block(Thing):
    """A solid block."""

    size: tuple[_Long, _Long, _Long]

    def build(self, spec: mujoco.MjSpec, place: Placement) -> None:
        half = [settled(value) / 2 for value in self.size]
        self._geom(self._body(spec, place, 0.0), _BOX, half, [0.0, 0.0, half[2]])


@settings(kw_only=True)
class Wall(_Block):
    """A wall.

    Attributes:
        size: thickness along x, length along y, and height [m].
    """

    size: tuple[_Long, _Long, _Long] = (0.1, 3.0, 2.5)
    colour: Colour = "#d9dce0"


@settings(kw_only=True)
class Step(_Block):
    """A step, stool or platform: a solid block that stands still.

    Attributes:
        size: length along x, width along y, and height [m].
    """

    size: tuple[Length, Length, Length] = (0.6, 1.0, 0.15)
    colour: Colour = "#9aa3ad"

    def surface(self, part: str | None) -> float:  # noqa: D102
        return self._only_top(part, settled(self.size[2]))
