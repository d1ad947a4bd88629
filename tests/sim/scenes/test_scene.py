"""Scenes as declared in Python: variation, placement, what is refused; episodes of a seed."""

import dataclasses
import pathlib
from typing import Any

import mujoco
import numpy as np
import pytest

from hugwbc import JointCommand, load_robot
from hugwbc.errors import ConfigError, HugwbcError
from hugwbc.sim import Arena, Ground, Scene, Simulation, Variation, load_scene
from hugwbc.sim.faults import Fault
from hugwbc.sim.physx import PhysxSimulation
from hugwbc.sim.scenes import SCENE_NAMES, Box, Choice, Door, Mjcf, Shelf, Table, Uniform, Wall
from hugwbc.sim.scenes.scene import KINDS

ROBOT = load_robot()
BOX: dict[str, Any] = {"size": (0.2, 0.2, 0.2)}
VARIED = Scene((
    Table(name="desk", position=(1.2, 0.0), height=Uniform(0.7, 0.95)),
    Box(name="parcel", on="desk", position=(Uniform(-0.1, 0.1), 0.0), mass=Uniform(0.5, 3.0),
        colour=Choice(("#112233", "#445566")), **BOX),
    Box(name="other", position=(2.5, 0.0), mass=Choice((1.0, 2.0)), friction=Uniform(0.3, 0.9), **BOX),
))  # fmt: skip


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Box(name="a", mass=Uniform(0.0, 1.0), **BOX), r"mass .* 0.001"),
        (lambda: Box(name="a", position=(1.0,), **BOX), r"position is \(1.0,\); .* \[x, y\]"),
        (lambda: Box(name="a", position=(1.0, 2.0, -1.0), **BOX), r"position .* high"),
        (lambda: Shelf(name="a", boards=(0.8, 0.4)), r"ascending"),
        (lambda: Shelf(name="a", boards=()), r"boards .* at least 1"),
        (lambda: Uniform(0.0, float("inf")), r"high is inf; .* finite"),
        (lambda: Choice(()), r"values .* at least 1"),
        (lambda: Scene((Box(name="a", on="b", **BOX), Box(name="b", on="a", **BOX))), r"it stands on itself"),
        (lambda: Scene((Wall(name="w"), Box(name="a", on="w", **BOX))), r"nothing can stand on wall 'w'"),
        (lambda: Scene((Shelf(name="s"), Box(name="a", on="s/4", **BOX))), r"has no board '4'; give s/1 to s/3"),
        (lambda: Scene((Table(name="t"), Box(name="a", on="t/1", **BOX))), r"table 't' has no part '1'"),
        (
            lambda: Scene((Table(name="a"), Shelf(name="b", position=(0.2, 0.0)))),
            r"table 'a' and shelf 'b' overlap by \d+ mm at the start",
        ),
        (
            lambda: Scene((Table(name="t", position=(1.2, 0.0)), Box(name="a", on="t", position=(1.2, 0.0), **BOX))),
            r"box 'a' on 't' does not touch it; give a position relative to the middle of its top",
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused(make, message: str) -> None:
    with pytest.raises(HugwbcError, match=message):
        make()


def test_a_thing_may_hang_over_the_edge_lie_across_two_or_fall() -> None:
    table = Table(name="t", size=(0.5, 0.5))
    plank = Box(name="a", on="t", position=(0.5, 0.0), size=(0.6, 0.1, 0.02), mass=1.0)
    Scene((table, Table(name="u", size=(0.5, 0.5), position=(1.0, 0.0)), plank))
    Scene((table, Box(name="b", on="t", position=(0.0, 0.0, 0.3), **BOX)))


def test_walls_may_meet_in_a_corner() -> None:
    Scene((Wall(name="a"), Wall(name="b", yaw=1.5708)))


def test_a_draw_is_within_its_bounds_and_the_same_for_a_seed() -> None:
    drawn = [VARIED.draw(seed) for seed in range(50)]
    masses = [scene.objects[1].mass for scene in drawn]
    assert 0.5 <= min(masses) < 1.0 and 2.5 < max(masses) <= 3.0
    assert {scene.objects[1].colour for scene in drawn} == {"#112233", "#445566"}
    assert {scene.objects[2].mass for scene in drawn} == {1.0, 2.0}
    assert not any(scene.varies for scene in drawn) and VARIED.varies
    assert VARIED.draw(7) == drawn[7] != drawn[8]
    assert Scene((Table(name="a", height=Uniform(0.8, 0.8)),)).draw(0).objects[0].height == 0.8


def test_a_draw_does_not_depend_on_other_objects() -> None:
    alone = dataclasses.replace(VARIED, objects=VARIED.objects[2:])
    assert alone.draw(3).objects[0] == VARIED.draw(3).objects[2]


def test_what_stands_on_something_follows_its_height_and_heading() -> None:
    scene = Scene((
        Table(name="desk", position=(1.0, 2.0), yaw=np.pi / 2, height=0.7),
        Box(name="parcel", on="desk", position=(0.1, 0.2, 0.05), yaw=0.3, **BOX),
    ))  # fmt: skip
    state = Simulation(sensing="exact", scene=scene).objects["parcel"]
    assert state.position == pytest.approx([1.0 - 0.2, 2.0 + 0.1, 0.7 + 0.05 + 0.1])
    assert 2.0 * np.arctan2(state.orientation[3], state.orientation[0]) == pytest.approx(np.pi / 2 + 0.3)


def roll(simulation: Simulation, steps: int = 60) -> np.ndarray:
    rng, rows = np.random.default_rng(0), []
    for _ in range(steps):
        simulation.step(JointCommand.position(ROBOT, ROBOT.nominal + rng.normal(0.0, 0.1, 19)), 0.004)
        sensed, seen = simulation.sense(), simulation.objects.seen("parcel")
        rows.append(np.concatenate((simulation.qpos, simulation.objects.poses.ravel(), sensed.q, seen.position)))
    return np.array(rows)


def test_a_seed_is_an_episode_bit_for_bit_and_so_is_a_redraw() -> None:
    first, again = (Simulation(scene=VARIED, seed=4) for _ in range(2))
    np.testing.assert_array_equal(roll(first), roll(again))
    noisy = (Fault.parse("encoder-noise@0"),)
    other = Simulation(scene=VARIED, seed=5, faults=noisy)
    roll(other)
    other.redraw(4)
    np.testing.assert_array_equal(roll(other), roll(Simulation(scene=VARIED, seed=4, faults=noisy)))
    assert other.scene == VARIED.draw(4)
    assert (roll(Simulation(scene=VARIED, seed=5))[-1] != roll(Simulation(scene=VARIED, seed=4))[-1]).any()


def test_a_reset_keeps_the_objects_that_were_drawn() -> None:
    simulation = Simulation(sensing="exact", scene=VARIED, seed=4)
    before = simulation.objects.poses
    roll(simulation)
    simulation.reset()
    np.testing.assert_array_equal(simulation.objects.poses, before)


def test_the_robot_is_the_same_among_objects() -> None:
    """What a controller reads does not change by objects that the robot does not touch."""
    alone, among = Simulation(sensing="exact"), Simulation(sensing="exact", scene=VARIED)
    for _ in range(40):
        alone.step(JointCommand.position(ROBOT, ROBOT.nominal), 0.01)
        among.step(JointCommand.position(ROBOT, ROBOT.nominal), 0.01)
    assert among.qpos.shape == (26,) and among.torque.shape == (19,)
    np.testing.assert_allclose(among.qpos, alone.qpos, atol=1e-6)
    assert not among.state().hand_force.any()


def test_variations_of_the_robot_leave_the_objects_alone() -> None:
    door = Scene((Door(name="exit", hinge="left", position=(3.0, 0.0)), Box(name="parcel", position=(2.0, 2.0), **BOX)))
    usual = Simulation(sensing="exact", scene=door).model
    varied = Simulation(sensing="exact", scene=door, variation=Variation(friction=0.3, strength=0.5)).model
    for name, field in (("exit", "geom_friction"), ("parcel", "geom_friction")):
        mine = usual.geom_bodyid == usual.body(name).id
        np.testing.assert_array_equal(getattr(varied, field)[mine], getattr(usual, field)[mine])
    np.testing.assert_array_equal(varied.actuator("exit/damper").forcerange, usual.actuator("exit/damper").forcerange)
    assert varied.actuator("left_knee_joint").forcerange[1] == 0.5 * usual.actuator("left_knee_joint").forcerange[1]


def test_a_scene_may_ask_for_robot_and_ground() -> None:
    scene = Scene((Box(name="parcel", position=(2.0, 0.0), **BOX),), robot="h1-2023", ground="soft")
    simulation = Simulation(sensing="exact", scene=scene)
    assert simulation.robot.name == "h1-2023" and simulation.ground == Ground.named("soft")
    assert Arena("h1-2023", ground="soft").simulation(scene=scene).robot.name == "h1-2023"
    with pytest.raises(ConfigError, match="the scene is made for robot h1-2023, not h1"):
        Arena().simulation(scene=scene)
    with pytest.raises(ConfigError, match="the scene is made for soft ground"):
        Simulation(sensing="exact", scene=scene, ground=Ground())


def test_another_engine_has_no_objects() -> None:
    with pytest.raises(ConfigError, match="engine physx has no objects; run a scene with mujoco"):
        Arena().simulation_in(PhysxSimulation, scene=VARIED)


@pytest.mark.parametrize("name", SCENE_NAMES)
def test_shipped_scenes_are_valid_and_lie_still(name: str) -> None:
    for seed in range(3):
        simulation = Simulation(sensing="exact", scene=load_scene(name), seed=seed)
        before = simulation.objects.poses
        for _ in range(50):
            simulation.step(JointCommand.position(ROBOT, ROBOT.nominal), 0.01)
        assert np.abs(simulation.objects.poses - before).max() < 2e-3 and simulation.objects.problems == []


def test_there_is_one_of_every_kind_in_the_workshop() -> None:
    assert {type(thing) for thing in load_scene("workshop").objects} == set(KINDS.values()) - {Mjcf}


KITCHEN = """<mujoco>
  <option timestep="0.01"/>
  <asset><mesh name="wedge" vertex="0 0 0  0.1 0 0  0 0.1 0  0 0 0.1"/></asset>
  <worldbody>
    <geom type="plane" size="1 1 0.1"/>
    <body name="counter" pos="0 0 0.4"><geom type="box" size="0.3 0.5 0.4"/></body>
    <body pos="0 0 0.86">
      <freejoint/><geom name="sponge" type="box" size="0.05 0.05 0.05" solref="0.05 1" mass="0.1"/>
    </body>
    <body name="lid" pos="0 0.3 0.9">
      <joint name="hinge" axis="0 1 0"/><geom type="mesh" mesh="wedge" mass="0.2"/>
    </body>
  </worldbody>
  <keyframe><key qpos="0 0 2 1 0 0 0 0"/></keyframe>
</mujoco>"""


def test_an_mjcf_file_comes_with_a_prefix(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "kitchen.xml"
    path.write_text(KITCHEN)
    kitchen = Mjcf(name="kitchen", mjcf=path, position=(2.0, 1.0), yaw=np.pi / 2)
    scene = Scene((kitchen, Box(name="parcel", **BOX, position=(4.0, 0.0))))
    simulation = Simulation(sensing="exact", scene=scene)
    assert scene.body_names == ("kitchen/counter", "kitchen/body_2", "kitchen/lid", "parcel")
    assert simulation.objects["kitchen/counter"].position == pytest.approx([2.0, 1.0, 0.4])
    assert simulation.objects["kitchen/lid"].position == pytest.approx([2.0 - 0.3, 1.0, 0.9])
    assert simulation.objects["kitchen/lid"].travel == pytest.approx(0.0)
    sponge, tile = simulation.model.geom("kitchen/sponge"), simulation.model.geom("left_toe_left")
    assert sponge.solref[0] == 0.05 and tile.solref[0] == 0.005  # the file's own contacts stay, ours are the ground's
    assert simulation.model.opt.timestep == 0.002
    for _ in range(50):
        simulation.step(JointCommand.position(ROBOT, ROBOT.nominal), 0.01)
    assert simulation.objects["kitchen/body_2"].position[2] == pytest.approx(0.85, abs=5e-3)
    assert simulation.objects.problems == []


def test_the_solver_has_time_for_a_grasp() -> None:
    assert Simulation(sensing="exact").model.opt.iterations == 20
    model = Simulation(sensing="exact", scene=VARIED).model
    assert model.opt.iterations == 50 and model.opt.jacobian == mujoco.mjtJacobian.mjJAC_DENSE
