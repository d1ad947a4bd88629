"""Where the robot is in the state of a model, with and without other bodies; variations of it."""

import mujoco
import numpy as np
import pytest

from hugwbc import JointCommand
from hugwbc.errors import ConfigError, ModelError
from hugwbc.robot import load_robot
from hugwbc.robot_tables import robot_names
from hugwbc.sim import Simulation, Variation, rough_terrain
from hugwbc.sim.physx import PhysxSimulation
from hugwbc.sim.robot_model import robot_layout

ROBOT = load_robot()


def _spec(name="h1"):
    return mujoco.MjSpec.from_file(str(load_robot(name).xml_path))


def _with_box(first):
    """Return a model with a free box that comes before or after the robot."""
    scene, box = mujoco.MjSpec(), mujoco.MjSpec()
    body = box.worldbody.add_body(name="box")
    body.add_freejoint()
    body.add_geom(size=[0.1, 0.1, 0.1])
    robot = _spec()
    scene.option = robot.option
    for part in (box, robot) if first else (robot, box):
        scene.attach(part, prefix="" if part is robot else "box_", frame=scene.worldbody.add_frame())
    return scene.compile()


@pytest.mark.parametrize("name", robot_names())
def test_alone_the_robot_is_the_whole_state(name):
    model = _spec(name).compile()
    layout, n = robot_layout(model, load_robot(name)), len(load_robot(name).joint_names)
    assert (layout.qpos, layout.qvel, layout.ctrl) == (slice(0, n + 7), slice(0, n + 6), slice(0, n))
    assert np.array_equal(model.key("nominal").qpos[layout.joints], load_robot(name).nominal)


@pytest.mark.parametrize("first", [False, True])
def test_an_object_leaves_the_robots_part_the_same(first):
    model, robot = _with_box(first), load_robot()
    layout, data = robot_layout(model, robot), mujoco.MjData(model)
    data.qpos[layout.joints], data.qvel[layout.rates] = np.arange(19.0), np.arange(19.0)
    assert [float(data.joint(name).qpos[0]) for name in robot.joint_names] == list(range(19))
    assert [float(data.joint(name).qvel[0]) for name in robot.joint_names] == list(range(19))
    assert model.nq == 33 and layout.qpos.start == (7 if first else 0)
    data.qpos[layout.qpos][:3] = 1.0, 2.0, 3.0
    mujoco.mj_kinematics(model, data)
    assert data.body("pelvis").xpos == pytest.approx([1.0, 2.0, 3.0])


def test_joints_in_another_order_are_refused():
    spec = _spec()
    spec.delete(spec.joint("left_elbow_joint"))
    spec.body("left_elbow_link").add_joint(name="another_joint")
    spec.body("left_hip_yaw_link").add_joint(name="left_elbow_joint")
    for actuator in list(spec.actuators):
        if actuator.name == "left_elbow_joint":
            actuator.target = "left_elbow_joint"
    with pytest.raises(ModelError, match=r"does not hold h1 in one piece"):
        robot_layout(spec.compile(), load_robot("h1"))


@pytest.mark.parametrize("payload", [0.0, 10.0])
def test_feet_carry_the_weight_and_a_payload(payload):
    simulation = Simulation(variation=Variation(payload=payload))
    hold = JointCommand.position(ROBOT, ROBOT.nominal)
    mass = ROBOT.mass + payload
    momenta, forces = [], []
    for step in range(100):
        state = simulation.step(hold, 0.002)
        if step >= 49:
            mujoco.mj_subtreeVel(simulation.model, simulation.data)
            momenta.append(mass * simulation.data.subtree_linvel[1, 2])
            forces.append(state.foot_force[:, 2].sum())
    # The robot settles into its soft joints: the feet bear the weight, and what slows it down.
    assert np.mean(forces[1:]) == pytest.approx(mass * 9.81 + (momenta[-1] - momenta[0]) / 0.1, rel=0.02)


@pytest.mark.parametrize("engine", [Simulation, PhysxSimulation])
def test_a_trunk_cannot_lose_more_than_its_mass(engine):
    with pytest.raises(ConfigError, match=r"payload is -10 kg, and the trunk weighs 7\.817 kg; remove less"):
        engine(robot="g1", variation=Variation(payload=-10.0))


@pytest.mark.parametrize("friction", [0.1, 0.6, 1.2])
@pytest.mark.parametrize("terrain", [None, rough_terrain(0.0, np.random.default_rng(0), size=4.0)])
def test_contacts_with_the_ground_have_the_friction(friction, terrain):
    simulation = Simulation(terrain=terrain, variation=Variation(friction=friction))
    simulation.step(JointCommand.position(ROBOT, ROBOT.nominal), 0.03)
    contacts = simulation.data.contact.friction
    assert len(contacts) >= 4
    np.testing.assert_allclose(contacts[:, :2], friction)


ENGINES = pytest.mark.parametrize("engine", [Simulation, PhysxSimulation])


@ENGINES
def test_gain_and_strength_act_on_the_torque(engine):
    command = JointCommand(
        ROBOT.nominal + 0.01, np.full(19, 0.2), np.full(19, 100.0), np.full(19, 1.0), np.full(19, 2.0)
    )
    # tau + kp 0.01 + kd 0.2 at the first step from rest
    for variation, torque in ((Variation(gain=1.5), 2.0 + 1.5 * 1.2), (Variation(strength=0.5), 0.5 * 3.2)):
        simulation = engine(timestep=1e-5, variation=variation)
        simulation.step(command, 1e-5)
        np.testing.assert_allclose(simulation.torque, torque, rtol=0.01)


@ENGINES
def test_weak_motors_have_a_lower_limit(engine):
    simulation = engine(variation=Variation(strength=0.5))
    strong = JointCommand.position(ROBOT, ROBOT.nominal + 10.0)
    simulation.step(strong, 0.002)
    np.testing.assert_allclose(simulation.torque, 0.5 * ROBOT.torque_limit)


def test_a_payload_in_the_hands_is_a_mass_at_each_of_them():
    plain, loaded = Simulation(), Simulation(variation=Variation(hand_payload=3.0))
    rng = np.random.default_rng(0)
    joints, speeds = ROBOT.nominal + rng.normal(0.0, 0.2, 19), rng.normal(0.0, 1.0, 25)
    energies, moments, hands = [], [], []
    for simulation in (plain, loaded):
        simulation.reset(q=joints)
        data = simulation.data
        data.qvel[:] = speeds
        mujoco.mj_forward(simulation.model, data)
        mujoco.mj_energyVel(simulation.model, data)
        energies.append(data.energy[1])
        mass = simulation.model.body_mass.sum()
        moments.append(mass * (data.subtree_com[0] - data.qpos[:3]))
        hands.append([simulation.hand_position(side) - data.qpos[:3] for side in ("left", "right")])
        velocity = np.zeros((2, 6))
        for twist, side in zip(velocity, ("left", "right"), strict=True):
            site = simulation.model.site(f"{side}_hand").id
            mujoco.mj_objectVelocity(simulation.model, data, mujoco.mjtObj.mjOBJ_SITE, site, twist, 0)
    assert loaded.model.body_mass.sum() - plain.model.body_mass.sum() == pytest.approx(6.0)
    assert moments[1] - moments[0] == pytest.approx(3.0 * np.sum(hands[0], axis=0), abs=1e-9)
    assert energies[1] - energies[0] == pytest.approx(1.5 * np.sum(velocity[:, 3:] ** 2), rel=1e-6)
