"""The physics of every kind of object, and how objects are seen."""

import dataclasses
import math

import mujoco
import numpy as np
import pytest

from hugwbc import JointCommand, load_robot, rotations
from hugwbc.errors import SceneError, UnknownNameError
from hugwbc.sim import HeightField, Scene, Simulation, Variation, rough_terrain
from hugwbc.sim.scenes import Box, Button, Cart, Cylinder, Door, Drawer, Mjcf, Shelf, Step, Table, Tray, Wall
from hugwbc.sim.scenes.thing import Thing
from hugwbc.sim.sensors import ROBOT as AS_A_ROBOT

ROBOT = load_robot()
HOLD = JointCommand.position(ROBOT, ROBOT.nominal)
FAR = (3.0, 0.0)


def among(*things: Thing, **options) -> Simulation:
    """Return a simulation with exact sensors of a robot among objects."""
    return Simulation(sensing="exact", scene=Scene(things), **options)


def run(simulation: Simulation, seconds: float, force: dict | None = None, command: JointCommand = HOLD) -> None:
    """Let time pass, and pull at bodies meanwhile; the robot hangs by a spring and a damper at its pelvis."""
    for link, pull in (force or {}).items():
        simulation.apply_force(np.array(pull), seconds, link)
    place = simulation.model.key_qpos[0][:3]
    for _ in range(round(seconds / simulation.timestep)):
        qpos, qvel, sling = simulation.qpos, simulation.qvel, simulation.data.qfrc_applied
        sling[:3] = 4e4 * (place - qpos[:3]) - 4e3 * qvel[:3] + [0.0, 0.0, ROBOT.mass * 9.81]
        sling[3:6] = -4e3 * qpos[4:7] - 4e2 * qvel[3:6]
        simulation.step(command, simulation.timestep)


def depth(simulation: Simulation, name: str) -> float:
    """How deep the contacts of a body are, at most [m]."""
    body, contact = simulation.model.body(name).id, simulation.data.contact
    touching = np.any(simulation.model.geom_bodyid[contact.geom] == body, axis=1)
    return float(-contact.dist[touching].min(initial=0.0))


def test_a_box_lies_still_on_a_table_and_hardly_sinks() -> None:
    table = Table(name="desk", position=FAR, height=0.8)
    simulation = among(table, Box(name="parcel", on="desk", size=(0.3, 0.25, 0.2), mass=2.0))
    before = simulation.objects["parcel"]
    deepest = 0.0
    for _ in range(25):
        run(simulation, 0.002)
        deepest = max(deepest, depth(simulation, "parcel"))
    assert 0.0 < deepest < 1e-3
    run(simulation, 1.0)
    after = simulation.objects["parcel"]
    assert before.position == pytest.approx([3.0, 0.0, 0.9])
    assert np.linalg.norm(after.position - before.position) < 1e-4 and after.tilt < 1e-3
    assert np.linalg.norm(after.velocity) < 1e-4


@pytest.mark.parametrize(("friction", "moves"), [(0.25, True), (0.35, False)])
def test_friction_is_as_declared(friction: float, moves: bool) -> None:
    """A force of 0.3 of the weight moves a box of less friction, on a table that has more."""
    table = Table(name="desk", position=FAR, size=(2.0, 1.0), friction=1.5)
    box = Box(name="parcel", on="desk", size=(0.3, 0.25, 0.1), mass=2.0, friction=friction)
    simulation = among(table, box)
    run(simulation, 0.1)
    start = simulation.objects["parcel"].position[0]
    run(simulation, 0.5, {"parcel": (0.3 * 2.0 * 9.81, 0.0, 0.0)})
    way = simulation.objects["parcel"].position[0] - start
    # (0.3 - 0.25) g for half a second
    assert way == pytest.approx(0.5 * 0.05 * 9.81 * 0.25, rel=0.1) if moves else abs(way) < 1e-3


@pytest.mark.parametrize("hinge", ["left", "right"])
def test_a_door_is_pushed_open_and_its_closer_closes_it(hinge: str) -> None:
    simulation = among(Door(name="exit", hinge=hinge, position=FAR, closer=10.0))
    joint = simulation.model.joint("exit")
    at, dof = joint.qposadr[0], joint.dofadr[0]
    run(simulation, 0.2)
    assert abs(simulation.objects["exit"].travel) < 0.005
    # 15 N m open it against 10, at once: the closer's damper acts on the way back alone.
    simulation.data.qfrc_applied[dof] = 15.0
    run(simulation, 1.0)
    opened = simulation.objects["exit"].travel
    assert opened == pytest.approx(0.5 * (15.0 - 10.3) / (20.0 * 0.9**2 / 3.0), rel=0.15)
    forward = rotations.rotate(simulation.objects["exit"].orientation, np.array([0.0, 1.0, 0.0]))
    assert forward[0] < -0.3 if hinge == "left" else forward[0] > 0.3  # the leaf has swung towards +x
    simulation.data.qfrc_applied[dof] = 0.0
    simulation.data.qpos[at], simulation.data.qvel[dof] = 1.4, 0.0
    fastest = 0.0
    for _ in range(50):
        run(simulation, 0.1)
        fastest = max(fastest, -simulation.data.qvel[dof])
    assert abs(simulation.objects["exit"].travel) < 0.01 and 0.3 < fastest < 0.8


def test_a_door_turns_about_its_hinge() -> None:
    simulation = among(Door(name="exit", hinge="left", position=FAR, yaw=math.pi / 2))
    assert simulation.objects["exit"].position == pytest.approx([3.0 - 0.45, 0.0, 0.0], abs=1e-9)


def test_a_drawer_sticks_below_its_friction_and_opens_above_it() -> None:
    simulation = among(Drawer(name="drawer", position=FAR, resistance=15.0, travel=0.3))
    run(simulation, 1.0, {"drawer": (-12.0, 0.0, 0.0)})
    assert simulation.objects["drawer"].travel < 2e-3
    run(simulation, 2.0, {"drawer": (-20.0, 0.0, 0.0)})
    assert simulation.objects["drawer"].travel == pytest.approx(0.3, abs=2e-3)
    assert simulation.objects["drawer"].position[0] == pytest.approx(2.7, abs=2e-3)


def test_a_button_gives_way_at_its_force_and_springs_back() -> None:
    simulation = among(Button(name="button", position=FAR, force=15.0, travel=0.02))
    run(simulation, 0.2)
    assert abs(simulation.objects["button"].travel) < 2e-4
    run(simulation, 0.5, {"button": (9.0, 0.0, 0.0)})  # 3 N move it, 15 N press it down: 9 N half of it
    assert simulation.objects["button"].travel == pytest.approx(0.01, abs=5e-4)
    run(simulation, 0.5, {"button": (15.0, 0.0, 0.0)})
    assert simulation.objects["button"].travel == pytest.approx(0.02, abs=5e-4)
    run(simulation, 0.5)
    assert abs(simulation.objects["button"].travel) < 2e-4


@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, 1.0)])
def test_a_cart_rolls_and_comes_to_rest(direction: tuple[float, float]) -> None:
    simulation = among(Cart(name="cart", position=FAR, mass=20.0, rolling=0.02))
    run(simulation, 0.5)
    start = simulation.objects["cart"].position
    assert np.linalg.norm(simulation.objects["cart"].velocity) < 1e-3
    run(simulation, 1.0, {"cart": (20.0 * direction[0], 20.0 * direction[1], 0.0)})
    speed = simulation.objects["cart"].velocity[:2] @ direction
    assert speed == pytest.approx(20.0 / 20.0 - 0.02 * 9.81, rel=0.05)
    run(simulation, 1.0)
    assert simulation.objects["cart"].velocity[:2] @ direction == pytest.approx(speed - 0.02 * 9.81, rel=0.05)
    assert simulation.objects["cart"].tilt < 0.01
    assert (simulation.objects["cart"].position - start)[2] == pytest.approx(0.0, abs=1e-3)


def test_the_cup_stands_on_a_tray_at_rest_and_falls_when_it_is_tilted() -> None:
    table = Table(name="desk", position=FAR)
    simulation = among(table, Tray(name="tray", on="desk"))
    before = simulation.objects["tray/cup"].position
    run(simulation, 2.0)
    cup = simulation.objects["tray/cup"]
    assert cup.tilt < 0.01 and np.linalg.norm(cup.position - before) < 1e-3
    for degrees, stands in ((15.0, True), (32.0, False)):  # it is as wide as half its height: it tips at 26 degrees
        angle = math.radians(degrees)
        simulation.model.opt.gravity[:] = 9.81 * math.sin(angle), 0.0, -9.81 * math.cos(angle)
        run(simulation, 1.0, {"tray/cup": (1e-3, 0.0, 0.0)})  # a touch, which wakes what sleeps
        assert (simulation.objects["tray/cup"].tilt < 0.05) == stands


def test_a_cylinder_stands_on_a_shelf_and_a_robot_stands_on_a_step() -> None:
    shelf = Shelf(name="shelf", position=FAR, boards=(0.4, 0.8))
    can = Cylinder(name="can", on="shelf/1", radius=0.04, height=0.12, mass=0.4)
    step = Step(name="platform", position=(0.0, 0.0), size=(1.0, 1.0, 0.05))
    simulation = among(shelf, can)
    assert simulation.objects["can"].position[2] == pytest.approx(0.46)
    run(simulation, 1.0)
    can = simulation.objects["can"]
    assert can.tilt < 0.01 and can.position[2] == pytest.approx(0.46, abs=1e-3)
    on_step = among(Step(name="platform", position=FAR, size=(1.0, 1.0, 0.05)))
    on_step.data.qpos[:3] += [3.0, 0.0, 0.05]
    for _ in range(100):
        state = on_step.step(HOLD, 0.002)
    assert state.foot_force[:, 2].sum() > 0.5 * ROBOT.mass * 9.81
    assert on_step.data.sensor("left_sole_position").data[2] == pytest.approx(0.05, abs=2e-3)
    with pytest.raises(SceneError, match="the robot stands in object 'platform' at the start"):
        among(step)


def test_a_hand_does_not_enter_what_it_presses_and_feels_its_force() -> None:
    tip = float(Simulation().data.geom("left_elbow_link").xpos[0]) + 0.14  # the forearms point forward
    simulation = among(Wall(name="wall", position=(tip + 0.005 + 0.05, 0.0)))
    assert not simulation.state().hand_force.any()
    run(simulation, 0.5, {"left_elbow_link": (30.0, 0.0, 0.0)})
    force, on_wall = simulation.state().hand_force, simulation.objects["wall"].hand_force
    assert -60.0 < force[0, 0] < -15.0 and not force[1].any()
    np.testing.assert_allclose(on_wall, -force, atol=1e-6)
    assert 0.0 < depth(simulation, "wall") < 5e-3


def squeeze(simulation: Simulation, force: float, weight: float) -> JointCommand:
    """Hold the joints, press both hands inwards, and carry a weight."""
    torque, jacobian = np.zeros(simulation.model.nv), np.zeros((3, simulation.model.nv))
    for side, sign in (("left", -1.0), ("right", 1.0)):
        site = simulation.model.site(f"{side}_hand").id
        mujoco.mj_jacSite(simulation.model, simulation.data, jacobian, None, site)
        torque += jacobian.T @ [0.0, sign * force, 0.5 * weight]
    return dataclasses.replace(HOLD, tau=torque[6:25])


def test_both_hands_hold_a_box_by_friction() -> None:
    probe = Simulation(sensing="exact")
    left, right = probe.hand_position("left"), probe.hand_position("right")
    size = (0.1, left[1] - right[1] - 0.0605, 0.1)
    at = (left[0], 0.0, left[2] - 0.05)
    simulation = among(Box(name="parcel", position=at, size=size, mass=1.0))
    command = squeeze(simulation, 40.0, 9.81)
    run(simulation, 1.0, command=command)
    parcel, hand = simulation.objects["parcel"], simulation.hand_position("left")
    assert parcel.hand_force[:, 2].sum() == pytest.approx(9.81, abs=0.2)
    assert parcel.hand_force[0, 1] < -20.0 and parcel.hand_force[1, 1] > 20.0
    assert parcel.position[2] == pytest.approx(hand[2], abs=0.03) and parcel.tilt < 0.3
    assert 0.0 < depth(simulation, "parcel") < 5e-3
    run(simulation, 1.0, command=command)
    creep = (simulation.objects["parcel"].position - simulation.hand_position("left")) - (parcel.position - hand)
    assert np.linalg.norm(creep) < 2e-3


def test_an_object_that_leaves_the_world_is_reported_once() -> None:
    simulation = among(Box(name="parcel", position=FAR, size=(0.2, 0.2, 0.2)))
    joint = simulation.model.joint("parcel")
    simulation.data.qvel[joint.dofadr[0] + 2] = 450.0
    run(simulation, 0.2)
    assert simulation.objects.problems == ["object 'parcel' left the world at 0.05 s"]
    assert not simulation.diverged
    simulation.reset()
    assert simulation.objects.problems == []


def test_divergence_is_reported_and_nothing_is_nan() -> None:
    simulation = among(Box(name="parcel", position=FAR, size=(0.2, 0.2, 0.2)))
    run(simulation, 0.01)
    simulation.data.qvel[simulation.model.joint("parcel").dofadr[0]] = math.nan
    state = simulation.step(HOLD, 0.002)
    assert simulation.diverged and simulation.fallen and state.is_finite
    assert simulation.objects.problems == ["the physics diverged at 0.01 s, near 'parcel'"]
    assert np.isfinite(simulation.objects.poses).all()


def test_an_exact_profile_sees_the_truth_and_a_robots_sees_as_motion_capture() -> None:
    scene = Scene((Box(name="parcel", position=FAR, size=(0.2, 0.2, 0.2)),))
    exact = Simulation(sensing="exact", scene=scene)
    np.testing.assert_array_equal(exact.objects.seen("parcel").position, exact.objects["parcel"].position)
    assert exact.objects.seen("parcel").age == 0.0
    errors, turns = [], []
    simulation = Simulation(scene=scene, sensing=AS_A_ROBOT)
    for _ in range(200):
        simulation.step(HOLD, 0.01)
        seen, true = simulation.objects.seen("parcel"), simulation.objects["parcel"]
        errors.append(seen.position - true.position)
        turn = rotations.multiply(seen.orientation, rotations.conjugate(true.orientation))
        turns.append(2.0 * turn[1:])
    assert seen.age == pytest.approx(0.03) and seen.velocity is None and seen.travel is None
    assert np.std(errors, axis=0) == pytest.approx([0.005] * 3, rel=0.2)
    assert np.degrees(np.std(turns, axis=0)) == pytest.approx([0.5] * 3, rel=0.2)
    simulation.data.qpos[simulation.model.joint("parcel").qposadr[0]] += 1.0
    simulation.step(HOLD, 0.02)
    assert simulation.objects.seen("parcel").position[0] == pytest.approx(3.0, abs=0.03)
    simulation.step(HOLD, 0.02)
    assert simulation.objects.seen("parcel").position[0] == pytest.approx(4.0, abs=0.03)


def test_names_of_objects_that_are_not_there() -> None:
    simulation = among(Box(name="parcel", position=FAR, size=(0.2, 0.2, 0.2)))
    assert "parcel" in simulation.objects and "box" not in simulation.objects and list(simulation.objects) == ["parcel"]
    for look in (simulation.objects.__getitem__, simulation.objects.seen):
        with pytest.raises(UnknownNameError, match=r"unknown object 'parcl'\. Did you mean 'parcel'"):
            look("parcl")
    assert simulation.objects.get("parcl") is None
    alone = Simulation(sensing="exact")
    assert len(alone.objects) == 0 and alone.objects.poses.shape == (0, 7)
    with pytest.raises(UnknownNameError, match="unknown object 'parcel'"):
        alone.objects["parcel"]


def test_a_profile_without_hand_sensors_tells_no_forces() -> None:
    scene = Scene((Wall(name="wall", position=FAR),))
    assert Simulation(scene=scene).sense().hand_force is None
    assert Simulation(sensing="exact", scene=scene).sense().hand_force.shape == (2, 3)


def test_objects_lie_on_rough_ground() -> None:
    terrain = rough_terrain(0.03, np.random.default_rng(0))
    stool = Step(name="stool", position=(1.0, 0.5), size=(0.4, 0.4, 0.2))
    simulation = among(stool, Box(name="parcel", on="stool", size=(0.2, 0.2, 0.2)), terrain=terrain)
    base = simulation.objects["stool"].position
    assert base[2] == pytest.approx(float(terrain.height_at(np.array([1.0, 0.5]))))
    run(simulation, 0.5)
    assert simulation.objects["parcel"].position[2] == pytest.approx(base[2] + 0.3, abs=1e-3)
    foot = simulation.model.geom("left_toe_left")
    stool = simulation.model.geom_bodyid == simulation.model.body("stool").id
    assert (simulation.model.geom_contype[stool] & foot.conaffinity).all()  # the soles do not pass through it
    assert mujoco.mj_name2id(simulation.model, mujoco.mjtObj.mjOBJ_GEOM, "footing") >= 0


def test_among_objects_the_soles_meet_the_ground_below_the_robot() -> None:
    """What cannot move, such as their plane, MuJoCo places once where it lets objects sleep."""
    heights = np.zeros((81, 81))
    heights[:, 45:] = 0.05  # from x = 1 m on
    terrain, box = HeightField(heights, (16.0, 16.0)), Box(name="parcel", position=(-3.0, 0.0), size=(0.2, 0.2, 0.2))
    alone, beside = Simulation(sensing="exact", terrain=terrain), among(box, terrain=terrain)
    for simulation in (alone, beside):
        simulation.reset(xy=(2.0, 0.0))
        for _ in range(100):
            simulation.step(HOLD, simulation.timestep)
    assert beside.qpos[:7] == pytest.approx(alone.qpos[:7], abs=1e-6) and alone.qpos[2] > 0.95


def test_objects_on_a_slope_are_in_the_world() -> None:
    terrain = rough_terrain(0.0, np.random.default_rng(0), size=600.0, spacing=2.0, slope=0.1)
    simulation = among(Box(name="parcel", position=FAR, size=(0.2, 0.2, 0.2)), terrain=terrain)
    run(simulation, 0.1)
    assert simulation.objects.problems == []


@pytest.mark.parametrize(
    "drive", ["<adhesion body='b' ctrlrange='0 1'/>", "<motor tendon='t' forcelimited='true' forcerange='-20 20'/>"]
)
def test_drives_of_objects_are_not_the_robots(drive: str, tmp_path) -> None:
    path = tmp_path / "driven.xml"
    path.write_text(
        "<mujoco><worldbody><body name='b' pos='0 0 1'><joint name='j'/><geom size='.1' mass='1'/></body></worldbody>"
        f"<tendon><fixed name='t'><joint joint='j' coef='1'/></fixed></tendon><actuator>{drive}</actuator></mujoco>"
    )
    simulation = among(Mjcf(name="kit", mjcf=path, position=FAR), variation=Variation(strength=0.5))
    limits = simulation.model.actuator_forcerange
    assert limits[:19, 1] == pytest.approx(0.5 * ROBOT.torque_limit) and limits[19, 1] in (0.0, 20.0)


def test_collision_groups_of_a_file_are_not_those_of_the_soles(tmp_path) -> None:
    path = tmp_path / "board.xml"
    board = "<body><geom type='box' size='.6 .1 .02' conaffinity='2'/></body>"
    path.write_text(f"<mujoco><worldbody>{board}</worldbody></mujoco>")
    terrain = rough_terrain(0.03, np.random.default_rng(0))
    simulation = among(Mjcf(name="kit", mjcf=path, position=(2.0, 0.0)), terrain=terrain)
    assert simulation.qpos[2] == pytest.approx(Simulation(sensing="exact", terrain=terrain).qpos[2])


def test_a_hand_wakes_what_sleeps() -> None:
    """Objects at rest are left out of the computation until something touches them."""
    hand = Simulation(sensing="exact").hand_position("left")
    stool = Step(name="stool", position=(hand[0] + 0.2, hand[1]), size=(0.2, 0.2, hand[2] - 0.05))
    box = Box(name="parcel", on="stool", position=(-0.05, 0.0), size=(0.1, 0.1, 0.1), mass=0.3, friction=0.2)
    simulation = among(stool, box)
    run(simulation, 0.5)
    assert simulation.data.ntree_awake == 1
    start = simulation.objects["parcel"].position[0]
    run(simulation, 0.5, {"left_elbow_link": (25.0, 0.0, 0.0)})
    assert simulation.objects["parcel"].position[0] > start + 0.02


def test_the_most_slippery_box_lies_still_on_level_ground() -> None:
    simulation = among(Box(name="ice", position=FAR, size=(0.1, 0.1, 0.1), friction=0.005))
    run(simulation, 1.0)
    assert simulation.objects["ice"].position == pytest.approx([3.0, 0.0, 0.05], abs=1e-3)
    run(simulation, 0.5, {"ice": (0.1, 0.0, 0.0)})
    assert simulation.objects["ice"].velocity[0] == pytest.approx((0.1 - 0.005 * 9.81) * 0.5, rel=0.05)
