"""A robot in somebody else's model: what is told, how it is driven, what is refused."""

from collections.abc import Callable

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from hugwbc import Command, Gait
from hugwbc.controller import Controller, JointCommand
from hugwbc.errors import ConfigError, ModelError
from hugwbc.kinematics import Kinematics, pinocchio_model
from hugwbc.mbc import WholeBodyController
from hugwbc.robot import Robot, load_robot
from hugwbc.runtime import load_controller
from hugwbc.runtime.mujoco_robot import MujocoRobot
from hugwbc.scripts.view import Grip

ROBOT, G1 = load_robot(), load_robot("g1")
pytestmark = pytest.mark.filterwarnings("ignore:Attach conflict")  # the scene keeps its own physics
AFFINE, PLAIN = mujoco.mjtBias.mjBIAS_AFFINE, mujoco.mjtBias.mjBIAS_NONE


def lab(
    *prefixes: str,
    servos: bool = True,
    change: Callable[[mujoco.MjSpec], object] = lambda robot: None,
    ours: Robot = ROBOT,
) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return a scene with a ball on a string, a drawer and robots that differ from ours in names, masses and drives."""
    scene = mujoco.MjSpec()
    scene.option.timestep = 0.002
    scene.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[20, 20, 1], friction=[1, 0.005, 0.0001])
    for name, kind, place in (
        ("ball", "BALL", (3, 1, 2)),
        ("drawer", "SLIDE", (3, 2, 1)),
        ("box", "FREE", (3, 0, 0.1)),
    ):
        body = scene.worldbody.add_body(name=name, pos=place)
        body.add_joint(name=f"{name}_joint", type=getattr(mujoco.mjtJoint, f"mjJNT_{kind}"))
        body.add_geom(size=[0.1, 0.1, 0.1])
    for prefix in prefixes or ("lab/",):
        robot = mujoco.MjSpec.from_file(str(ours.xml_path))
        for part in (*robot.keys, *robot.sensors, robot.geom("floor")):
            robot.delete(part)
        for body in robot.bodies[1:]:
            body.mass *= 0.9
            body.fullinertia = 0.9 * body.fullinertia
        for joint in robot.joints[1:]:
            joint.name, joint.armature, joint.damping[0] = joint.name.removesuffix("_joint"), 0.1, 1.0
        for servo in robot.actuators:
            i = ours.index(servo.name)
            stiff = 100.0 if i in ours.arms else ours.kp[i]
            gain = stiff if servos else 0.5
            servo.target = servo.target.removesuffix("_joint")
            servo.gainprm[0], servo.biastype = gain, AFFINE if servos else PLAIN
            servo.biasprm[1:3] = (-stiff, -2.0) if servos else (0.0, 0.0)
            most = 2.0 * ours.torque_limit[i]
            servo.ctrllimited, servo.ctrlrange = True, (ours.lower[i], ours.upper[i]) if servos else (-most, most)
        change(robot)
        scene.attach(robot, prefix=prefix, frame=scene.worldbody.add_frame())
    model = scene.compile()
    return model, mujoco.MjData(model)


def run(
    controller: Controller,
    robot: MujocoRobot,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    seconds: float,
    speed: float = 0.5,
) -> None:
    """Walk at a speed [m/s], with inputs that are kept for 20 ms."""
    kept = 0.02
    robot.stand()
    control = robot.control_period(controller, Command.from_mapping({"v_x": speed}, Gait.WALKING, robot.robot))
    control.start(robot.state(), data.time)
    for _ in range(round(seconds / kept)):
        control.observe(robot.state(), data.time)
        robot.apply(control.decide(data.time))
        mujoco.mj_step(model, data, round(kept / model.opt.timestep))


@pytest.mark.parametrize(
    ("ours", "name", "servos", "speed"),
    [
        ("h1", "qp", True, 0.5),
        ("h1", "qp", False, 0.5),
        ("h1", "learned", True, 0.5),
        ("h1", "learned", False, 0.5),
        ("g1", "qp", True, 0.3),
    ],
)
def test_both_controllers_walk_in_it(ours: str, name: str, servos: bool, speed: float) -> None:
    model, data = lab(servos=servos, ours=load_robot(ours))
    robot = MujocoRobot(model, data, ours)
    controller = WholeBodyController(robot=robot.robot, period=0.02) if name == "qp" else load_controller(name)
    run(controller, robot, model, data, 2.5, speed)
    state = robot.state()
    assert state.position is not None and state.position[2] > 0.9 * robot.robot.nominal_height
    assert 1.2 * speed < state.position[0] < 2.8 * speed


def test_inputs_that_are_kept_for_longer_than_the_period_are_refused() -> None:
    model, data = lab()
    robot = MujocoRobot(model, data)
    with pytest.raises(ConfigError, match=r"kept for 20 ms, and the period of qp is 4 ms.*period=0\.02"):
        run(WholeBodyController(robot=robot.robot), robot, model, data, 1.0)
    assert data.time == pytest.approx(0.02), "with the second inputs"
    robot.control_period(WholeBodyController(robot=robot.robot), Command())
    hold = JointCommand.position(robot.robot, robot.robot.nominal)
    robot.apply(hold)  # no other inputs were kept yet
    data.time += 0.04
    robot.stand()
    robot.apply(hold)  # nor in another run
    data.time += 0.2
    with pytest.raises(ConfigError, match="kept for 200 ms"):
        robot.apply(hold)


@pytest.mark.parametrize("ours", [ROBOT, G1], ids=lambda ours: ours.name)
def test_controllers_are_told_the_models_dynamics(ours: Robot) -> None:
    model, data = lab(ours=ours)
    robot = MujocoRobot(model, data, ours)
    told = robot.robot
    assert robot.prefix == "lab/" and robot.extra_joints == ()
    weights = [model.body(i).mass[0] for i in range(model.nbody) if model.body(i).name.startswith("lab/")]
    assert told.mass == pytest.approx(sum(weights)) == pytest.approx(0.9 * ours.mass)
    data.qpos[robot._q] = np.random.default_rng(0).uniform(-0.4, 0.4, len(ours.joint_names))
    mujoco.mj_forward(model, data)
    mine, theirs = pinocchio_model(told), np.zeros((model.nv, model.nv))
    kinematics = Kinematics(told)
    kinematics.update(robot.state())
    mass = pin.crba(mine, mine.createData(), kinematics.q)
    mujoco.mj_fullM(model, data, theirs)
    columns = np.r_[0:6, kinematics.columns]
    rows = np.r_[robot._twist, robot._dq]
    np.testing.assert_allclose(mass[np.ix_(columns, columns)], theirs[np.ix_(rows, rows)], atol=1e-6)
    assert (told.damping == 1.0).all() and told.command_delay == 0.0 and not told.friction.any()
    np.testing.assert_allclose(told.torque_limit, model.actuator_forcerange[:, 1])


@pytest.mark.parametrize("ours", [ROBOT, G1], ids=lambda ours: ours.name)
@pytest.mark.parametrize("servos", [True, False])
def test_an_actuator_gives_the_torque_of_a_command(servos: bool, ours: Robot) -> None:
    model, data = lab(servos=servos, ours=ours)
    robot, draw, n = MujocoRobot(model, data, ours), np.random.default_rng(1), len(ours.joint_names)
    robot.stand()
    data.qvel[robot._dq] = draw.normal(0.0, 0.3, n)
    q, dq = data.qpos[robot._q], data.qvel[robot._dq]
    command = JointCommand(q + 0.01, dq - 0.2, draw.uniform(0, 40, n), draw.uniform(0, 2, n), draw.uniform(-2, 2, n))
    robot.apply(command)
    mujoco.mj_forward(model, data)
    wanted = command.tau + command.kp * (command.q - q) + command.kd * (command.dq - dq)
    np.testing.assert_allclose(data.qfrc_actuator[robot._dq], wanted, atol=1e-9)
    assert not robot.clipped
    robot.apply(JointCommand(q, dq, command.kp, command.kd, np.full(n, 1e3)))
    assert set(robot.clipped) == set(ours.joint_names)
    before = data.ctrl[robot.actuators].copy()
    robot.clipped.clear()
    robot.apply(JointCommand(np.full(n, np.nan), dq, command.kp, command.kd, command.tau))
    np.testing.assert_array_equal(data.ctrl[robot.actuators], before)
    assert set(robot.clipped) == set(ours.joint_names)


def test_a_torque_that_the_joint_itself_does_not_take_is_clipped_and_counted() -> None:
    """MuJoCo Menagerie's G1 has its limits of torque at the joints."""

    def limited(robot: mujoco.MjSpec) -> None:
        for joint in robot.joints[1:]:
            joint.actfrclimited, joint.actfrcrange = True, (-3.0, 5.0)
        robot.actuators[0].gear[0] = -2.0

    model, data = lab(servos=False, change=limited)
    robot, n = MujocoRobot(model, data), ROBOT.kp.size
    np.testing.assert_allclose(robot.robot.torque_limit, 3.0)
    robot.stand()
    for tau, given, clipped in ((4.0, 4.0, 0), (7.0, 5.0, n), (-4.0, -3.0, n)):
        robot.clipped.clear()
        robot.apply(JointCommand(ROBOT.nominal, np.zeros(n), np.zeros(n), np.zeros(n), np.full(n, tau)))
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.qfrc_actuator[robot._dq], given)
        assert robot.clipped.total() == clipped


def test_feet_feel_the_weight_and_objects_are_seen() -> None:
    model, data = lab()
    robot = MujocoRobot(model, data)
    run(WholeBodyController(robot=robot.robot, period=0.02), robot, model, data, 0.2)
    state = robot.state()
    assert state.foot_force is not None and not np.any(state.hand_force)
    assert state.foot_force[:, 2].sum() == pytest.approx(9.81 * robot.robot.mass, rel=0.3)
    assert robot.names == ("ball", "drawer", "box")
    np.testing.assert_allclose(robot.picture().poses[0, :3], data.body("ball").xpos)
    robot.grip((Grip("left", "ball"),))
    assert robot.problems == ["the left gripper was asked for 'ball', and there are no grippers"]


def test_a_cloth_on_the_floor_is_no_force_on_the_robot() -> None:
    scene = mujoco.MjSpec.from_string(
        '<mujoco><worldbody><geom type="plane" size="9 9 1"/><flexcomp name="cloth" type="grid" count="4 4 1" '
        'spacing="0.1 0.1 0.1" dim="2" mass="5" pos="3 0 0.009" radius="0.01"/></worldbody></mujoco>'
    )
    scene.attach(mujoco.MjSpec.from_file(str(ROBOT.xml_path)), prefix="lab/", frame=scene.worldbody.add_frame())
    scene.delete(scene.geom("lab/floor"))
    model = scene.compile()
    data = mujoco.MjData(model)
    robot = MujocoRobot(model, data, prefix="lab/")
    data.qpos[model.joint("lab/root").qposadr[0] + 2] = 3.0
    for _ in range(20):
        mujoco.mj_step(model, data)
    assert (data.contact.geom < 0).any()
    state = robot.state()
    assert not np.any(state.hand_force) and not np.any(state.foot_force)


def test_the_hand_is_where_the_model_has_it() -> None:
    def further(robot: mujoco.MjSpec) -> None:
        robot.site("left_hand").pos = robot.site("right_hand").pos = (0.31, 0.0, -0.01)

    model, data = lab(change=further)
    robot = MujocoRobot(model, data)
    robot.stand(x=1.0, yaw=0.7)
    kinematics = Kinematics(robot.robot)
    kinematics.update(robot.state())
    for side in ("left", "right"):
        np.testing.assert_allclose(kinematics.position(f"{side}_hand"), data.site(f"lab/{side}_hand").xpos, atol=1e-6)


def test_short_feet_are_told() -> None:
    def shorter(robot: mujoco.MjSpec) -> None:
        for geom in robot.geoms:
            if geom.parent.name.endswith("ankle_link") and geom.classname.name == "foot":
                geom.pos = geom.pos * [0.5, 1.0, 1.0]

    told, other = (MujocoRobot(*lab(change=change)).robot for change in (shorter, lambda robot: None))
    assert other.sole_x == ROBOT.sole_x and other.sole_y == ROBOT.sole_y
    np.testing.assert_allclose(told.sole_x, (-0.05, 0.10))
    kinematics = Kinematics(told)
    kinematics.update(MujocoRobot(*lab()).state())
    assert np.linalg.norm(kinematics.position("left_toe") - kinematics.position("left_heel")) == pytest.approx(0.15)


def test_thick_soles_stand_on_the_ground_and_not_in_it() -> None:
    def thicker(robot: mujoco.MjSpec) -> None:
        for geom in robot.geoms:
            if geom.parent.name.endswith("ankle_link") and geom.classname.name == "foot":
                geom.pos = geom.pos - [0.0, 0.0, 0.02]

    model, data = lab(change=thicker)
    robot = MujocoRobot(model, data)
    robot.stand(x=1.0, ground=0.3)
    kinematics = Kinematics(robot.robot)
    kinematics.update(robot.state())
    assert kinematics.position("left_sole")[2] == pytest.approx(0.3, abs=2e-3)


def _lacking(robot: mujoco.MjSpec) -> None:
    robot.delete(robot.joint("left_knee"))


def _sliding(robot: mujoco.MjSpec) -> None:
    robot.joint("left_knee").type = mujoco.mjtJoint.mjJNT_SLIDE


def _bent(robot: mujoco.MjSpec) -> None:
    robot.joint("left_knee").axis = (0, -1, 0)


def _longer(robot: mujoco.MjSpec) -> None:
    robot.body("left_ankle_link").pos = (0, 0, -0.45)
    robot.body("left_knee_link").pos = (0.03, 0, -0.4)


def _more_jointed(robot: mujoco.MjSpec) -> None:
    robot.body("torso_link").add_joint(name="lean", axis=(0, 1, 0))


def _fixed(robot: mujoco.MjSpec) -> None:
    robot.delete(robot.joint("root"))


def _undriven(robot: mujoco.MjSpec) -> None:
    robot.delete(robot.actuator("left_knee_joint"))


def _slow(robot: mujoco.MjSpec) -> None:
    robot.actuator("left_knee_joint").dyntype = mujoco.mjtDyn.mjDYN_FILTER


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_lacking, "the model lacks the joints of h1 (prefix 'lab/'): left_knee_joint; it has: "),
        (_sliding, "joint 'lab/left_knee' is no hinge"),
        (_bent, "joint 'lab/left_knee' with all joints at 0 has an axis along [ 0. -1.  0.]"),
        (_longer, "joint 'lab/left_knee' with all joints at 0 has an axis along [0. 1. 0.], 3.0 cm from that"),
        (_more_jointed, "joint 'lab/lean' moves joints of h1, which lacks it"),
        (_fixed, "body 'lab/pelvis' has no free joint"),
        (_undriven, "joint 'lab/left_knee' has the actuators: none"),
        (_slow, "joint 'lab/left_knee' has the actuators: 'lab/left_knee_joint'; give it one motor or one position"),
    ],
)
def test_a_model_that_is_not_the_robot_is_refused(change: Callable[[mujoco.MjSpec], None], message: str) -> None:
    with pytest.raises(ModelError) as error:
        MujocoRobot(*lab(change=change))
    assert message in str(error.value)


def test_one_of_two_robots_is_chosen_by_its_prefix() -> None:
    model, data = lab("a/", "b/")
    with pytest.raises(ModelError, match="several h1: give one of the prefixes 'a/', 'b/'"):
        MujocoRobot(model, data)
    robot = MujocoRobot(model, data, prefix="b/")
    robot.stand(x=2.0)
    assert data.body("b/pelvis").xpos[0] == 2.0 and data.body("a/pelvis").xpos[0] == 0.0
    assert "a/pelvis" in robot.names and "b/pelvis" not in robot.names


def test_other_names_are_told_and_fingers_count_as_rigid() -> None:
    def renamed(robot: mujoco.MjSpec) -> None:
        robot.joint("torso").name = robot.actuator("torso_joint").target = "waist"
        finger = robot.body("left_elbow_link").add_body(name="finger", pos=(0.3, 0, 0))
        finger.add_joint(name="grasp")
        finger.add_geom(size=[0.01, 0.01, 0.01], mass=0.2)

    model, data = lab(change=renamed)
    with pytest.raises(ModelError, match="torso_joint"):
        MujocoRobot(model, data)
    robot = MujocoRobot(model, data, joints={"torso_joint": "waist"})
    assert robot.extra_joints == ("lab/grasp",)
    assert robot.robot.mass == pytest.approx(0.9 * ROBOT.mass + 0.2)
