"""Other people's MJCF files: kept as they are, or refused with what cannot be kept; and what is too large."""

import pathlib
import struct
import time
import zlib

import mujoco
import numpy as np
import pytest

from hugwbc.errors import SceneError
from hugwbc.sim import Scene, Simulation
from hugwbc.sim.scenes import Box, Mjcf

BALL = "<freejoint/><geom size='.1' mass='2'/>"
ARM = """<body name='a' pos='0 0 1'><geom size='.1'/><body name='b' pos='.2 0 0'><joint name='j' type='hinge' {}/>
<geom name='g' type='box' size='.1 .1 .1' {}/></body></body>"""
WEDGE = "<asset><mesh name='w' vertex='0 0 0  .1 0 0  0 .1 0  0 0 .1' scale='2 3 1'/></asset>"
KEPT = {
    "degrees": "<compiler angle='degree'/>" + "<worldbody>" + ARM.format("range='-30 60'", "euler='0 45 10'"),
    "radians": "<compiler angle='radian' eulerseq='zyx'/><worldbody>" + ARM.format("range='-1 .5'", "euler='0 1 .2'"),
    "no autolimits": "<compiler autolimits='false'/><worldbody>" + ARM.format("range='-30 60' limited='true'", ""),
    "bounds": "<compiler boundmass='5' boundinertia='.3'/><worldbody>" + ARM.format("", "mass='1'"),
    "inertia": "<compiler inertiafromgeom='true' balanceinertia='true'/><worldbody><body name='b'><inertial mass='9' "
    "pos='0 0 0' diaginertia='1 1 5'/><freejoint/><geom size='.1' mass='2'/></body>",
    "groups": "<compiler inertiagrouprange='1 2'/><worldbody><body name='b'><freejoint/><geom size='.1' mass='1' "
    "group='1'/><geom size='.2' mass='5' group='4'/></body>",
    "classes": "<default><geom friction='.2' solref='.03 1' condim='4'/><default class='k'><geom solimp='.5 .6 .01' "
    "priority='3' margin='.01' gap='.005'/><joint damping='3' armature='.1'/></default></default><worldbody>"
    + ARM.format("class='k'", "class='k'"),
    "visual": "<compiler discardvisual='true'/><worldbody><body name='s'><freejoint/><geom "
    "size='.1'/><body><geom name='v' pos='1 0 0' size='.2' contype='0' conaffinity='0' mass='3'/></body></body>",
    "mesh": WEDGE + "<worldbody><body name='b'><freejoint/><geom type='mesh' mesh='w' density='500'/></body>",
    "pairs": "<contact><exclude body1='a' body2='b'/><pair geom1='g' geom2='wall' condim='1'/></contact><worldbody>"
    "<geom name='wall' type='box' size='.1 1 1' pos='1 0 1'/>" + ARM.format("", "mass='1'"),
    "links": "<equality><weld body1='b' solref='.05 1'/></equality><tendon><fixed name='t' stiffness='5' "
    "springlength='1'><joint joint='j' coef='2'/></fixed></tendon><actuator><position name='m' joint='j' kp='30' "
    "gear='2'/></actuator><worldbody>" + ARM.format("stiffness='4' springref='10' frictionloss='.3'", "mass='1'"),
    "gravcomp": "<option timestep='.01' integrator='RK4' cone='elliptic' density='1.2' viscosity='.00002'/><worldbody>"
    "<body name='b' gravcomp='1'>" + BALL + "</body>",
    "world": "<worldbody><frame pos='0 0 1' euler='0 0 90'><geom name='wall' type='box' size='.1 2 1' pos='1 0 0' "
    "euler='0 0 20' friction='.1' rgba='1 0 0 1'/></frame><geom type='plane' size='1 1 .1'/>",
}  # fmt: skip
LOST = {
    "compiler settotalmass": ("<compiler settotalmass='10'/><worldbody><body name='b'>" + BALL + "</body>", "'b' the "),
    "gravity": ("<option gravity='0 0 0'/><worldbody><body name='b'>" + BALL + "</body>", "changes gravity"),
    "water": ("<option density='1000'/><worldbody><body name='b'>" + BALL + "</body>", "changes density"),
    "cloth": (
        "<worldbody><body name='b' pos='0 0 1'><flexcomp type='grid' dim='2' count='3 3 1' spacing='.1 .1 .1' name='f' "
        "mass='1' radius='.01'/></body>",
        "flexible bodies",
    ),
    "no contacts": ("<option><flag contact='disable'/></option><worldbody><body>" + BALL + "</body>", "contact of"),
    "one contact": (
        "<option o_solref='.1 1'><flag override='enable'/></option><worldbody><body name='b'>" + BALL + "</body>",
        "changes override",
    ),
    "a plane as wall": (
        "<worldbody><geom name='p' type='plane' size='1 1 .1' euler='0 90 0'/><body name='b'>" + BALL + "</body>",
        "plane 'p'",
    ),
    "a high plane": (
        "<worldbody><geom name='p' type='plane' size='1 1 .1' pos='0 0 .5'/><body name='b'>" + BALL + "</body>",
        "plane 'p'",
    ),
}  # fmt: skip


def written(folder: pathlib.Path, text: str) -> pathlib.Path:
    path = folder / "k.xml"
    path.write_text(f"<mujoco>{text}</worldbody></mujoco>")
    return path


@pytest.mark.parametrize("name", KEPT)
def test_masses_joints_and_contacts_are_those_of_the_file_alone(name: str, tmp_path: pathlib.Path) -> None:
    path = written(tmp_path, KEPT[name])
    alone = mujoco.MjModel.from_xml_path(str(path))
    here = Simulation(scene=Scene((Mjcf(name="k", mjcf=path, position=(3.0, 1.0, 1.0)),))).model
    for kind, count in (("body", alone.nbody), ("jnt", alone.njnt), ("geom", alone.ngeom), ("actuator", alone.nu)):
        for one in [getattr(alone, kind)(i) for i in range(count)]:
            if not one.name or one.name == "world":
                continue
            other = getattr(here, kind)(f"k/{one.name}")
            for field in ("mass", "inertia", "range", "limited", "stiffness", "friction", "solref", "solimp", "condim",
                          "priority", "margin", "gap", "size", "gravcomp", "gear", "biasprm", "quat", "axis", "ipos",
                          "iquat", "armature", "damping", "frictionloss", "qpos_spring"):  # fmt: skip
                # A scene's contacts are those of its ground where a file says nothing (docs/scenes.md).
                if hasattr(one, field) and not (field == "solref" and one.solref[0] == 0.02):
                    found, wanted = getattr(other, field), getattr(one, field)
                    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9, err_msg=field)
    added = here.neq - alone.neq, here.ntendon - alone.ntendon, here.npair - alone.npair
    grips = 4 * sum(alone.body_jntnum[1:] > 0)  # a weld and a hook to each hand
    assert added == (grips, 0, mujoco.MjModel.from_xml_path(str(Simulation().robot.xml_path)).npair)


@pytest.mark.parametrize("name", LOST)
def test_what_a_scene_cannot_keep_is_refused(name: str, tmp_path: pathlib.Path) -> None:
    text, said = LOST[name]
    with pytest.raises(SceneError, match=rf"mjcf 'k': .*k\.xml .*{said}"):
        Mjcf(name="k", mjcf=written(tmp_path, text), position=(3.0, 1.0))


def test_shapes_of_a_files_world_are_an_object(tmp_path: pathlib.Path) -> None:
    path = written(tmp_path, KEPT["world"])
    scene = Scene((Mjcf(name="k", mjcf=path, position=(3.0, 0.0)),))
    model, alone = scene.model(), mujoco.MjModel.from_xml_path(str(path))
    assert scene.body_names == ("k/world_shapes",) and model.ngeom == 1
    np.testing.assert_allclose(model.geom("k/wall").pos, alone.geom("wall").pos, atol=1e-9)
    np.testing.assert_allclose(model.geom("k/wall").quat, alone.geom("wall").quat, atol=1e-9)
    with pytest.raises(SceneError, match="the robot stands in object 'k/world_shapes'"):
        Simulation(scene=Scene((Mjcf(name="k", mjcf=path, position=(0.0, -1.0)),)))
    with pytest.raises(SceneError, match="mjcf 'k' and box 'b' overlap"):
        Scene((Mjcf(name="k", mjcf=path), Box(name="b", position=(0.0, 1.0), size=(0.2, 0.2, 0.2))))
    with pytest.raises(SceneError, match="mjcf 'k' and mjcf 'l' overlap"):
        Scene((Mjcf(name="k", mjcf=path), Mjcf(name="l", mjcf=path)))


def test_a_body_in_the_ground_is_refused_on_any_ground(tmp_path: pathlib.Path) -> None:
    path = written(tmp_path, "<worldbody><body name='b'>" + BALL + "</body>")
    with pytest.raises(SceneError, match="object 'k/b' is 100 mm deep in the ground at the start; raise it"):
        Scene((Mjcf(name="k", mjcf=path, position=(3.0, 0.0)),))
    assert Simulation(scene=Scene((Mjcf(name="k", mjcf=path, position=(3.0, 0.0, 0.1)),))).objects.problems == []


def test_friction_and_colour_are_those_of_the_file(tmp_path: pathlib.Path) -> None:
    path = written(tmp_path, "<worldbody><body name='b'>" + BALL + "</body>")
    for name, value in (("friction", 0.1), ("colour", "#ff0000")):
        with pytest.raises(SceneError, match=f"its {name} is that of the file"):
            Mjcf(name="k", mjcf=path, **{name: value})


HFIELD = (
    "<asset><hfield name='h' nrow='{0}' ncol='{0}' size='1 1 1 1'/></asset><worldbody><geom type='hfield' hfield='h'/>"
)
HUGE = {
    "hfield": (HFIELD.format(20000), "400000000 numbers in its hfield 'h'; give at most 16777216"),
    "replicate": ("<worldbody><replicate count='20000'><body><geom size='.1'/></body></replicate>", "elements"),
    "nested": (
        "<worldbody>" + 3 * "<replicate count='30' offset='1 0 0'>" + "<geom size='.1'/>" + 3 * "</replicate>",
        "elements",
    ),
    "texture": ("<asset><texture builtin='flat' width='30000' height='30000'/></asset><worldbody>", "numbers"),
    "flexcomp": (
        "<worldbody><body><flexcomp type='grid' dim='3' count='90 90 90' name='f' mass='1'/></body>",
        "elements",
    ),
    "sensor": ("<sensor><user dim='900000000'/></sensor><worldbody>", "numbers in its user"),
    "mesh": ("<asset><mesh name='m' builtin='supersphere' params='500 1 1'/></asset><worldbody>", "pieces in"),
    "picture": ("<asset><hfield name='h' file='p.png' size='1 1 1 1'/></asset><worldbody>", "numbers in its hfield"),
    "included": ("<include file='more.xml'/><worldbody>", "elements"),
    "attached": (
        "<asset><model name='m' file='model.xml'/></asset><worldbody><replicate count='10'><body>"
        "<attach model='m' body='b' prefix='p'/></body></replicate>",
        "elements",
    ),
    "file": ("<asset><mesh file='big.obj'/></asset><worldbody>", "bytes"),
}  # fmt: skip


@pytest.mark.parametrize("name", HUGE)
def test_a_file_that_asks_for_hours_is_refused_at_once(name: str, tmp_path: pathlib.Path) -> None:
    many = "<replicate count='1000'><geom size='.1'/></replicate>"
    (tmp_path / "more.xml").write_text(f"<mujoco><worldbody>{6 * many}</worldbody></mujoco>")
    (tmp_path / "model.xml").write_text(f"<mujoco><worldbody><body name='b'>{many}</body></worldbody></mujoco>")
    head = b"IHDR" + struct.pack(">IIBBBBB", 30000, 30000, 8, 0, 0, 0, 0)
    (tmp_path / "p.png").write_bytes(b"\x89PNG\r\n\x1a\n\0\0\0\r" + head + struct.pack(">I", zlib.crc32(head)))
    with (tmp_path / "big.obj").open("wb") as file:
        file.truncate(40_000_000)
    text, said = HUGE[name]
    started = time.process_time()
    with pytest.raises(SceneError, match=rf"k\.xml: .*it has .*{said}"):
        Mjcf(name="k", mjcf=written(tmp_path, text))
    assert time.process_time() - started < 1.0


def test_an_ordinary_hfield_and_comments_with_dashes_are_read(tmp_path: pathlib.Path) -> None:
    Mjcf(name="k", mjcf=written(tmp_path, "<!-- a -- b -->" + HFIELD.format(50)))
