"""Contacts and hand forces from joint torques: the algebra, and walks against the truth."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

from hugwbc import Command, Gait, load_robot, rotations
from hugwbc.kinematics import Kinematics
from hugwbc.mbc import WholeBodyController
from hugwbc.runtime import UpperBodySource
from hugwbc.runtime.contact import RATE, ContactObserver, HandForceObserver, SwingInertia
from hugwbc.runtime.controllers import load_controller
from hugwbc.runtime.estimation import StateEstimator
from hugwbc.runtime.loop import ControlLoop
from hugwbc.scripts.view import Constant
from hugwbc.sim import Actuators, Ground, Simulation
from hugwbc.sim.robot_model import Variation
from hugwbc.sim.sensors import ROBOT
from hugwbc.targets import HandTargets
from tests.conftest import make_state
from tests.upper_ik.conftest import REACHING

TOUCHING = 1.0  # [N]
DT = 0.002  # [s]


def test_a_stand_at_rest_is_known_from_the_start():
    simulation, observer = Simulation(sensing="exact"), ContactObserver(Kinematics(load_robot()))
    state = simulation.reset()
    observer.reset(state)
    weight = 9.81 * load_robot().mass
    assert observer.contact.all()
    assert observer.force[:, 2].sum() == pytest.approx(weight, rel=0.01)


def test_a_fall_shows_from_the_first_reading():
    """Without ground reaction the residual decays by exp(-rate dt) a reading, also at the first one after the reset."""
    kinematics = Kinematics(load_robot())
    observer = ContactObserver(kinematics)
    state = Simulation(sensing="exact").reset()
    assert state.velocity is not None
    observer.reset(state)
    weight = 9.81 * load_robot().mass
    for k in range(1, 6):
        falling = dataclasses.replace(state, velocity=state.velocity - [0.0, 0.0, 9.81 * k * DT])
        kinematics.place(falling)
        observer.infer(np.zeros(19), DT)
        decayed = weight * np.exp(-RATE * DT * k)
        assert observer.force[:, 2].sum() == pytest.approx(decayed, rel=0.02), k


def test_soles_that_part_do_not_both_stand():
    """The residual of a stand loads both feet; a left leg that swings takes its foot's load away, and gives it back."""
    robot, kinematics = load_robot(), Kinematics(load_robot())
    observer = ContactObserver(kinematics)
    still = Simulation(sensing="exact").reset()
    lean, velocity = np.zeros(19), np.zeros(19)
    lean[robot.index("right_ankle_joint")] = 1.0  # so that the right foot bears a little more
    velocity[robot.index("left_hip_pitch_joint")] = 2.0
    for state, stands in ((still, [True, True]), (dataclasses.replace(still, dq=velocity), [False, True])):
        observer.reset(state)
        kinematics.place(state)
        observer.infer(lean, 1e-6)  # so short that the residual is that of the stand
        assert observer.contact.tolist() == stands
        assert observer.force.any(axis=1).tolist() == stands


def test_the_heading_changes_no_force():
    """A torque about a foot's roll, which a narrow sole does not transmit, is told apart in every heading."""
    kinematics, still = Kinematics(load_robot()), Simulation(sensing="exact").reset()
    torque = np.random.default_rng(0).normal(0.0, 30.0, 19)
    forces = []
    for heading in (0.0, 1.0, 2.5):
        turn = rotations.from_yaw_pitch_roll(heading, 0.0, 0.0)
        state = dataclasses.replace(still, orientation=rotations.multiply(turn, still.orientation))
        observer = ContactObserver(kinematics)
        observer.reset(state)
        kinematics.place(state)
        observer.infer(torque, DT)
        forces.append(rotations.rotate_inverse(turn[None], observer.force))
    np.testing.assert_allclose(forces[1:], [forces[0]] * 2, atol=1e-6)


def _walk(seed, duration, v_x=0.5, told="h1"):
    """Walk on the estimate; errors of tilt and velocity, inferred and true contacts, after the first second."""
    robot = load_robot("h1")
    simulation = Simulation(sensing=ROBOT, seed=seed, robot=robot, actuators=Actuators(), ground=Ground.named("firm"))
    known = load_robot(told)
    estimator = StateEstimator(robot=known)
    command = Command(v_x=v_x, gait=Gait.WALKING)
    loop = ControlLoop(WholeBodyController(robot=known), Constant(command), simulation, None, estimator)
    loop.reset()
    delay = round(ROBOT.latency / simulation.timestep)
    errors, contacts, truths = [], [], []
    while simulation.time < duration:
        joint_command = loop.decide(simulation.time)
        for _ in range(loop.substeps):
            loop.step(joint_command, simulation.timestep)
            truths.append(simulation.state())
            if simulation.time < 1.0 or len(truths) <= delay:
                continue
            truth, estimate = truths[-1 - delay], loop.control.estimate  # the estimate is of the reading's time
            turn = rotations.to_matrix(estimate.orientation) @ rotations.to_matrix(truth.orientation).T
            tilt = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0]])
            errors.append(np.concatenate((tilt, estimate.velocity - truth.velocity)))
            contacts.append((estimator.contact, truth.foot_force[:, 2] > TOUCHING))
    assert not simulation.fallen
    return np.array(errors), np.array(contacts)


def test_contacts_and_velocity_of_a_walk_without_foot_sensors():
    errors, contacts = _walk(seed=11, duration=4.0)
    inferred, true = contacts[:, 0], contacts[:, 1]
    assert (inferred & ~true).mean() < 0.05, "false contacts"
    assert (true & ~inferred).mean() < 0.05, "missed contacts"
    rms = np.sqrt(np.mean(errors**2, axis=0))
    assert rms[:2].max() < np.radians(1.0) and rms[2:].max() < 0.05


def test_a_swinging_leg_that_is_heavier_than_told_does_not_stand():
    """Told 51.65 kg and rotors of 0.01 kg m^2; without learning, a foot seems to stand in a fifth of its swing."""
    _, contacts = _walk(seed=2, duration=3.0, v_x=1.0, told="h1-2023")
    inferred, true = contacts[:, 0], contacts[:, 1]
    assert (inferred & ~true).sum() < 0.05 * (~true).sum(), "false contacts"


@pytest.mark.parametrize(("told", "learnt"), [(0.01, True), (0.16, False)])
def test_a_rotor_that_was_not_told_is_learnt_from_swings(told, learnt):
    """A joint that turns at a takes J a; one whose table says J0 leaves (J0 - J) a in the residual."""
    robot = load_robot()
    armature, knees = robot.armature.copy(), robot.pair("knee")
    armature[knees] = told
    kinematics = Kinematics(dataclasses.replace(robot, armature=armature))
    swings, rng = SwingInertia(kinematics), np.random.default_rng(0)
    columns = kinematics.columns[knees]
    for swing in range(400):
        acceleration, residual = np.zeros(25), rng.normal(scale=3.0, size=25)
        planned = np.zeros(19)
        planned[knees] = rng.normal(scale=100.0)
        acceleration[columns] = planned[knees] + rng.normal(scale=30.0)
        known = kinematics.model.armature[columns] * acceleration[columns]
        residual[columns] += known - robot.armature[knees] * planned[knees]
        swings.learn(swing % 2, acceleration, residual, planned)
    known = kinematics.model.armature[columns]
    assert known == pytest.approx(robot.armature[knees] if learnt else armature[knees], rel=0.1 if learnt else 0.0)
    assert (swings.untold is not None) == learnt


@pytest.fixture
def kinematics():
    robot, found = load_robot(), Kinematics(load_robot())
    q = robot.nominal.copy()
    q[robot.arms] = REACHING
    found.update(make_state(q, position=[0.0, 0.0, 0.98]))
    pin.computeJointJacobians(found.model, found.data, found.q)
    return found


def felt(kinematics, forces):
    """The generalised force of forces on both hands, shape (25,)."""
    model, data = kinematics.model, kinematics.data
    hands = [kinematics.frame_id(f"{side}_hand") for side in ("left", "right")]
    jacobians = [pin.getFrameJacobian(model, data, hand, pin.LOCAL_WORLD_ALIGNED)[:3] for hand in hands]
    return sum(jacobian.T @ force for jacobian, force in zip(jacobians, forces, strict=True))


def test_forces_are_found_in_the_torques_that_they_cause(kinematics):
    observer, forces = HandForceObserver(kinematics), np.array([[10.0, -5.0, -29.0], [0.0, 20.0, 4.0]])
    residual = felt(kinematics, forces)
    for _ in range(1000):
        observer.infer(residual, DT)
    assert observer.force == pytest.approx(forces, rel=0.03, abs=0.5)
    assert felt(kinematics, observer.force) == pytest.approx(residual, abs=1.0), "nothing else is left to explain"
    observer.reset()
    assert not observer.force.any()


def test_forces_on_the_feet_alone_leave_the_hands_empty(kinematics):
    observer = HandForceObserver(kinematics)
    foot = pin.getFrameJacobian(
        kinematics.model, kinematics.data, kinematics.frame_id("left_sole"), pin.LOCAL_WORLD_ALIGNED
    )
    for _ in range(100):
        observer.infer(foot[:3].T @ [50.0, 20.0, 600.0], DT)
    assert np.abs(observer.force).max() < 1e-9


def test_friction_of_a_still_joint_is_the_limit(kinematics):
    """What the drives hold unseen shows up as a force of a few newtons."""
    observer, robot = HandForceObserver(kinematics), load_robot()
    residual = np.zeros(kinematics.model.nv)
    worst = 0.0
    for signs in np.array(np.meshgrid(*[[-1.0, 1.0]] * 4)).reshape(4, -1).T:
        residual[kinematics.columns[robot.arms[:4]]] = signs * robot.friction[robot.arms[:4]]
        observer.reset()
        for _ in range(1000):
            observer.infer(residual, DT)
        worst = max(worst, float(np.linalg.norm(observer.force[0])))
    assert 1.0 < worst < 8.0


@pytest.mark.slow
@pytest.mark.parametrize("payload", [0.0, 3.0])
def test_the_weight_in_the_hands_of_a_walking_robot(payload):
    simulation = Simulation(seed=3, variation=Variation(hand_payload=payload))
    # The policy's own arms lean on its torso, a force that the observer finds; targets keep them away from it.
    source = Constant(Command(v_x=0.3, gait=Gait.WALKING), HandTargets.of((0.3, 0.25, 0.1), (0.3, -0.25, 0.1)))
    arms = UpperBodySource(robot=simulation.known_robot)
    loop = ControlLoop(load_controller("learned"), source, simulation, arms)
    loop.reset()
    forces = []
    while simulation.time < 6.0:
        loop.step(loop.decide(simulation.time), loop.period)
        forces.append(loop.control.estimate.hand_force)
    assert not simulation.fallen
    mean = np.mean(forces[len(forces) // 2 :], axis=0)
    assert mean[:, 2] == pytest.approx([-9.81 * payload] * 2, abs=5.0)
    assert np.abs(mean[:, :2]).max() < 6.0
