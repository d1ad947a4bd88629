"""A scene: the objects around a robot, and how they differ from episode to episode, declared here or in a YAML file.

    about: A box on a table, and a door to push open.
    robot: h1                     # optional, like ground: the arena's
    ground: firm
    objects:
      - {kind: table, name: desk, position: [0.9, 0], height: {uniform: [0.7, 0.95]}}
      - kind: box
        name: parcel
        on: desk                  # position and yaw are then relative to the middle of its top
        position: [-0.1, 0]
        size: [0.3, 0.25, 0.2]
        mass: {uniform: [0.5, 3]}
        colour: {choice: ["#c8a165", "#7fa3c7"]}
      - {kind: door, name: exit, hinge: left, position: [3, 0], closer: {uniform: [5, 15]}}
      - {name: kitchen, mjcf: my_kitchen.xml, position: [2, 3], yaw: 1.57}

The kinds are the classes of `sim.scenes`, with their fields. Every number may be `{uniform: [low, high]}` or
`{choice: [a, b]}`, every colour a choice. Paths of MJCF files are relative to the scene. YAML anchors may repeat parts.
"""

import dataclasses
import functools
import itertools
import pathlib
import zlib
from collections.abc import Iterator, Mapping
from typing import Annotated

import mujoco
import numpy as np
from pydantic import Field, PlainValidator, TypeAdapter, ValidationInfo

from hugwbc.errors import ConfigError, SceneError, UnknownNameError
from hugwbc.robot import RobotName
from hugwbc.robot_tables import robot_names, robot_table
from hugwbc.settings import one_of, refusing, settings
from hugwbc.settings_file import load, named_path, shipped_names
from hugwbc.sim.scenes import furniture, jointed, movable
from hugwbc.sim.scenes.mjcf_file import Mjcf
from hugwbc.sim.scenes.thing import Placement, Thing
from hugwbc.sim.scenes.varied import settled
from hugwbc.sim.terrain import GROUNDS, HeightField
from hugwbc.targets import HAND_FRAMES

OVERLAP = 0.001  # [m]; objects that are deeper than this in each other at the start are refused
_GAP = 0.005  # [m]; an object that is farther than this from the one that it should stand on is refused
MOST_OBJECTS = 200  # each is compared with each
KINDS: dict[str, type[Thing]] = {
    cls.kind: cls
    for cls in (
        movable.Box, movable.Cylinder, furniture.Table, furniture.Shelf, movable.Cart, jointed.Door, jointed.Drawer,
        jointed.Button, movable.Tray, furniture.Wall, furniture.Step, Mjcf,
    )
}  # fmt: skip
"""The kinds that a scene's file may name."""
_FOLDER = pathlib.Path(__file__).parent
SCENE_NAMES = shipped_names(_FOLDER)
_FLOOR = "floor"


def _thing(value: object, info: ValidationInfo) -> Thing:
    """Return an object, given as such or declared by its kind and fields."""
    if isinstance(value, Thing):
        return value
    if not isinstance(value, Mapping):
        raise ConfigError("expected an object with fields: kind (or mjcf), name, position and others")
    kind = str(value.get("kind", "mjcf" if "mjcf" in value else ""))
    if kind not in KINDS:
        raise UnknownNameError("kind of object", kind, KINDS, at=("kind",))
    fields = {name: field for name, field in value.items() if name != "kind"}
    return TypeAdapter(KINDS[kind]).validate_python(fields, context=info.context)


_Declared = Annotated[Thing, PlainValidator(refusing(_thing))]


@settings
class Scene:
    """The objects around a robot.

    Attributes:
        objects: what stands or lies there.
        robot: name of the robot that the scene is made for; None for any.
        ground: "firm" or "soft"; None for any.
        about: what the scene is for.
    """

    objects: Annotated[tuple[_Declared, ...], Field(max_length=MOST_OBJECTS)]
    robot: RobotName | None = None
    ground: Annotated[str, one_of("ground", lambda: GROUNDS)] | None = None
    about: str = ""

    def __post_init__(self) -> None:
        for index, problem in self._problems():
            raise SceneError(f"{self.objects[index].label}: {problem}", at=("objects", index))
        if not self.varies:
            self._check_overlap()

    def _problems(self) -> Iterator[tuple[int, str]]:
        """Yield what is wrong with the names and supports of the objects, each with the index of the object."""
        names = [thing.name for thing in self.objects]
        taken = {_FLOOR, *HAND_FRAMES, *_robot_parts()}
        for index, thing in enumerate(self.objects):
            if thing.name in names[:index]:
                yield index, "another object has that name; give each its own"
            elif thing.name in taken:
                yield index, "a part of the robot, the ground or a frame has that name; choose another"
            if thing.on is not None:
                support = thing.on.partition("/")[0]
                if support not in names:
                    others = [name for name in names if name != thing.name]
                    yield index, str(UnknownNameError("thing to stand on", support, others))
                elif thing.name in self._below(thing):
                    yield index, "it stands on itself, directly or through others; let one of them stand on the ground"
                else:
                    try:
                        self._level_on(thing.on, np.random.default_rng(0))
                    except SceneError as error:
                        yield index, str(error)

    def _below(self, thing: Thing) -> list[str]:
        """Return the names of an object's supports, from top to bottom, up to the first repetition."""
        by_name, found = {other.name: other for other in self.objects}, []
        on = thing.on
        while on is not None and (name := on.partition("/")[0]) in by_name and name not in found:
            found.append(name)
            on = by_name[name].on
        return found

    @property
    def varies(self) -> bool:
        """Whether episodes of it differ."""
        return any(thing.varies for thing in self.objects)

    def draw(self, seed: int) -> "Scene":
        """Return the scene of the episode of a seed, 0 or more, without variation.

        What is drawn for an object depends on the seed and its name alone: others may come and go.
        """
        if not self.varies:
            return self
        objects = [thing.draw(np.random.default_rng([seed, zlib.crc32(thing.name.encode())])) for thing in self.objects]
        try:
            return dataclasses.replace(self, objects=tuple(objects))
        except SceneError as error:
            raise SceneError(f"{error} (as drawn with seed {seed})") from error

    def scaled(self, size: float) -> "Scene":
        """Return the scene with all lengths times a factor and the same densities, for a robot of that size."""
        objects = self.objects if size == 1.0 else tuple(thing.scaled(size) for thing in self.objects)
        return dataclasses.replace(self, objects=objects)

    @property
    def body_names(self) -> tuple[str, ...]:
        """Names of the bodies of all objects; the first of an object made here is its name (`Thing.body_names`)."""
        return tuple(name for thing in self.objects for name in thing.body_names())

    def add_to(self, spec: mujoco.MjSpec, terrain: HeightField | None = None) -> None:
        """Add the objects to a model, after what is in it, on a terrain or on a plane at z = 0."""
        for thing in self.objects:
            thing.build(spec, self._placement(thing, terrain))

    def _placement(self, thing: Thing, terrain: HeightField | None) -> Placement:
        x, y, *lift = (settled(value) for value in thing.position)
        if thing.on is None:
            support, level = Placement(), 0.0 if terrain is None else float(terrain.height_at(np.array([x, y])))
        else:
            below = next(other for other in self.objects if other.name == thing.on.partition("/")[0])
            support, level = self._placement(below, terrain), self._level_on(thing.on)
        return support.shifted(x, y, level + sum(lift), settled(thing.yaw))

    def _level_on(self, on: str, rng: np.random.Generator | None = None) -> float:
        """Return the height of "NAME" or "NAME/PART" above the base of NAME [m]; with `rng`, NAME is drawn first."""
        name, _, part = on.partition("/")
        below = next(other for other in self.objects if other.name == name)
        return (below if rng is None else below.draw(rng)).surface(part or None)

    def model(self, *, ground: bool = False) -> mujoco.MjModel:
        """Compile the objects, alone or on level ground, for checks and pictures; they must have been drawn."""
        spec = mujoco.MjSpec()
        spec.compiler.degree = False
        if ground:
            spec.worldbody.add_geom(name=_FLOOR, type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 0.05])
        self.add_to(spec)
        return compiled(spec)

    def _check_overlap(self) -> None:
        model = self.model(ground=True)
        data = mujoco.MjData(model)
        mujoco.mj_fwdPosition(model, data)
        self._check_ground(model, data)
        geoms = [_geoms(model, thing) for thing in self.objects]
        for first, second in itertools.combinations(range(len(self.objects)), 2):
            one, other = self.objects[first], self.objects[second]
            if one.kind == other.kind == "wall":  # corners
                continue
            depth = _depth(model, data, geoms[first], geoms[second])
            if depth > OVERLAP:
                how = f"overlap by {1e3 * depth:.0f} mm at the start; move one of them"
                raise SceneError(f"{one.label} and {other.label} {how}", at=("objects", second))
        names = [thing.name for thing in self.objects]
        for index, thing in enumerate(self.objects):
            if thing.on is None or isinstance(thing, Mjcf) or sum(settled(value) for value in thing.position[2:]) > 0.0:
                continue
            below = geoms[names.index(thing.on.partition("/")[0])]
            pairs = itertools.product(geoms[index], below)
            if not any(mujoco.mj_geomDistance(model, data, *pair, 1.0, None) < _GAP for pair in pairs):
                how = "does not touch it; give a position relative to the middle of its top"
                raise SceneError(f"{thing.label} on '{thing.on}' {how}", at=("objects", index))

    def _check_ground(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Refuse what can move and is in the ground, which is taken as level at each object, also on a terrain."""
        floor = model.geom(_FLOOR).id
        for (one, other), distance in zip(data.contact.geom.tolist(), data.contact.dist.tolist(), strict=True):
            if floor in (one, other) and distance < -OVERLAP:
                body = model.body(int(model.geom_bodyid[one if other == floor else other])).name
                index = next(i for i, thing in enumerate(self.objects) if body in thing.body_names())
                how = f"is {-1e3 * distance:.0f} mm deep in the ground at the start; raise it"
                raise SceneError(f"object '{body}' {how}", at=("objects", index))


def compiled(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile what holds the objects of a scene."""
    try:
        return spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise SceneError(f"MuJoCo refuses the scene: {' '.join(str(error).split())}") from error


@functools.cache
def _robot_parts() -> set[str]:
    parts = {part["name"] for name in robot_names() for kind in ("links", "joints") for part in robot_table(name)[kind]}
    return parts | {"terrain", "footing", "root"}


def _geoms(model: mujoco.MjModel, thing: Thing) -> list[int]:
    """Return the geoms of an object that collide."""
    names = set(thing.body_names())
    solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    return [g for g in range(model.ngeom) if solid[g] and model.body(int(model.geom_bodyid[g])).name in names]


def _depth(model: mujoco.MjModel, data: mujoco.MjData, ones: list[int], others: list[int]) -> float:
    """Return how deep any of some geoms is in any of others, at least 0 [m]."""
    deepest = 0.0
    for one, other in itertools.product(ones, others):
        apart = float(np.linalg.norm(data.geom_xpos[one] - data.geom_xpos[other]))
        if apart < model.geom_rbound[one] + model.geom_rbound[other]:
            deepest = max(deepest, -mujoco.mj_geomDistance(model, data, one, other, 1.0, None))
    return deepest


def load_scene(name: str | pathlib.Path) -> Scene:
    """Load a shipped scene, one of `SCENE_NAMES`, or a scene from a path that ends in .yaml or .yml."""
    return load(Scene, named_path("scene", name, _FOLDER))
