"""The mirror map: an involution on joints, and an equivariance of the physics."""

import mujoco
import numpy as np

from hugwbc import load_robot, rotations
from hugwbc.robot import _robot_of, load_mirror
from hugwbc.robot_tables import robot_table, table_file
from hugwbc.rotations import AXIAL_SIGNS, VECTOR_SIGNS
from tests.conftest import QUATERNION_SIGNS

ROBOT = load_robot()
MIRROR = load_mirror(load_robot())


def test_signs_are_the_papers() -> None:
    """Yaw and roll joints change sign, pitch joints, knees, ankles and elbows keep it."""
    for name, sign in zip(ROBOT.joint_names, MIRROR.joint_sign, strict=True):
        changes = any(part in name for part in ("yaw", "roll", "torso"))
        assert sign == (-1.0 if changes else 1.0), name


def test_joints_of_no_side_may_have_any_frame() -> None:
    """A waist that turns about the y axis of its frame turns the other way in a mirror, too."""
    table = robot_table("g1")
    rows = {row["name"]: row for row in table["joints"]}
    waist, below = rows["waist_yaw_joint"], rows["waist_roll_joint"]
    assert waist["axis"] == [0, 0, 1] and below["rpy"] == [0, 0, 0]
    x, y, z = below["xyz"]
    waist |= {"rpy": [np.pi / 2, 0.0, 0.0], "axis": [0.0, 1.0, 0.0]}
    below |= {"rpy": [-np.pi / 2, 0.0, 0.0], "xyz": [x, z, -y]}
    turned = _robot_of("g1", table, table_file("g1"))
    np.testing.assert_array_equal(load_mirror(turned).joint_sign, load_mirror(load_robot("g1")).joint_sign)


def test_mirror_is_an_involution_on_joints_and_arms() -> None:
    rng = np.random.default_rng(0)
    joints, arms = rng.normal(size=(7, 19)), rng.normal(size=(7, 8))
    np.testing.assert_array_equal(MIRROR.joints(MIRROR.joints(joints)), joints)
    np.testing.assert_array_equal(MIRROR.arms(MIRROR.arms(arms, ROBOT), ROBOT), arms)
    assert not np.allclose(MIRROR.joints(joints), joints)


def test_mirrored_arms_by_hand() -> None:
    # Left shoulder roll 0.5 outwards is right shoulder roll -0.5 outwards; elbows swap.
    arms = np.array([0.1, 0.5, 0.2, 0.9, 0.0, 0.0, 0.0, -0.3])
    np.testing.assert_allclose(MIRROR.arms(arms, ROBOT), [0, 0, 0, -0.3, 0.1, -0.5, -0.2, 0.9])


def test_nominal_pose_and_limits_are_their_own_mirror_images() -> None:
    np.testing.assert_allclose(MIRROR.joints(ROBOT.nominal), ROBOT.nominal)
    for limit in (ROBOT.kp, ROBOT.kd, ROBOT.torque_limit, ROBOT.velocity_limit):
        np.testing.assert_array_equal(limit[MIRROR.joint_index], limit)
    bounds = np.sort(np.stack((MIRROR.joints(ROBOT.lower), MIRROR.joints(ROBOT.upper))), axis=0)
    np.testing.assert_array_equal(bounds, np.stack((ROBOT.lower, ROBOT.upper)))


def _model(symmetrised: bool) -> mujoco.MjModel:
    """The H1; symmetrised: with the few inertial figures of the maker's that are not symmetric set to their mean.

    The contact solver gets more iterations than in training, so that it converges and the order in which it meets
    the left and right foot does not show.
    """
    model = mujoco.MjModel.from_xml_path(str(ROBOT.xml_path))
    model.opt.iterations, model.opt.ls_iterations, model.opt.tolerance = 100, 50, 1e-12
    if symmetrised:
        for name in ("pelvis", "torso_link"):
            # Centre of mass into the plane y = 0, and principal axes along the link's axes.
            body = model.body(name)
            body.ipos[1] = 0.0
            body.iquat[:] = [1, 0, 0, 0]
        for body in range(1, model.nbody):
            name = model.body(body).name
            if name.startswith("right_"):
                left = model.body(name.replace("right_", "left_"))
                model.body_ipos[body] = left.ipos * VECTOR_SIGNS
                model.body_iquat[body] = left.iquat * QUATERNION_SIGNS
                model.body_inertia[body] = left.inertia
        mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def _mirror_qpos(qpos: np.ndarray) -> np.ndarray:
    return np.concatenate((qpos[:3] * VECTOR_SIGNS, qpos[3:7] * QUATERNION_SIGNS, MIRROR.joints(qpos[7:])))


def _mirror_qvel(qvel: np.ndarray) -> np.ndarray:
    return np.concatenate((qvel[:3] * VECTOR_SIGNS, qvel[3:6] * AXIAL_SIGNS, MIRROR.joints(qvel[6:])))


def _start_on_the_ground(model: mujoco.MjModel, rng: np.random.Generator) -> mujoco.MjData:
    """A disturbed nominal pose with the lowest foot 2 mm in the ground, so that contacts act from the first step."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qpos[3:7] = rotations.from_yaw_pitch_roll(rng.uniform(-3, 3), rng.uniform(-0.1, 0.1), rng.uniform(-0.1, 0.1))
    data.qpos[7:] += rng.uniform(-0.15, 0.15, 19)
    data.qvel[:] = rng.uniform(-0.3, 0.3, 25)
    mujoco.mj_kinematics(model, data)
    spheres = (model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE) & (model.geom_group == 3)
    data.qpos[2] -= (data.geom_xpos[spheres, 2] - model.geom_size[spheres, 0]).min() + 0.002
    return data


def _largest_difference(model: mujoco.MjModel, steps: int) -> tuple[float, int]:
    """Largest difference of a mirrored roll-out's velocity from the mirror image of the roll-out; contacts seen."""
    rng = np.random.default_rng(2)
    worst, contacts = 0.0, 0
    for _ in range(10):
        data, image = _start_on_the_ground(model, rng), mujoco.MjData(model)
        image.qpos[:], image.qvel[:] = _mirror_qpos(data.qpos), _mirror_qvel(data.qvel)
        targets = ROBOT.nominal + rng.uniform(-0.3, 0.3, 19)
        for _ in range(steps):
            torque = rng.uniform(-20, 20, 19)
            data.ctrl[:], image.ctrl[:] = targets, MIRROR.joints(targets)
            data.qfrc_applied[6:], image.qfrc_applied[6:] = torque, MIRROR.joints(torque)
            mujoco.mj_step(model, data)
            mujoco.mj_step(model, image)
            contacts += data.ncon
            worst = max(worst, float(np.abs(_mirror_qvel(data.qvel) - image.qvel).max()))
    return worst, contacts


def test_physics_is_equivariant_with_contacts() -> None:
    """With symmetric inertias only rounding remains."""
    worst, contacts = _largest_difference(_model(symmetrised=True), steps=20)
    assert contacts > 200
    assert worst < 1e-9


def test_physics_of_the_real_table_is_equivariant_to_its_own_asymmetry() -> None:
    """The maker's torso has its centre of mass 2.8 mm to the left: 0.5 Nm of gravity, over 5 ms, on some 0.1 kg m^2."""
    worst, _ = _largest_difference(_model(symmetrised=False), steps=1)
    assert worst < 0.05
