"""Scenes and behaviours as a hostile user writes them: each is refused with its line and column, or simulates well."""

import dataclasses
import inspect
import pathlib
import re

import numpy as np
import pytest

from hugwbc import JointCommand, load_robot
from hugwbc.cli import main
from hugwbc.errors import ConfigError, HugwbcError, SceneError
from hugwbc.scripts.behaviours import Lift, Retry, load_behaviour
from hugwbc.scripts.behaviours.behaviour_file import STEPS
from hugwbc.scripts.behaviours.view import View
from hugwbc.settings_file import parse
from hugwbc.sim import Scene, Simulation
from hugwbc.sim.scenes import Box, Mjcf, Table, Uniform, Wall
from hugwbc.sim.scenes.scene import KINDS

PATH = pathlib.Path("f.yaml")
PLACE = re.compile(r"f\.yaml:(\d+):(\d+): \S")
DESK = "objects:\n  - {kind: table, name: desk, position: [2, 0]}\n"
HOLD = JointCommand.position(load_robot(), load_robot().nominal)

# What no YAML file of either kind may hold; `KEY` stands for objects or steps.
TEXTS = (
    "", "# hi", "null", "~", "3", "hello", "- a\n- b", "KEY", "KEY:", "KEY: 3", "KEY: []", "KEY: {}", "KEY: {a: b}",
    "KEY: [null]", "KEY: [[]]", "KEY: [[a]]", "KEY: [3]", "KEY: [{}]", "KEY: [{a: {}, b: {}}]", "KEY: [{[a]: b}]",
    "KEY:\n\t- a", "KEY: [a", "KEY: {a", "KEY: 'a", "KEY: *nope", "KEY: &o [*o]", "&r {KEY: [*r]}", "&r {KEY: *r}",
    "KEY: [a]\n---\nKEY: [a]", "KEY: [a]\nKEY: [a]", "? [a]\n: b", "{{a: b}: c}", "~: 3", "3: 3", "<<: {KEY: [a]}",
    "!!python/object:os.system {}", "KEY: !!python/object/apply:os.system [ls]", "KEY: [!kg 3]", "KEY: !e!x []",
    "KEY: !!set {a}", "KEY: !!omap [a: b]", "KEY: !!binary aGk=", "KEY: !<%zz> []", "%YAML 9.9\n---\nKEY: []",
    "KEY: " + "[" * 3000, "KEY: " + "[" * 3000 + "]" * 3000, "{a: " * 3000, "- " * 3000, "KEY: [" + "a, " * 2000 + "a]",
    "KEY: [\x01]", "KEY:\x00", "about: \"\\e[31m\"", "about: \"\\ud800\"", "about: \"\\U00110000\"",
    "about: \"\\UFFFFFFFF\"", "about: \"\\q\"", "about: [a]", "about:", "about: {a: b}", "x" * 20000 + ": 3",
    "%YAML " + "9" * 5000 + ".1\n---\nKEY: []",
    "a: &a [x, x]\n" + "\n".join(f"b{i}: &b{i} [*a, *a]" for i in range(9)) + "\nKEY: *b8",
)  # fmt: skip

OBJECTS = (
    "box", "[box]", "", "{name: a}", "{kind: bx, name: a}", "{kind: , name: a}", "{kind: [box], name: a}",
    "{kind: mjcf, name: a}", "{Kind: box, name: a}", "{kind: box, name: a}", "{kind: box, nam: a, size: [1, 1, 1]}",
    "{kind: box, name: a, size: [1, 1, 1], movable: false}", "{kind: door, name: a, position: [5, 0]}",
    "{kind: door, name: a, position: [5, 0], hinge: top}", "{kind: door, name: a, position: [5, 0], hinge: }",
    "{kind: door, name: a, position: [5, 0], hinge: {choice: [left]}}", "{name: a, mjcf: none.xml}",
    "{name: a, mjcf: .}", "{name: a, mjcf: /dev/zero}", '{name: a, mjcf: "a\\0b"}', "{name: a, mjcf: [b]}",
    "{name: a, mjcf: /etc/passwd}", "{mjcf: f.yaml}", "{name: a, mjcf: " + "a" * 5000 + "}",
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

STEP_TEXTS = (
    "dance", "Walk_to: {position: [1, 0]}", "walk_to: 3", "walk_to: [1, 0]", "walk_to: {position: {x: 1}}",
    "walk_to: {position: [1e308, 0]}", "walk_to: {position: [1, 0], yaw: 90}", "walk_to: {before: a, aside: 1e300}",
    "walk_to: {before: [desk]}", "walk_to: {before: }", "walk_to: {position: [1, 0], timeout: 1e300}",
    "walk_to: {position: [1, 0], timeout: 10 s}", "face: {yaw: 1e300}", "reach: {left: [1e5, 0, 0]}",
    "reach: {left: [0.3, 0.2, 0.1], frame: }", "reach: {left: [0.3, 0.2, 0.1], left_direction: [0, 0, 0]}",
    "reach: {left: [0.3, 0.2, 0.1], speed: 1e-300}", "reach: {left: [0.3, 0.2, 0.1], tolerance: 1e-300}",
    "press: {object: {name: a}}", "press: {object: a, travel: 1e300}", "press: {object: a, force: 1e9}",
    "press: {object: a, hold: 60}", "press: {object: a, hand: both}", "lift: {object: '', height: 0.1}",
    "lift: {object: a, hold: 1e9}", "wipe: {object: a, path: [[0, 0, 0], [0, 0, 0]]}",
    "place: {object: a, at: [1e300, 0]}",
    "push: {object: a, distance: 1e9}", "stand: {seconds: 1e300}", "retry: {do: [release], times: 1e300}",
    "retry: {do: [release], times: 1000000}", "retry: &r {do: [retry: *r]}", "sequence: [release]",
    "wait_until: contact", "wait_until: {contact: {}, hold: 20, timeout: 10}", "wait_until: {elapsed: {seconds: 20}}",
    "wait_until: {contact: {}, timeout: 1e300}", "wait_until: {moved: {object: a, distance: 1e300}}",
    "wait_until: {arrived: {position: [1e300, 0]}}", "wait_until: {arrived: {position: [1, 0], tolerance: 1e-300}}",
    "wait_until: {force_above: {force: 1e300}}", "wait_until: {lifted: {object: a, height: 1e9}}",
    'lift: {object: "\\e[31m"}', "lift: {object: " + "a" * 3000 + ", height: 0}",
)  # fmt: skip
WRONG = ("nan", ".inf", "1e999", "", "2 kg", "'3 m'", "[[1]]", "{a: 1}", "{uniform: [3, 1]}", "{uniform: [1, nan]}",
         "{uniform: 3}", "{choice: []}", "{choice: [{uniform: [1, 2]}]}", "true", "50%", "-1e3", "1e9")  # fmt: skip
NEEDED = {"box": {"size": "[0.1, 0.2, 0.3]"}, "cylinder": {"radius": "0.1", "height": "0.2"}, "door": {"hinge": "left"}}


def parse_scene(text: str, path: pathlib.Path) -> Scene:
    return parse(Scene, text, path)


def parse_behaviour(text: str, path: pathlib.Path) -> object:
    path.write_text(text, encoding="utf-8", errors="surrogatepass")
    return load_behaviour(path)


@pytest.fixture(autouse=True)
def in_a_folder(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def refused(parse, text: str, line: int | None = None) -> str:
    with pytest.raises(HugwbcError) as caught:
        parse(text, PATH)
    message = str(caught.value)
    found = PLACE.match(message)
    assert found, message
    assert line is None or int(found[1]) == line, message
    assert message.isprintable() and len(message) < 2000
    return message


@pytest.mark.parametrize("text", TEXTS, ids=range(len(TEXTS)))
def test_what_is_no_scene_and_no_behaviour(text: str) -> None:
    if text != "KEY: []":  # a scene may be empty
        refused(parse_scene, text.replace("KEY", "objects"))
    refused(parse_behaviour, text.replace("KEY", "steps"))


@pytest.mark.parametrize("text", OBJECTS, ids=range(len(OBJECTS)))
def test_objects_that_cannot_be(text: str) -> None:
    refused(parse_scene, DESK + f"  - {text}\n", line=3)


@pytest.mark.parametrize("text", STEP_TEXTS, ids=range(len(STEP_TEXTS)))
def test_steps_that_cannot_be(text: str) -> None:
    refused(parse_behaviour, f"about: x\nsteps:\n  - release\n  - {text}\n", line=4)


@pytest.mark.parametrize("kind", KINDS)
def test_a_wrong_value_is_named_at_its_own_line(kind: str) -> None:
    for field in dataclasses.fields(KINDS[kind]):
        for wrong in WRONG:
            values = {"kind": kind, "name": "a", "position": "[5, 0]", **NEEDED.get(kind, {}), field.name: wrong}
            text = "objects:\n  - " + "\n    ".join(f"{key}: {value}" for key, value in values.items()) + "\n"
            line = 2 + list(values).index(field.name)
            if field.name == "on" or (field.name, wrong) in (("name", "true"), ("name", "nan")):
                continue
            refused(parse_scene, text, line)


@pytest.mark.parametrize(
    "name", [name for name, made in STEPS.items() if inspect.isclass(made) and name != "wait_until"]
)
def test_a_wrong_argument_is_named_at_its_own_line(name: str) -> None:
    for argument, parameter in list(inspect.signature(STEPS[name].__init__).parameters.items())[1:]:
        if parameter.kind is inspect.Parameter.VAR_KEYWORD:
            continue
        wrong = ["{a: 1}", "[[[1]]]", *([""] if parameter.default is not None else [])]
        wrong += ["nan", ".inf", "2 kg", "1e999", "-1e9"] if parameter.annotation in (float, int) else []
        for value in wrong:
            needed = [f"{n}: {v}" for n, v in (("object", "a"), ("distance", "1"), ("path", "[[0, 0, 0], [1, 0, 0]]"))
                      if n in STEPS[name].__init__.__annotations__ and n != argument]  # fmt: skip
            needed += ["position: [1, 0]"] if name == "walk_to" and argument not in ("position", "before") else []
            lines = ["steps:", f"  - {name}:", *(f"      {line}" for line in needed), f"      {argument}: {value}"]
            refused(parse_behaviour, "\n".join(lines) + "\n", len(lines))


def test_there_are_more_than_200() -> None:
    assert 2 * len(TEXTS) + len(OBJECTS) + len(STEP_TEXTS) > 200


def test_too_many_objects() -> None:
    one = "  - {kind: box, name: b, size: [0.1, 0.1, 0.1]}\n"
    assert "at most 200" in refused(parse_scene, "objects:\n" + 300 * one)
    with pytest.raises(ConfigError, match="at most 200"):
        Scene(tuple(Box(name=f"b{i}", size=(0.1, 0.1, 0.1)) for i in range(300)))


def test_what_is_found_later_is_named_at_its_place_too() -> None:
    """What varies cannot be judged before it is drawn."""
    support = "  - {kind: wall, name: w, position: [6, 0]}\n"
    varied = "  - {kind: box, name: a, size: [0.2, 0.2, 0.2], mass: {uniform: [1, 2]}, %s}\n"
    refused(parse_scene, DESK + support + varied % "on: w", line=4)
    scene = parse_scene(DESK + varied % "position: [2, 0, 0.75]", PATH)
    with pytest.raises(SceneError, match=r"table 'desk' and box 'a' overlap .*\(as drawn with seed 3\)"):
        scene.draw(3)
    for place in ("position: [{uniform: [0, 0.01]}, 0, 0.9]", "position: [0, 0.2, 0]"):
        scene = parse_scene(DESK + varied % place, PATH)
        with pytest.raises(SceneError, match=r"the robot stands in object 'a'"):
            Simulation(scene=scene)


def test_a_table_through_the_pelvis_is_refused() -> None:
    with pytest.raises(SceneError, match="the robot stands in object 't'"):
        Simulation(scene=Scene((Table(name="t", position=(0.1, 0.0), height=0.95),)))


def test_a_behaviour_names_objects_of_the_scene(tmp_path: pathlib.Path, capsys: pytest.CaptureFixture) -> None:
    text = (
        "steps:\n  - retry:\n      do:\n        - lift: {object: parcl}\n  - reach: {left: [0, 0, 0], frame: world}\n"
    )
    path = tmp_path / "f.yaml"
    path.write_text(text)
    load_behaviour(path, ("parcl",))
    with pytest.raises(ConfigError, match=r"f\.yaml:4:18: unknown object 'parcl'\. Did you mean 'parcel'"):
        load_behaviour(path, ("desk", "parcel"))
    for more in ((), ("--scene", "parcel")):
        words = ["play", "--controller", "hold", "--viewer", "none", "--duration", "0.1", "--script", str(path), *more]
        assert main(words) == 2
        assert re.search(r"f\.yaml:4:18: .*'parcl'", capsys.readouterr().err)


def test_retries_of_what_fails_at_once_do_not_keep_the_loop_waiting() -> None:
    state = Simulation().state()
    retries = Retry(Retry(Lift("nothing"), times=100), times=100)
    view = View(0.0, state, np.zeros((2, 3)))
    retries.begin(view)
    for tick in range(20):
        retries.update(dataclasses.replace(view, time=0.02 * tick))
    assert not retries.reason


BODY = "<mujoco>{}<worldbody><body name='b' {}>{}</body></worldbody></mujoco>"
BALL = "<freejoint/><geom size='0.1' {}/>"
MJCF = {
    "empty": "", "garbage": "\x7fELF", "open": "<mujoco><worldbody>", "no bodies": "<mujoco/>",
    "another format": "<robot name='x'/>", "no mass": BODY.format("", "", BALL.format("mass='0'")),
    "no shape": BODY.format("", "", "<freejoint/>"), "far": BODY.format("", "pos='500 0 0'", BALL.format("")),
    "nan": BODY.format("", "pos='nan 0 0'", BALL.format("")), "inf": BODY.format("", "pos='inf 0 0'", BALL.format("")),
    "infinite mass": BODY.format("", "", BALL.format("mass='inf'")),
    "heavy": BODY.format("", "", BALL.format("mass='1e6'")), "light": BODY.format("", "", BALL.format("mass='1e-9'")),
    "no such mesh": BODY.format("<asset><mesh name='m' file='no.obj'/></asset>", "", "<geom type='mesh' mesh='m'/>"),
    "no such plugin": BODY.format("<extension><plugin plugin='evil.so'/></extension>", "", BALL.format("")),
    "no such include": "<mujoco><include file='no.xml'/></mujoco>",
    "includes itself": "<mujoco><include file='k.xml'/></mujoco>",
    "two of one name": BODY.format("", "", "<body name='b'><geom size='0.1'/></body>"),
    "a lone motor": BODY.format("<actuator><motor joint='j'/></actuator>", "", BALL.format("")),
}  # fmt: skip


@pytest.mark.parametrize("name", MJCF)
def test_mjcf_that_cannot_be(name: str, tmp_path: pathlib.Path) -> None:
    (tmp_path / "k.xml").write_text(MJCF[name])
    with pytest.raises(ConfigError, match=r"s\.yaml:\d:\d: mjcf 'k': "):
        parse_scene("objects:\n  - name: k\n    mjcf: k.xml\n", tmp_path / "s.yaml")


def finite(simulation: Simulation, seconds: float) -> bool:
    """Let time pass; whether nothing was ever NaN."""
    good = True
    for _ in range(round(seconds / 0.002)):
        state = simulation.step(HOLD, 0.002)
        good &= bool(state.is_finite and np.isfinite(simulation.objects.poses).all())
        good &= all(np.isfinite(simulation.objects.seen(name).position).all() for name in simulation.objects)
    return good


def test_mjcf_that_asks_for_too_much_gets_what_it_needs(tmp_path: pathlib.Path) -> None:
    sizes = "<size memory='1P' nuser_body='1000000000' nkey='1000000000'/><option timestep='1' gravity='nan 0 0'/>"
    for text in (BODY.format(sizes, "", BALL.format("")), BODY.format("", "", BALL.format("friction='nan 0 0'"))):
        (tmp_path / "k.xml").write_text(text)
        try:
            scene = Scene((Mjcf(name="k", mjcf=tmp_path / "k.xml", position=(3.0, 0.0)),))
        except SceneError as error:
            assert "not finite" in str(error)
        else:
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


@pytest.mark.parametrize("mass", [1e6, 1e-9, 0.0, -1.0, np.nan, np.inf, Uniform(0.0, 1.0)])
def test_masses_out_of_range(mass: float) -> None:
    with pytest.raises(ConfigError, match=r"mass is .*(0\.001 to 500|number)"):
        Box(name="a", size=(0.2, 0.2, 0.2), mass=mass)


def test_objects_that_overlap_at_the_start() -> None:
    with pytest.raises(SceneError, match="overlap by"):
        Scene((Box(name="a", position=(3.0, 0.0), size=(0.2, 0.2, 0.2)), Wall(name="w", position=(3.0, 0.0))))
