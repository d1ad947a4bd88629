import dataclasses
import math

import numpy as np
import pytest

from hugwbc import rotations
from hugwbc.arm_servo import GIVE, ArmServo
from hugwbc.controller import JointCommand, UpperBody, override_arms
from hugwbc.hand_wrench import HandWrench
from hugwbc.kinematics import Kinematics
from hugwbc.robot import load_robot
from hugwbc.sim import Actuators
from hugwbc.sim.forces import HandPull
from tests.conftest import make_state
from tests.upper_ik.conftest import REACHING, Hanging

DT = 0.02
IDEAL = Actuators.ideal().known_robot(load_robot())


def driven(servo, robot, q, state, dq=None):
    """The joint command of a robot in its nominal pose whose arms the servo moves; without a servo, PD alone."""
    targets = UpperBody.targets(q, dq)
    if servo is not None:
        targets = servo(targets, state, DT)
    return override_arms(JointCommand.position(robot, robot.nominal), targets, robot)


def test_torque_of_the_elbow_by_hand(nominal_state):
    # Nominal arms: forearms level, centre of mass 0.164862 m ahead of the elbow's axis, 0.745 kg (h1.yaml).
    torque = ArmServo(robot=load_robot("h1")).torque(np.zeros(8), nominal_state)
    assert torque[[3, 7]] == pytest.approx([-0.745 * 9.81 * 0.164862] * 2, rel=1e-6)
    # Shoulder roll: the arm hangs below its axis, offset sideways by the parts' centres of mass only.
    sideways = 0.852 * 0.00115 + 0.862 * 0.002767 + 0.745 * 0.000118
    assert torque[[1, 5]] == pytest.approx([9.81 * sideways, -9.81 * sideways], rel=1e-6)


def test_torque_of_an_accelerated_elbow_by_hand(nominal_state):
    robot, faster = load_robot("h1"), np.zeros(8)
    servo = ArmServo(robot=robot)
    faster[3] = 10.0
    inertia = 0.0060062 + 0.745 * (0.164862**2 + 0.015734**2) + robot.armature[robot.arms[3]]
    change = servo.torque(np.zeros(8), nominal_state, np.zeros(8), faster) - servo.torque(np.zeros(8), nominal_state)
    assert change[3] == pytest.approx(10.0 * inertia, rel=1e-6)


def test_it_has_no_memory_and_only_the_planned_acceleration_counts(robot, nominal_state):
    """A target that jumps after the measured body must not be fed forward as an acceleration."""
    servo, faster = ArmServo(robot), np.full(8, 5.0)
    first = servo(UpperBody.targets(REACHING), nominal_state, DT)
    servo(UpperBody.targets(REACHING, faster), nominal_state, DT)
    again = servo(UpperBody.targets(REACHING), nominal_state, DT)
    assert again.tau.tolist() == first.tau.tolist()
    planned = servo(UpperBody.targets(REACHING, ddq=faster), nominal_state, DT)
    expected = servo.torque(REACHING, nominal_state, np.zeros(8), faster)
    assert planned.tau == pytest.approx(expected) and np.abs(planned.tau - first.tau).max() > 1.0


def test_joints_that_are_not_taken_over_count_where_they_are(robot, nominal_state):
    """A source of targets for the elbow alone need not know the shoulder."""
    q = nominal_state.q.copy()
    q[robot.arms[0]] = -1.5
    state = dataclasses.replace(nominal_state, q=q)
    mask = np.arange(8) == 3
    targets = [UpperBody(np.where(mask, 0.4, other), np.where(mask, 0.2, other), mask) for other in (0.0, 0.7)]
    targets.append(UpperBody(np.where(mask, 0.4, q[robot.arms]), np.where(mask, 0.2, 0.0), mask))
    torques = [ArmServo(robot)(one, state, DT).tau[3] for one in targets]
    assert torques[0] == torques[1] == torques[2]


def test_friction_is_that_of_the_robot_it_is_given(robot, nominal_state):
    dq, none = np.full(8, 1.0), np.zeros(19)
    ideal = ArmServo(robot=dataclasses.replace(robot, friction=none, viscous=none))
    with_friction, without = (s(UpperBody.targets(REACHING, dq), nominal_state, DT) for s in (ArmServo(robot), ideal))
    lost = robot.friction_torque(np.ones(19))[robot.arms]
    assert with_friction.tau - without.tau == pytest.approx(lost) and np.all(lost > 0.0)


@pytest.mark.parametrize("pitch", [0.0, 0.3])
def test_soft_arms_rest_where_they_should(robot, pitch):
    sag = {}
    for servo in (None, ArmServo(robot)):
        rig = Hanging(pitch)
        state = rig.step(driven(servo, robot, REACHING, rig.state), 6.0)
        sag[servo is not None] = np.abs(state.q[robot.arms] - REACHING).max()
    # docs/upper_ik.md has it
    print(f"pitch {pitch} rad: sag {sag[False]:.3f} rad without, {sag[True]:.4f} rad with the servo")
    assert sag[False] > 0.1
    assert sag[True] < 0.005


def test_gains_are_worth_the_torque_they_say(robot, nominal_state):
    servo = ArmServo(robot)
    command = driven(servo, robot, np.zeros(8), nominal_state)
    arms = robot.arms
    assert command.kp[arms] == pytest.approx(np.full(8, 140.0))
    assert command.kd[arms] == pytest.approx([10.0, 10.0, 3.0, 3.0] * 2), "shoulders move the whole arm"
    moving = dataclasses.replace(nominal_state, dq=np.where(np.isin(np.arange(19), arms), 1.0, 0.0))
    again = driven(ArmServo(robot), robot, np.zeros(8), moving)
    assert again.tau == pytest.approx(command.tau), "the measured speed of an arm only counts in its damping"


def test_a_pushed_arm_comes_to_rest_sooner(robot):
    """Called at 50 Hz, as the learned controller is."""
    left = {}
    for servo in (None, ArmServo(robot)):
        rig = Hanging()
        rig.simulation.data.qvel[6 + robot.arms[:2]] = 3.0
        for _ in range(40):
            rig.step(driven(servo, robot, REACHING, rig.state), DT)
        left[servo is not None] = np.abs(rig.state.dq[robot.arms]).max()
    print(f"{left[False]:.3f} rad/s left without, {left[True]:.3f} with the servo")  # docs/upper_ik.md
    assert left[True] < 0.3 * left[False]


@pytest.mark.parametrize("period", [0.002, 0.02])
def test_arms_follow_a_sine_alike_at_every_control_period(robot, period):
    """0.4 rad at 1 Hz, real drives: the tracking does not depend on which controller calls the servo."""
    rig, servo, errors = Hanging(actuators=Actuators()), ArmServo(robot), []
    for tick in range(round(2.0 / period)):
        phase = 2.0 * math.pi * tick * period
        q, dq = REACHING + 0.4 * np.sin(phase), np.full(8, 0.8 * math.pi * np.cos(phase))
        ddq = np.full(8, -1.6 * math.pi**2 * np.sin(phase))
        errors.append(np.abs(rig.state.q[robot.arms] - q))
        targets = servo(UpperBody.targets(q, dq, ddq), rig.state, period)
        rig.step(override_arms(JointCommand.position(robot, robot.nominal), targets, robot), period)
    worst = np.max(errors[len(errors) // 2 :])
    print(f"period {period} s: largest error {worst:.4f} rad")  # docs/upper_ik.md
    assert worst < 0.02


def hand_points(robot, q):
    """Both hands in the pelvis frame [m], shape (2, 3), of the nominal body with these arms."""
    kinematics, body = Kinematics(robot), robot.nominal.copy()
    body[robot.arms] = q
    kinematics.update(make_state(body))
    return np.array([kinematics.position(f"{side}_hand") for side in ("left", "right")])


def test_payload_and_force_do_the_work_of_the_hands(robot, nominal_state):
    """Virtual work: the torques of a small motion are worth the force times the way of the hand."""
    servo, force, masses = ArmServo(robot), np.array([[5.0, -3.0, 2.0], [0.0, 7.0, -4.0]]), np.array([3.0, 1.0])
    at = dataclasses.replace(nominal_state, q=nominal_state.q.copy())
    at.q[robot.arms] = REACHING  # no gap, so that nothing is released
    plain = servo(UpperBody.targets(REACHING), at, DT)
    loaded = servo(dataclasses.replace(UpperBody.targets(REACHING), wrench=HandWrench(-force, masses)), at, DT)
    step = 1e-5
    for joint in range(8):
        moved = [hand_points(robot, REACHING + sign * step * np.eye(8)[joint]) for sign in (1, -1)]
        way = (moved[0] - moved[1]) / (2.0 * step)
        work = np.sum(way * (force + np.outer(masses, [0.0, 0.0, 9.81])))
        assert loaded.tau[joint] - plain.tau[joint] == pytest.approx(work, abs=1e-5)


def hand_forces(servo, robot, state, body):
    """What the servo's torques, without those that carry the arms, make both hands exert on a rigid world [N]."""
    driven_body = servo(body, state, DT)
    stiffness = np.diag(robot.arm_kp)
    gap = driven_body.q - state.q[robot.arms]
    torque = driven_body.kp * gap + driven_body.tau - servo.torque(body.q, state)
    jacobian = servo.jacobians(body.q, state).reshape(6, 8)
    pliant = np.linalg.solve(stiffness, jacobian.T)
    return np.linalg.solve(jacobian @ pliant, pliant.T @ torque).reshape(2, 3)


def off_target(robot, servo, state, away):
    """The state with arms whose hands are `away` (2, 3) [m] from those at REACHING, to first order."""
    jacobian = servo.jacobians(REACHING, state).reshape(6, 8)
    q = state.q.copy()
    q[robot.arms] = REACHING + np.linalg.pinv(jacobian) @ np.ravel(away)
    return dataclasses.replace(state, q=q)


@pytest.mark.parametrize("gap", [-0.03, 0.0, 0.03])
def test_a_hand_presses_with_the_wanted_force_wherever_it_meets_the_wall(robot, nominal_state, gap):
    servo, wanted = ArmServo(robot=IDEAL), np.array([[15.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    state = off_target(robot, servo, nominal_state, [[gap, 0.01, 0.0], [0.0, 0.0, 0.0]])
    force = hand_forces(
        servo, robot, state, dataclasses.replace(UpperBody.targets(REACHING), wrench=HandWrench(-wanted))
    )
    assert force[0, 0] == pytest.approx(15.0, abs=0.2)
    assert force[0, 1] < -3.0, "across the force the hand is held"
    assert force[1] == pytest.approx(np.zeros(3), abs=0.2)


def test_hands_that_squeeze_give_way_against_each_other_only(robot, nominal_state):
    servo, wanted = ArmServo(robot=IDEAL), np.array([[0.0, -30.0, 0.0], [0.0, 30.0, 0.0]])
    body = dataclasses.replace(UpperBody.targets(REACHING), wrench=HandWrench(-wanted))
    for away, inner, outer in (((0.02, -0.02), 30.0, 0.0), ((0.02, 0.02), 30.0, -10.0)):
        state = off_target(robot, servo, nominal_state, [[0.0, away[0], 0.0], [0.0, away[1], 0.0]])
        force = hand_forces(servo, robot, state, body)[:, 1]
        assert 0.5 * (force[1] - force[0]) == pytest.approx(inner, abs=1.0), "internal force"
        assert force.sum() == pytest.approx(0.0, abs=0.5) if outer == 0.0 else force.sum() < outer


def test_a_pressing_hand_that_meets_nothing_stops(robot):
    rig, servo = Hanging(actuators=Actuators.ideal()), ArmServo(robot=IDEAL)
    rig.step(driven(servo, robot, REACHING, rig.state), 1.0)
    before, yaw = rig.hands(), rotations.rotation_z(rig.state.yaw)
    along = yaw @ [1.0, 0.0, 0.0]
    body = dataclasses.replace(UpperBody.targets(REACHING), wrench=HandWrench(np.stack((-20.0 * along, np.zeros(3)))))
    for _ in range(200):
        rig.step(override_arms(JointCommand.position(robot, robot.nominal), servo(body, rig.state, DT), robot), DT)
    moved = rig.hands() - before
    assert 0.5 * GIVE < moved[0] @ along < 2.0 * GIVE
    assert np.abs(rig.state.dq[robot.arms]).max() < 0.05
    assert np.linalg.norm(moved[1]) < 0.005


@pytest.mark.parametrize("stiffness", [150.0, 400.0])
def test_a_soft_hand_is_a_spring_of_its_stiffness(robot, stiffness):
    rig, servo = Hanging(actuators=Actuators.ideal()), ArmServo(robot=IDEAL)
    body = dataclasses.replace(UpperBody.targets(REACHING), wrench=HandWrench(stiffness=stiffness))
    pull, places = HandPull(rig.simulation, np.array([0.0, 0.0, -12.0]), 1.5, 0.5), []
    for tick in range(250):
        pull.update(rig.state)
        rig.step(override_arms(JointCommand.position(robot, robot.nominal), servo(body, rig.state, DT), robot), DT)
        if tick in (70, 249):
            places.append(rig.hands())
    sunk = places[0] - places[1]
    assert sunk[:, 2] == pytest.approx([6.0 / stiffness] * 2, rel=0.2)


def test_a_servo_softer_than_a_soft_hand_s_elbow_keeps_its_gains(robot, nominal_state):
    soft = dataclasses.replace(robot, arm_kp=np.full(8, 4.0))
    body = dataclasses.replace(UpperBody.targets(REACHING), wrench=HandWrench(stiffness=300.0))
    assert np.array(ArmServo(soft)(body, nominal_state, DT).kp) == pytest.approx(soft.arm_kp)


def test_random_motions_and_loads_give_finite_torques_within_the_limits(robot, nominal_state):
    rng, servo = np.random.default_rng(1), ArmServo(robot)
    limit = robot.torque_limit[robot.arms]
    for _ in range(300):
        q = rng.uniform(robot.lower[robot.arms], robot.upper[robot.arms])
        state = dataclasses.replace(nominal_state, q=rng.uniform(robot.lower, robot.upper))
        body = dataclasses.replace(
            UpperBody.targets(q, rng.uniform(-9.0, 9.0, 8), rng.normal(0.0, 30.0, 8)),
            wrench=HandWrench(
                rng.normal(0.0, 10.0 ** rng.uniform(0.0, 6.0), (2, 3)) * rng.integers(0, 2, (2, 1)),
                rng.uniform(0.0, 20.0, 2),
                None if rng.random() < 0.5 else float(rng.uniform(50.0, 5000.0)),
            ),
        )
        command = servo(body, state, DT)
        assert np.isfinite(command.tau).all() and np.all(np.abs(command.tau) <= limit)
        assert command.kp is not None and np.all((command.kp > 0.0) & (command.kp <= 140.0 + 1e-9))
