"""PhysX against MuJoCo: the same robot falls, swings, stands, slides and walks alike in both engines."""

import dataclasses

import mujoco
import numpy as np
import pytest

from hugwbc import JointCommand, load_robot, rotations
from hugwbc.commands import Command
from hugwbc.errors import ConfigError
from hugwbc.gait import Gait
from hugwbc.runtime.controllers import ControllerSpec
from hugwbc.runtime.estimation import StateEstimator
from hugwbc.runtime.rollout import rollout
from hugwbc.scripts.view import Constant
from hugwbc.sim import Actuators, Force, Ground, HeightField, Simulation, Variation
from hugwbc.sim.physx import PhysxSimulation
from hugwbc.state import pelvis_from_imu

ROBOT = load_robot()
WEIGHT = ROBOT.mass * 9.81
HOLD = JointCommand.position(ROBOT, ROBOT.nominal)
FIRM = Ground.named("firm")
LIMP = JointCommand(*(np.zeros(19) for _ in range(5)))
STIFF = JointCommand(ROBOT.nominal, np.zeros(19), 5.0 * ROBOT.kp, 3.0 * ROBOT.kd, np.zeros(19))
HEIGHT = 3.0  # [m], far above the ground


class HungPhysx(PhysxSimulation):
    _fixed_pelvis = True


def in_mujoco(simulation: Simulation, position: np.ndarray, q: np.ndarray, velocity: np.ndarray) -> None:
    simulation.data.qpos[:3], simulation.data.qpos[7:], simulation.data.qvel[:] = position, q, velocity
    mujoco.mj_forward(simulation.model, simulation.data)


def in_physx(simulation: PhysxSimulation, position: np.ndarray, q: np.ndarray, velocity: np.ndarray) -> None:
    simulation._place(position, np.array([1.0, 0.0, 0.0, 0.0]), q)
    simulation._articulation.set_qvel(velocity[6 + simulation._columns].astype(np.float32))
    simulation.push(velocity[:6])


def hung(q: np.ndarray, **settings) -> tuple[Simulation, PhysxSimulation]:
    """Return robots with the pelvis held in the air: in MuJoCo by an enormous inertia."""
    one, other = Simulation(sensing="exact", ground=FIRM, **settings), HungPhysx(**settings)
    one.model.dof_armature[:6] = 1e6
    in_mujoco(one, np.array([0.0, 0.0, HEIGHT]), q, np.zeros(25))
    in_physx(other, np.array([0.0, 0.0, HEIGHT]), q, np.zeros(25))
    return one, other


@pytest.fixture(scope="module")
def plane() -> PhysxSimulation:
    return PhysxSimulation(sensing="exact")


def test_every_link_is_where_it_is_in_mujoco_and_weighs_the_same() -> None:
    for name in ("h1", "h1-2023", "g1"):
        robot = load_robot(name)
        one, other = Simulation(sensing="exact", robot=robot), PhysxSimulation(sensing="exact", robot=robot)
        q = np.random.default_rng(0).uniform(robot.lower, robot.upper)
        first, second = one.reset(q=q, xy=(1.0, -2.0), yaw=0.7), other.reset(q=q, xy=(1.0, -2.0), yaw=0.7)
        np.testing.assert_allclose(second.position, first.position, atol=1e-6)
        np.testing.assert_allclose(second.orientation, first.orientation, atol=1e-6)
        np.testing.assert_allclose(second.q, first.q, atol=1e-6)
        assert set(one.link_names) == set(other.link_names)
        for link, body in other._links.items():
            np.testing.assert_allclose(body.entity_pose.p, one.data.body(link).xpos, atol=2e-6)
            assert body.mass == pytest.approx(one.model.body(link).mass[0])
        for side in ("left", "right"):
            np.testing.assert_allclose(other.hand_position(side), one.hand_position(side), atol=2e-6)


def test_a_limp_robot_falls_and_tumbles_alike() -> None:
    """Thrown with every joint in motion: the whole mass matrix and all velocity terms take part."""
    one, other = Simulation(sensing="exact", timestep=0.001), PhysxSimulation(sensing="exact", timestep=0.001)
    velocity = np.random.default_rng(1).uniform(-1.0, 1.0, 25)
    start = np.array([0.0, 0.0, HEIGHT])
    in_mujoco(one, start, ROBOT.nominal, velocity)
    in_physx(other, start, ROBOT.nominal, velocity)
    np.testing.assert_allclose(other.qvel, one.qvel, atol=1e-6)
    first, second = one.step(LIMP, 0.25), other.step(LIMP, 0.25)
    np.testing.assert_allclose(second.position, first.position, atol=0.002)
    np.testing.assert_allclose(second.q, first.q, atol=0.02)
    assert abs(second.orientation @ first.orientation) > 0.99999


def test_nothing_but_gravity_acts_in_flight(plane: PhysxSimulation) -> None:
    """A robot that holds its joints flies on a parabola, and turns without friction."""
    start = np.array([0.0, 0.0, HEIGHT])
    plane.reset()
    in_physx(plane, start, ROBOT.nominal, np.concatenate(([1.0, -0.5, 2.0], np.zeros(22))))
    state = plane.step(HOLD, 0.4)
    np.testing.assert_allclose(state.position - start, [0.4, -0.2, 0.8 - 0.5 * 9.81 * 0.16], atol=0.004)
    np.testing.assert_allclose(state.velocity, [1.0, -0.5, 2.0 - 9.81 * 0.4], atol=0.002)
    np.testing.assert_allclose(state.torque, 0.0, atol=0.05)
    np.testing.assert_allclose(plane.sense().imu_accelerometer, 0.0, atol=0.05)


@pytest.mark.parametrize("joint", ROBOT.joint_names)
def test_each_joint_is_the_same_pendulum(joint: str) -> None:
    """A joint swings on a soft spring while the others are held: its inertia, rotor and gravity set the period."""
    index = ROBOT.index(joint)
    kp, kd = 4.0 * ROBOT.kp, 4.0 * ROBOT.kd
    kp[index], kd[index] = max(15.0, 0.3 * ROBOT.kp[index]), 0.0
    q = ROBOT.nominal.copy()
    q[index] += 0.2
    one, other = hung(q)
    command = JointCommand(ROBOT.nominal, np.zeros(19), kp, kd, np.zeros(19))
    swings = np.array([[s.step(command, 0.01).q[index] for s in (one, other)] for _ in range(100)])
    assert np.ptp(swings[:, 0]) > 0.1, "it swings"
    np.testing.assert_allclose(swings[:, 1], swings[:, 0], atol=0.03 * np.ptp(swings[:, 0]))


def test_real_drives_are_alike() -> None:
    """Friction, delay and torque-speed limit: all joints jerk from side to side."""
    one, other = hung(ROBOT.nominal, actuators=Actuators())
    first, second = [], []
    for beat in range(8):
        target = ROBOT.nominal + (0.12 if beat % 2 else -0.12)
        command = JointCommand(target, np.zeros(19), ROBOT.kp, ROBOT.kd, np.zeros(19))
        for _ in range(5):
            first.append(one.step(command, 0.02).q)
            second.append(other.step(command, 0.02).q)
    np.testing.assert_allclose(second, first, atol=0.03)


def test_coulomb_friction_holds_a_joint() -> None:
    index = ROBOT.index("left_elbow_joint")
    tau = np.zeros(19)
    for factor, moves in ((0.9, False), (1.5, True)):
        _, simulation = hung(ROBOT.nominal, actuators=dataclasses.replace(Actuators.ideal(), friction=1.0))
        for link in simulation._links.values():
            link.disable_gravity = True
        tau[index] = factor * ROBOT.friction[index]
        q = simulation.step(JointCommand(*(np.zeros(19) for _ in range(4)), tau), 0.5).q
        assert (abs(q[index]) > 0.05) == moves


def test_standing_torques_agree(plane: PhysxSimulation) -> None:
    one = Simulation(sensing="exact", ground=FIRM)
    one.reset(), plane.reset()
    for _ in range(6):  # later it tips over backwards
        first, second = one.step(HOLD, 0.1), plane.step(HOLD, 0.1)
    # Feet can press against each other sideways; how much, MuJoCo's creeping soles and PhysX's still ones do not share.
    np.testing.assert_allclose(second.torque, first.torque, atol=1.0)
    np.testing.assert_allclose(second.position, first.position, atol=0.001)
    assert second.foot_force[:, 2].sum() == pytest.approx(first.foot_force[:, 2].sum(), rel=0.03)
    np.testing.assert_allclose(plane.pressure_centres, one.pressure_centres, atol=0.01)
    assert np.abs(plane.pressure_centres[:, 2]).max() < 0.001, "feet neither sink nor hover"


@pytest.mark.parametrize("direction", [(0.4, 0.0, 0.0), (0.0, 0.3, 0.0), (-0.3, -0.2, 0.0)])
def test_a_rigid_stance_gives_way_to_a_push_alike(plane: PhysxSimulation, direction: tuple[float, ...]) -> None:
    """Stiff joints on firm ground: what remains is the contact of the soles."""
    paths = []
    for simulation in (Simulation(sensing="exact", ground=FIRM), plane):
        simulation.reset()
        simulation.step(STIFF, 0.3)
        simulation.push(np.array(direction))
        paths.append([simulation.step(STIFF, 0.01).position for _ in range(30)])
    moved = np.abs(np.array(paths[0]) - paths[0][0]).max()
    assert moved > 0.005
    np.testing.assert_allclose(paths[1], paths[0], atol=max(0.15 * moved, 0.003))


def test_soles_slide_alike_on_slippery_ground() -> None:
    """The soles slip apart, so they resist no pull at all: friction of PhysX is a cone, so MuJoCo's must be one too."""
    slippery, pull = Variation(friction=0.1), np.array([0.0, 0.05 * WEIGHT, 0.0])
    shifts = []
    one = Simulation(sensing="exact", variation=slippery, ground=FIRM)
    one.model.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    for simulation in (one, PhysxSimulation(sensing="exact", variation=slippery)):
        simulation.step(HOLD, 0.2)
        before = simulation.qpos[:2]
        simulation.apply_force(pull, 0.4, "pelvis")
        simulation.step(HOLD, 0.4)
        shifts.append(simulation.qpos[:2] - before)
    assert np.abs(shifts[0]).min() > 0.02
    np.testing.assert_allclose(shifts[1], shifts[0], atol=0.004)


def test_readings_are_those_of_the_torso_s_imu(plane: PhysxSimulation) -> None:
    """The accelerometer's mean is gravity at rest; gyro and orientation lead back to the pelvis."""
    plane.reset(yaw=0.5)
    plane.push(np.array([0.2, 0.1, 0.0, 0.1, 0.2, 0.3]))
    state, sensed = plane.step(HOLD, 0.1), plane.sense()
    assert sensed.imu_gyro is not None
    np.testing.assert_allclose(sensed.angular_velocity, state.angular_velocity, atol=1e-4)
    np.testing.assert_allclose(np.abs(sensed.orientation @ state.orientation), 1.0, atol=1e-6)
    reading = plane._reading()
    waist = ROBOT.waist
    _, rate = pelvis_from_imu(reading.imu_orientation, reading.imu_gyro, state.q[waist], state.dq[waist])
    np.testing.assert_allclose(rate, state.angular_velocity, atol=1e-4)
    plane.reset()
    plane.step(STIFF, 0.3)
    specific = []
    for _ in range(100):
        plane.step(STIFF, 0.002)
        specific.append(plane.sense().imu_accelerometer)
    assert np.linalg.norm(np.mean(specific, axis=0)) == pytest.approx(9.81, abs=0.1)


def test_a_push_changes_the_pelvis_velocity_at_once(plane: PhysxSimulation) -> None:
    plane.reset(yaw=1.0)
    plane.push(np.array([0.3, -0.2, 0.1, 0.4, 0.5, -0.6]))
    np.testing.assert_allclose(plane.state().velocity, [0.3, -0.2, 0.1], atol=1e-5)
    np.testing.assert_allclose(plane.state().angular_velocity, [0.4, 0.5, -0.6], atol=1e-5)


def test_a_force_gives_its_impulse_and_ends(plane: PhysxSimulation) -> None:
    plane.reset()
    in_physx(plane, np.array([0.0, 0.0, HEIGHT]), ROBOT.nominal, np.zeros(25))
    plane.apply_force(np.array([100.0, -50.0, 0.0]), 0.1, "torso_link")
    plane.step(HOLD, 0.3)
    momentum = sum(link.mass * np.array(link.linear_velocity) for link in plane._links.values())
    np.testing.assert_allclose(momentum[:2], [10.0, -5.0], atol=0.02)
    assert not plane.external_force.any()


def test_a_failure_of_the_physics_is_a_fall_and_leaves_a_valid_state(plane: PhysxSimulation) -> None:
    plane.reset()
    plane._articulation.set_root_linear_velocity(np.full(3, np.nan))
    state = plane.step(HOLD, 0.01)
    assert state.is_finite and plane.diverged and plane.fallen
    assert plane.reset().is_finite and not plane.fallen
    assert plane.step(HOLD, 0.1).is_finite and not plane.fallen


def test_a_limp_robot_falls_down(plane: PhysxSimulation) -> None:
    plane.reset()
    for _ in range(40):
        plane.step(LIMP, 0.05)
    assert plane.fallen
    assert plane.state().position[2] > 0.0, "the links lie on the ground"


def test_a_used_robot_runs_as_a_new_one_to_the_last_bit(plane: PhysxSimulation) -> None:
    plane.step(LIMP, 0.2)
    plane.reset()
    ends = []
    for simulation in (plane, PhysxSimulation(sensing="exact")):
        simulation.push(np.array([0.3, 0.2, 0.0]))
        ends.append(simulation.step(HOLD, 0.3).q)
    np.testing.assert_array_equal(*ends)


def test_what_it_does_not_have_is_refused() -> None:
    with pytest.raises(ConfigError, match="level ground only; use --engine mujoco"):
        PhysxSimulation(sensing="exact", terrain=HeightField(np.zeros((3, 3)), (4.0, 4.0)))
    with pytest.raises(ConfigError, match="no payload in the hands"):
        PhysxSimulation(variation=Variation(hand_payload=3.0))
    with pytest.raises(ConfigError, match="firm ground only; use --ground firm"):
        PhysxSimulation(sensing="exact", ground=Ground.named("soft"))


@pytest.mark.parametrize("controller", ["qp", "learned"])
def test_a_controller_walks_in_both_engines_alike(controller: str) -> None:
    speeds = []
    for simulation in (Simulation(sensing="exact", ground=FIRM), PhysxSimulation(sensing="exact")):
        source = Constant(Command(v_x=0.5, gait=Gait.WALKING))
        trace = rollout(ControllerSpec(controller).build(), source, simulation, duration=2.5)
        assert not trace.fell
        speeds.append(trace.measured[trace.time > 1.5, 0].mean())
        assert min(len(times) for times in trace.touch_downs) >= 3
    assert speeds[0] == pytest.approx(speeds[1], abs=0.04)


def test_a_robot_with_its_own_sensors_and_drives_stands_a_pull() -> None:
    simulation = PhysxSimulation(sensing="robot", actuators=Actuators())
    pull = (Force((20.0, 0.0, 0.0), start=0.5, duration=0.2),)
    source = Constant(Command(gait=Gait.STANDING))
    options = {"duration": 1.5, "estimator": StateEstimator(load_robot()), "forces": pull}
    trace = rollout(ControllerSpec("qp").build(), source, simulation, **options)
    assert not trace.fell
    assert abs(rotations.pitch_of(trace.qpos[-1, 3:7])) < 0.1
