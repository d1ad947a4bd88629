"""Scenes as YAML: what is read, and what a hostile user writes: refused with line and column, or simulated well."""

import dataclasses
import pathlib
import re

import numpy as np
import pytest

from hugwbc import JointCommand, load_robot
from hugwbc.errors import ConfigError, HugwbcError, SceneError, UnknownNameError
from hugwbc.settings_file import parse
from hugwbc.sim import Simulation
from hugwbc.sim.scenes import Box, Choice, Mjcf, Scene, Shelf, Table, Uniform, load_scene
from hugwbc.sim.scenes.scene import KINDS

PATH = pathlib.Path("scene.yaml")
PLACE = re.compile(r"scene\.yaml:(\d+):(\d+): \S")
DESK = "objects:\n  - {kind: table, name: desk, position: [2, 0]}\n"
HOLD = JointCommand.position(load_robot(), load_robot().nominal)
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
        (HEAD + "robots: h1", "3:1", "unknown Scene field 'robots'. Did you mean 'robot'"),
        (HEAD + "robot: h2", "3:1", "unknown robot 'h2'. Valid: h1, h1-2023, g1, the path"),
        (HEAD + "ground: wet", "3:1", "unknown ground 'wet'. Valid: firm, soft"),
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


OBJECTS = (
    "[box]", "", "{kind: , name: a}", "{kind: [box], name: a}",
    "{kind: mjcf, name: a}", "{Kind: box, name: a}", "{kind: box, nam: a, size: [1, 1, 1]}",
    "{kind: box, name: a, size: [1, 1, 1], movable: false}", "{kind: door, name: a, position: [5, 0]}",
    "{kind: door, name: a, position: [5, 0], hinge: }",
    "{kind: door, name: a, position: [5, 0], hinge: {choice: [left]}}", "{name: a, mjcf: none.xml}",
    "{name: a, mjcf: .}", "{name: a, mjcf: /dev/zero}", '{name: a, mjcf: "a\\0b"}', "{name: a, mjcf: [b]}",
    "{name: a, mjcf: /etc/passwd}", "{mjcf: scene.yaml}", "{name: a, mjcf: " + "a" * 5000 + "}",
    *(f"{{kind: box, name: {name}, size: [0.2, 0.2, 0.2], position: [4, 0]}}"
      for name in ("desk", "pelvis", "left_elbow_link", "left_elbow_joint", "torso_link", "world", "floor", "terrain",
                   "heading", "5", "null", "''", "a b", "a/b", "..", "käse", "[a]", "a" * 100, '"\\e[1m"', '"a\\nb"')),
    *(f"{{kind: box, name: a, size: [0.2, 0.2, 0.2], on: {on}}}"
      for on in ("nothing", "a", "3", "Desk", "floor", "desk/1", "[desk]", "''")),
    "{kind: box, name: a, size: [0.2, 0.2, 0.2], position: [2, 0, 0.75]}",
    "{kind: box, name: a, size: [0.2, 0.2, 0.2], position: [51, 0]}",
    "{kind: box, name: a, size: [0.2, 0.2, 0.2], position: {x: 1}}",
    "{kind: box, name: a, size: [20cm, 20cm, 20cm], position: [4, 0]}",
    "{kind: shelf, name: a, position: [5, 0], boards: [1, 0.5]}",
    "{kind: door, name: a, hinge: left, size: [0.001, 0.001, 0.001], position: [5, 0]}",
    "{kind: drawer, name: a, size: [0.001, 0.001, 0.001], position: [5, 0]}",
    "{kind: tray, name: a, size: [0.001, 0.001, 0.001], position: [5, 0]}",
    "{kind: cart, name: a, size: [0.001, 0.001, 0.2], position: [5, 0]}",
    "{kind: button, name: a, height: 0.2, position: [5, 0]}",
)  # fmt: skip

WRONG = ("nan", ".inf", "1e999", "", "2 kg", "'3 m'", "[[1]]", "{a: 1}", "{uniform: [3, 1]}", "{uniform: [1, nan]}",
         "{uniform: 3}", "{choice: []}", "{choice: [{uniform: [1, 2]}]}", "true", "50%", "-1e3", "1e9")  # fmt: skip
NEEDED = {"box": {"size": "[0.1, 0.2, 0.3]"}, "cylinder": {"radius": "0.1", "height": "0.2"}, "door": {"hinge": "left"}}


@pytest.fixture(autouse=True)
def in_a_folder(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def refused(text: str, line: int | None = None) -> str:
    with pytest.raises(HugwbcError) as caught:
        read(text)
    message = str(caught.value)
    found = PLACE.match(message)
    assert found, message
    assert line is None or int(found[1]) == line, message
    assert message.isprintable() and len(message) < 2000
    return message


@pytest.mark.parametrize("text", OBJECTS, ids=range(len(OBJECTS)))
def test_objects_that_cannot_be(text: str) -> None:
    refused(DESK + f"  - {text}\n", line=3)


@pytest.mark.parametrize("kind", KINDS)
def test_a_wrong_value_is_named_at_its_own_line(kind: str) -> None:
    for field in dataclasses.fields(KINDS[kind]):
        for wrong in WRONG:
            values = {"kind": kind, "name": "a", "position": "[5, 0]", **NEEDED.get(kind, {}), field.name: wrong}
            text = "objects:\n  - " + "\n    ".join(f"{key}: {value}" for key, value in values.items()) + "\n"
            line = 2 + list(values).index(field.name)
            if field.name == "on" or (field.name, wrong) in (("name", "true"), ("name", "nan")):
                continue
            refused(text, line)


def test_too_many_objects() -> None:
    one = "  - {kind: box, name: b, size: [0.1, 0.1, 0.1]}\n"
    assert "at most 200" in refused("objects:\n" + 300 * one)
    with pytest.raises(ConfigError, match="at most 200"):
        Scene(tuple(Box(name=f"b{i}", size=(0.1, 0.1, 0.1)) for i in range(300)))


def test_what_is_found_later_is_named_at_its_place_too() -> None:
    """What varies cannot be judged before it is drawn."""
    support = "  - {kind: wall, name: w, position: [6, 0]}\n"
    varied = "  - {kind: box, name: a, size: [0.2, 0.2, 0.2], mass: {uniform: [1, 2]}, %s}\n"
    refused(DESK + support + varied % "on: w", line=4)
    scene = read(DESK + varied % "position: [2, 0, 0.75]")
    with pytest.raises(SceneError, match=r"table 'desk' and box 'a' overlap .*\(as drawn with seed 3\)"):
        scene.draw(3)
    for place in ("position: [{uniform: [0, 0.01]}, 0, 0.9]", "position: [0, 0.2, 0]"):
        scene = read(DESK + varied % place)
        with pytest.raises(SceneError, match=r"the robot stands in object 'a'"):
            Simulation(scene=scene)


def test_a_table_through_the_pelvis_is_refused() -> None:
    with pytest.raises(SceneError, match="the robot stands in object 't'"):
        Simulation(scene=Scene((Table(name="t", position=(0.1, 0.0), height=0.95),)))


BODY = "<mujoco>{}<worldbody><body name='b' {}>{}</body></worldbody></mujoco>"
BALL = "<freejoint/><geom size='0.1' {}/>"
MJCF = {
    "empty": "", "garbage": "\x7fELF", "open": "<mujoco><worldbody>", "no bodies": "<mujoco/>",
    "another format": "<robot name='x'/>", "no mass": BODY.format("", "", BALL.format("mass='0'")),
    "no shape": BODY.format("", "", "<freejoint/>"), "far": BODY.format("", "pos='500 0 0'", BALL.format("")),
    "nan": BODY.format("", "pos='nan 0 0'", BALL.format("")), "inf": BODY.format("", "pos='inf 0 0'", BALL.format("")),
    "nan friction": BODY.format("", "", BALL.format("friction='nan 0 0'")),
    "infinite mass": BODY.format("", "", BALL.format("mass='inf'")),
    "heavy": BODY.format("", "", BALL.format("mass='1e6'")), "light": BODY.format("", "", BALL.format("mass='1e-9'")),
    "no such mesh": BODY.format("<asset><mesh name='m' file='no.obj'/></asset>", "", "<geom type='mesh' mesh='m'/>"),
    "no such plugin": BODY.format("<extension><plugin plugin='evil.so'/></extension>", "", BALL.format("")),
    "no such include": "<mujoco><include file='no.xml'/></mujoco>",
    "includes itself": "<mujoco><include file='k.xml'/></mujoco>",
    "two of one name": BODY.format("", "", "<body name='b'><geom size='0.1'/></body>"),
    "a lone motor": BODY.format("<actuator><motor joint='j'/></actuator>", "", BALL.format("")),
}  # fmt: skip


SAID = {
    "open": "cannot read",
    "no mass": "MuJoCo refuses .* mass",
    "no bodies": "has no bodies",
    "nan friction": "geom_friction that is not finite",
}


@pytest.mark.parametrize("name", MJCF)
def test_mjcf_that_cannot_be(name: str, tmp_path: pathlib.Path) -> None:
    (tmp_path / "k.xml").write_text(MJCF[name])
    with pytest.raises(ConfigError, match=rf"s\.yaml:\d:\d: mjcf 'k': .*{SAID.get(name, '')}"):
        parse(Scene, "objects:\n  - name: k\n    mjcf: k.xml\n", tmp_path / "s.yaml")


def finite(simulation: Simulation, seconds: float) -> bool:
    """Let time pass; whether nothing was ever NaN."""
    good = True
    for _ in range(round(seconds / 0.002)):
        state = simulation.step(HOLD, 0.002)
        good &= bool(state.is_finite and np.isfinite(simulation.objects.poses).all())
        good &= all(np.isfinite(simulation.objects.seen(name).position).all() for name in simulation.objects)
    return good


def test_mjcf_that_asks_for_too_much_gets_what_it_needs(tmp_path: pathlib.Path) -> None:
    sizes = "<size memory='1P' nuser_body='1000000000' nkey='1000000000'/><option timestep='1'/>"
    (tmp_path / "k.xml").write_text(BODY.format(sizes, "", BALL.format("")))
    scene = Scene((Mjcf(name="k", mjcf=tmp_path / "k.xml", position=(3.0, 0.0, 0.1)),))
    assert finite(Simulation(scene=scene), 0.01)


@pytest.mark.parametrize("asleep", [False, True])
@pytest.mark.parametrize(("what", "value"), [("qpos", np.nan), ("qpos", np.inf), ("qvel", np.nan), ("qpos", 1e9)])
def test_an_object_that_is_moved_to_nowhere_is_reported(what: str, value: float, asleep: bool) -> None:
    simulation = Simulation(scene=Scene((Box(name="a", position=(3.0, 0.0), size=(0.2, 0.2, 0.2)),)))
    assert finite(simulation, 0.6 if asleep else 0.01)
    joint = simulation.model.joint("a")
    getattr(simulation.data, what)[joint.qposadr[0] if what == "qpos" else joint.dofadr[0]] = value
    assert finite(simulation, 0.04)
    (problem,) = simulation.objects.problems
    assert ("left the world" in problem) if value == 1e9 else ("diverged" in problem and simulation.diverged)


@pytest.mark.parametrize("mass", [500.0, 0.001])
def test_the_heaviest_and_the_lightest_box_fall_on_the_robot(mass: float) -> None:
    box = Box(name="a", position=(0.3, 0.0, 1.2), size=(0.2, 0.2, 0.2), mass=mass)
    assert finite(Simulation(scene=Scene((box,))), 0.3)
