"""Pinocchio against MuJoCo on random states, and the measured commands against the simulator's sensors."""

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from hugwbc import RobotState, load_robot, rotations
from hugwbc.kinematics import Kinematics, pinocchio_model
from hugwbc.robot import SIDES
from tests.conftest import make_state

SITES = ("left_sole", "right_sole", "left_hand", "right_hand", "imu")
STATES = 100


class Twins:
    """A robot in MuJoCo and in Pinocchio."""

    def __init__(self, name: str) -> None:
        self.robot = load_robot(name)
        self.model = mujoco.MjModel.from_xml_path(str(self.robot.xml_path))
        self.data = mujoco.MjData(self.model)
        self.kinematics = Kinematics(self.robot)


@pytest.fixture(scope="module", params=["h1", "g1"])
def twins(request: pytest.FixtureRequest) -> Twins:
    return Twins(request.param)


def _random_state(twins: Twins, rng: np.random.Generator) -> RobotState:
    """A random configuration within the joint limits, anywhere and any way up, set in MuJoCo."""
    data, robot = twins.data, twins.robot
    data.qpos[:3] = rng.uniform(-3, 3, 3)
    data.qpos[3:7] = rng.normal(size=4)
    data.qpos[3:7] /= np.linalg.norm(data.qpos[3:7])
    data.qpos[7:] = rng.uniform(robot.lower, robot.upper)
    data.qvel[:] = rng.uniform(-3, 3, twins.model.nv)
    mujoco.mj_fwdPosition(twins.model, data)
    mujoco.mj_fwdVelocity(twins.model, data)
    return RobotState(
        q=data.qpos[7:].copy(),
        dq=data.qvel[6:].copy(),
        orientation=data.qpos[3:7].copy(),
        angular_velocity=data.qvel[3:6].copy(),
        position=data.qpos[:3].copy(),
        velocity=data.qvel[:3].copy(),
    )


def _velocity_map(state: RobotState, kinematics: Kinematics) -> np.ndarray:
    """T with v_pinocchio = T v_mujoco: world to body axes for the linear velocity, joints by name."""
    n = kinematics.model.nv
    T = np.zeros((n, n))
    T[:3, :3] = rotations.to_matrix(state.orientation).T
    T[3:6, 3:6] = np.eye(3)
    T[kinematics.columns, np.arange(6, n)] = 1.0
    return T


def test_total_mass(twins: Twins) -> None:
    robot, model = twins.robot, twins.model
    masses = [inertia.mass for inertia in pinocchio_model(twins.robot).inertias]
    assert sum(masses) == pytest.approx(robot.mass, abs=1e-9)
    assert model.body_mass.sum() == pytest.approx(robot.mass, abs=1e-9)


def test_frames_and_centre_of_mass_agree(twins: Twins) -> None:
    kinematics, data = twins.kinematics, twins.data
    rng = np.random.default_rng(0)
    for _ in range(STATES):
        kinematics.update(_random_state(twins, rng))
        for name in SITES:
            site = data.site(name)
            np.testing.assert_allclose(kinematics.position(name), site.xpos, atol=1e-6)
            np.testing.assert_allclose(kinematics.rotation(name), site.xmat.reshape(3, 3), atol=1e-6)
        np.testing.assert_allclose(kinematics.centre_of_mass(), data.subtree_com[1], atol=1e-6)


def test_jacobians_agree(twins: Twins) -> None:
    model, kinematics, data = twins.model, twins.kinematics, twins.data
    rng = np.random.default_rng(2)
    pin_data = kinematics.model.createData()
    linear, angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    for _ in range(STATES):
        state = _random_state(twins, rng)
        kinematics.update(state)
        T = _velocity_map(state, kinematics)
        pin.computeJointJacobians(kinematics.model, pin_data, kinematics.q)
        for name in SITES:
            frame = kinematics.frame_id(name)
            jacobian = pin.getFrameJacobian(kinematics.model, pin_data, frame, pin.LOCAL_WORLD_ALIGNED) @ T
            mujoco.mj_jacSite(model, data, linear, angular, model.site(name).id)
            np.testing.assert_allclose(jacobian, np.vstack((linear, angular)), atol=1e-6)
            np.testing.assert_allclose(kinematics.velocity(name), np.vstack((linear, angular)) @ data.qvel, atol=1e-6)


def test_toe_and_heel_are_the_ends_of_the_sole(twins: Twins) -> None:
    kinematics = twins.kinematics
    kinematics.update(_random_state(twins, np.random.default_rng(4)))
    toe, heel, sole = (kinematics.position(f"left_{part}") for part in ("toe", "heel", "sole"))
    np.testing.assert_allclose((toe + heel) / 2, sole, atol=1e-12)
    assert np.linalg.norm(toe - heel) == pytest.approx(np.ptp(twins.robot.sole_x), abs=1e-12)


def test_measured_commands_by_hand() -> None:
    """Pelvis at 0.78 m over ground at 0.1 m, heading 90 degrees, pitched 0.3, moving along world y and turning."""
    robot = load_robot()
    kinematics = Kinematics(robot)
    turning = rotations.rotate_inverse(rotations.from_yaw_pitch_roll(np.pi / 2, 0.3, 0.0), np.array([0.0, 0.0, 0.7]))
    q = robot.nominal.copy()
    q[robot.waist] = 0.4
    moving = {"angular_velocity": turning, "position": (1.0, 2.0, 0.78), "velocity": (-0.2, 0.5, 0.1)}
    kinematics.update(make_state(q, yaw=np.pi / 2, pitch=0.3, **moving))
    measured = kinematics.measured(ground_height=0.1)
    # Heading along +y: forward is +y, left is -x.
    np.testing.assert_allclose((measured.v_x, measured.v_y, measured.omega), (0.5, 0.2, 0.7), atol=1e-12)
    np.testing.assert_allclose((measured.h, measured.p, measured.w), (-0.30, 0.3, 0.4), atol=1e-12)
    soles = np.array([kinematics.position(f"{side}_sole")[2] for side in SIDES])
    np.testing.assert_allclose(measured.clearance, soles - 0.1)
    uneven = kinematics.measured(0.1, sole_ground=(0.05, -0.02))
    np.testing.assert_allclose(uneven.clearance, soles - (0.05, -0.02))
    assert uneven.h == measured.h


def test_measured_needs_position_and_velocity() -> None:
    kinematics = Kinematics(load_robot())
    for state in (make_state(), make_state(position=np.zeros(3))):
        kinematics.update(state)
        with pytest.raises(ValueError, match="position and velocity"):
            kinematics.measured()
        assert np.isfinite(kinematics.position("left_sole")).all()


def test_measured_commands_agree_with_the_simulators_sensors(twins: Twins) -> None:
    robot, model, kinematics, data = twins.robot, twins.model, twins.kinematics, twins.data
    rng = np.random.default_rng(5)
    pelvis = model.body(robot.base).id
    for _ in range(STATES):
        state = _random_state(twins, rng)
        mujoco.mj_sensorPos(model, data)
        mujoco.mj_sensorVel(model, data)
        kinematics.update(state)
        measured = kinematics.measured()
        rotation = data.xmat[pelvis].reshape(3, 3)
        assert measured.h == pytest.approx(data.xpos[pelvis, 2] - robot.nominal_height, abs=1e-6)
        assert measured.p == pytest.approx(np.arcsin(-rotation[2, 0]), abs=1e-6)
        assert measured.w == pytest.approx(data.qpos[7 + robot.waist], abs=1e-12)
        soles = [data.sensor(f"{side}_sole_position").data[2] for side in ("left", "right")]
        np.testing.assert_allclose(measured.clearance, soles, atol=1e-6)
        velocity = np.zeros(6)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, pelvis, velocity, 0)
        assert measured.omega == pytest.approx(velocity[2], abs=1e-6)
        heading = rotation[:2, 0] / np.linalg.norm(rotation[:2, 0])
        assert measured.v_x == pytest.approx(heading @ data.qvel[:2], abs=1e-6)
        assert measured.v_y == pytest.approx(heading[0] * data.qvel[1] - heading[1] * data.qvel[0], abs=1e-6)
        for side in ("left", "right"):
            sole = data.sensor(f"{side}_sole_velocity").data
            np.testing.assert_allclose(kinematics.velocity(f"{side}_sole")[:3], sole, atol=1e-6)
