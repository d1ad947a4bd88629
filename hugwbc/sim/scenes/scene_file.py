"""Scenes as YAML files; errors name the line and the column that are wrong.

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
import os.path
import pathlib
from typing import Any

import yaml

from hugwbc.errors import SceneError
from hugwbc.robot import robot_names
from hugwbc.sim.ground import GROUNDS
from hugwbc.sim.scenes import furniture, jointed, movable
from hugwbc.sim.scenes.mjcf_file import Mjcf
from hugwbc.sim.scenes.scene import MOST_OBJECTS, Scene
from hugwbc.sim.scenes.thing import Thing
from hugwbc.sim.scenes.varied import Choice, Uniform
from hugwbc.yaml_file import Read, YamlReader, shipped_names, yaml_path

FOLDER = pathlib.Path(__file__).parent
SCENE_NAMES = shipped_names(FOLDER)
KINDS: dict[str, type[Thing]] = {
    cls.kind: cls
    for cls in (
        movable.Box, movable.Cylinder, furniture.Table, furniture.Shelf, movable.Cart, jointed.Door, jointed.Drawer,
        jointed.Button, movable.Tray, furniture.Wall, furniture.Step,
    )
}  # fmt: skip
_HINT = "write `objects:` and below it a list, each with kind and name"


def load_scene(name: str | pathlib.Path) -> Scene:
    """Load a shipped scene by name, or a scene from a YAML file.

    Args:
        name: one of `SCENE_NAMES`, or the path of a file that ends in .yaml or .yml.

    Raises:
        UnknownNameError: if no shipped scene has that name.
        SceneError: if the file cannot be read or is not a valid scene; it names line and column.
    """
    return read_scene(yaml_path("scene", name, FOLDER))


def read_scene(path: pathlib.Path) -> Scene:
    """Read a scene from a YAML file.

    Raises:
        SceneError: if the file cannot be read or is not a valid scene; it names line and column.
    """
    reader = _Reader(path, SceneError)
    return reader.scene(reader.load("scene", _HINT))


def parse_scene(text: str, path: pathlib.Path) -> Scene:
    """Parse a scene from YAML text.

    Args:
        text: the YAML text.
        path: path that stands in the messages, and whose folder is the base of relative paths.

    Raises:
        SceneError: if the text is not a valid scene; it names line and column.
    """
    reader = _Reader(path, SceneError)
    return reader.scene(reader.compose(text, _HINT))


class _Reader(YamlReader):
    """A reader that turns YAML nodes into parts of a scene."""

    def scene(self, root: yaml.Node) -> Scene:
        readers: dict[str, Read] = {
            "about": _Reader.text,
            "robot": lambda reader, node: reader.one_of(node, "robot", robot_names()),
            "ground": lambda reader, node: reader.one_of(node, "ground", GROUNDS),
            "objects": _Reader.nodes,
        }
        fields = self.fields(root, "scene", readers, required=("objects",))
        nodes = fields.pop("objects")
        if len(nodes) > MOST_OBJECTS:
            self.fail(nodes[MOST_OBJECTS], f"there are {len(nodes)} objects; give {MOST_OBJECTS} or fewer")
        things = tuple(self.thing(node) for node in nodes)
        return Scene(things, places=tuple(self.place(node) for node in nodes), **fields)

    def thing(self, node: yaml.Node) -> Thing:
        if not isinstance(node, yaml.MappingNode):
            self.fail(node, "expected an object with fields: kind (or mjcf), name, position and others")
        keys = {key.value: value for key, value in node.value if isinstance(key, yaml.ScalarNode)}
        if "mjcf" in keys:
            return self._made(node, Mjcf, {})
        if "kind" not in keys:
            self.fail(node, f"object field 'kind' is missing; give one of {', '.join(KINDS)}, or mjcf: FILE")
        cls = KINDS[self.one_of(keys["kind"], "kind of object", KINDS)]
        return self._made(node, cls, {"kind": _Reader.text})

    def _made(self, node: yaml.Node, cls: type[Thing], more: dict[str, Read]) -> Thing:
        fields = dataclasses.fields(cls)
        readers = {**more, **{field.name: _reader_of(field) for field in fields}}
        required = [field.name for field in fields if field.default is dataclasses.MISSING]
        values = self.fields(node, cls.kind, readers, required=required)
        values.pop("kind", None)
        return self.checked(node, cls, **values)

    def file(self, node: yaml.Node) -> pathlib.Path:
        path = self.path.parent / self.text(node)
        if not os.path.isfile(path):  # unlike pathlib, it takes any text
            self.fail(node, f"there is no file {path}; paths are relative to the scene's folder")
        return path

    def varied(self, node: yaml.Node) -> float | Uniform | Choice:
        return self._varied(node, _Reader.number)

    def colour(self, node: yaml.Node) -> str | Choice:
        return self._varied(node, _Reader.text)

    def numbers(self, node: yaml.Node) -> tuple[float | Uniform | Choice, ...]:
        return tuple(self.varied(entry) for entry in self.nodes(node))

    def _varied(self, node: yaml.Node, read: Any) -> Any:  # noqa: ANN401  what `read` returns, or its variation
        if isinstance(node, yaml.SequenceNode):
            self.fail(node, "expected one value, or its variation, such as {uniform: [0.5, 3]}")
        if not isinstance(node, yaml.MappingNode):
            return read(self, node)
        names = ("uniform", "choice") if read is _Reader.number else ("choice",)
        ways: dict[str, Read] = dict.fromkeys(names, _Reader.nodes)
        found = self.fields(node, "variation", ways)
        if len(found) != 1:
            self.fail(node, f"a variation is one of {', '.join(ways)}; give one, such as {{choice: [1, 2]}}")
        ((way, nodes),) = found.items()
        values = tuple(read(self, entry) for entry in nodes)
        if way == "choice":
            return self.checked(node, Choice, values)
        if len(values) != 2:
            self.fail(node, f"uniform has {len(values)} numbers; give the smallest and the largest")
        return self.checked(node, Uniform, *values)


def _reader_of(field: "dataclasses.Field[Any]") -> Read:
    """Return the reader for a field of a thing, by its type."""
    if "tuple" in str(field.type):
        return _Reader.numbers
    if field.name == "colour":
        return _Reader.colour
    if field.name == "mjcf":
        return _Reader.file
    return _Reader.text if field.name in ("name", "on", "hinge") else _Reader.varied
