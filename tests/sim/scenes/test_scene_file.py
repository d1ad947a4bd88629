"""Scenes as YAML: what is read, and that every mistake names its line and column."""

import dataclasses
import pathlib
import re

import pytest

from hugwbc.errors import ConfigError, HugwbcError, UnknownNameError
from hugwbc.settings_file import parse
from hugwbc.sim.scenes import Box, Choice, Mjcf, Scene, Shelf, Table, Uniform, load_scene
from hugwbc.sim.scenes.scene import KINDS

PATH = pathlib.Path("scene.yaml")
HEAD = "objects:\n  - {kind: table, name: desk, position: [1, 0]}\n"
A_BOX, A_DOOR = HEAD + "  - {kind: box, name: ", HEAD + "  - {kind: door, name: exit"
BOX = A_BOX + "a, size: [1, 1, 1], "


def read(text: str) -> Scene:
    return parse(Scene, text, PATH)


def test_numbers_colours_and_supports_are_read() -> None:
    scene = read(
        """
about: A box on a table.
robot: h1
ground: firm
objects:
  - {kind: table, name: desk, position: [1, 0, 0], height: {uniform: [0.7, 0.95]}}
  - kind: box
    name: parcel
    on: desk
    size: [0.3, {choice: [0.2, 0.25]}, 0.2]
    mass: {uniform: [0.5, 3]}
    colour: {choice: ["#c8a165", "#7fa3c7"]}
  - {kind: shelf, name: rack, position: [3, 0], boards: [0.5, 1.0]}
"""
    )
    assert scene == Scene(
        (
            Table(name="desk", position=(1.0, 0.0, 0.0), height=Uniform(0.7, 0.95)),
            Box(
                name="parcel",
                on="desk",
                size=(0.3, Choice((0.2, 0.25)), 0.2),
                mass=Uniform(0.5, 3.0),
                colour=Choice(("#c8a165", "#7fa3c7")),
            ),
            Shelf(name="rack", position=(3.0, 0.0), boards=(0.5, 1.0)),
        ),
        robot="h1",
        ground="firm",
        about="A box on a table.",
    )


def test_anchors_repeat_parts() -> None:
    scene = read(
        "objects:\n  - {kind: box, name: a, position: [1, 0], size: &s [0.1, 0.1, 0.1]}\n"
        "  - {kind: box, name: b, position: [2, 0], size: *s}\n"
    )
    assert scene.objects[0].size == scene.objects[1].size == (0.1, 0.1, 0.1)


def test_a_file_of_mjcf_is_found_beside_the_scene(tmp_path: pathlib.Path) -> None:
    (tmp_path / "k.xml").write_text('<mujoco><worldbody><body name="a"><geom size="0.1"/></body></worldbody></mujoco>')
    scene = parse(
        Scene, "objects:\n  - {name: kitchen, mjcf: k.xml, position: [2, 3], yaw: 1.57}\n", tmp_path / "s.yaml"
    )
    assert scene.objects == (Mjcf(name="kitchen", mjcf=tmp_path / "k.xml", position=(2.0, 3.0), yaw=1.57),)


@pytest.mark.parametrize(
    ("text", "place", "message"),
    [
        ("", "1:1", "objects is missing"),
        ("objects: 3", "1:1", "list"),
        ("- a", "1:1", "fields of a Scene"),
        ("about: x", "1:1", "objects is missing"),
        ("objects: [a", "1:12", "not valid YAML"),
        (HEAD + "robots: h1", "3:1", "unknown Scene field 'robots'. Did you mean 'robot'"),
        (HEAD + "robot: h2", "3:1", "unknown robot 'h2'. Valid: h1, h1-2023."),
        (HEAD + "ground: wet", "3:1", "unknown ground 'wet'. Valid: firm, soft"),
        (HEAD + "objects: [a]", "3:1", "twice"),
        (HEAD + "  - box", "3:5", "kind (or mjcf)"),
        (HEAD + "  - {name: a}", "3:5", "kind"),
        (HEAD + "  - {kind: bax, name: a}", "3:6", "unknown kind of object 'bax'. Did you mean 'box'"),
        (A_BOX + "a}", "3:5", "size is missing"),
        (HEAD + "  - {kind: box, size: [1, 1, 1]}", "3:5", "name is missing"),
        (A_DOOR + "}", "3:5", "hinge is missing"),
        (A_DOOR + ", hinge: up}", "3:30", "'up'. Valid: left, right"),
        (A_BOX + "a, size: [1, 1]}", "3:26", "size.2 is missing"),
        (A_BOX + "a, size: 1}", "3:26", "list"),
        (A_BOX + "a, size: [1, 1, x]}", "3:39", "number"),
        (BOX + "mass: 0}", "3:43", "0.001 to 500"),
        (BOX + "mass: [1]}", "3:43", "uniform"),
        (BOX + "mass: nan}", "3:43", "number"),
        (BOX + "mass: heavy}", "3:43", "number"),
        (BOX + "wheels: 4}", "3:43", "unknown Box field 'wheels'"),
        (BOX + "mass: {normal: [1, 2]}}", "3:43", "{uniform: [low, high]}"),
        (BOX + "mass: {uniform: [1]}}", "3:43", "{uniform: [low, high]}"),
        (BOX + "mass: {uniform: [2, 1]}}", "3:43", "the smaller one first"),
        (BOX + "mass: {}}", "3:43", "{choice: [a, b]}"),
        (BOX + "colour: {uniform: [1, 2]}}", "3:43", "#rrggbb"),
        (BOX + "colour: red}", "3:43", "#rrggbb"),
        (A_BOX + "desk, size: [1, 1, 1], position: [4, 0]}", "3:5", "another object has that name"),
        (A_BOX + "floor, size: [1, 1, 1], position: [4, 0]}", "3:5", "a part of the robot"),
        (A_BOX + "a, size: [0.1, 0.1, 0.1], on: dask}", "3:5", "Did you mean 'desk'"),
        (BOX + "position: [1, 0]}", "3:5", "overlap by"),
        (HEAD + "  - {name: k, mjcf: none.xml}", "3:15", "there is no file none.xml"),
        (HEAD + "  - {name: k, mjcf: none.xml, size: 3}", "3:31", "unknown Mjcf field 'size'"),
    ],
)  # fmt: skip
def test_a_mistake_names_its_place(text: str, place: str, message: str) -> None:
    with pytest.raises(ConfigError, match=rf"^scene\.yaml:{place}: .*{re.escape(message)}"):
        read(text)


def test_a_name_or_a_file_is_loaded(tmp_path: pathlib.Path) -> None:
    assert {thing.name for thing in load_scene("parcel").objects} == {"desk", "parcel", "bench"}
    with pytest.raises(UnknownNameError, match=r"unknown scene 'parcle'\. Did you mean 'parcel'"):
        load_scene("parcle")
    with pytest.raises(ConfigError, match="cannot read"):
        load_scene(tmp_path / "none.yaml")


BROKEN = ("", "[", "{", ": 3", "- 1", "-1e3", ".inf", "[[1]]", "{a: b}", "1e999", "null", "~", "'", "0x", "a b", "é",
          "nan", "[1, 2, 3, 4, 5]", "{uniform: [1]}", "{uniform: [2, 1]}", "{choice: []}")  # fmt: skip
NEEDED = {"box": {"size": "[0.1, 0.2, 0.3]"}, "cylinder": {"radius": "0.1", "height": "0.2"}, "door": {"hinge": "left"}}


@pytest.mark.parametrize("kind", KINDS)
def test_broken_values_give_clear_errors(kind: str) -> None:
    """Every broken value of every field of every kind is refused with its place, or is a valid value after all."""
    fields = [field.name for field in dataclasses.fields(KINDS[kind])]
    cases = refused = 0
    for field in ("kind", *fields):
        for broken in BROKEN:
            values = {"kind": kind, "name": "a", "position": "[3, 1]", **NEEDED.get(kind, {}), field: broken}
            text = "objects:\n  - " + "\n    ".join(f"{key}: {value}" for key, value in values.items()) + "\n"
            cases += 1
            try:
                read(text)
            except HugwbcError as error:
                refused += 1
                assert re.match(r"scene\.yaml:\d+:\d+: \S", str(error)), (text, str(error))
    assert cases > 150 and refused > 0.9 * cases
