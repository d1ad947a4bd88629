"""The state estimator: joint filter against the textbook, tilt from gravity, and the walking robot in simulation."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

from hugwbc import Command, Gait, JointCommand, RobotState, UpperBody, load_robot, rotations
from hugwbc.kinematics import Kinematics
from hugwbc.mbc import WholeBodyController
from hugwbc.robot import SIDES
from hugwbc.robot_tables import table_file
from hugwbc.runtime import Constant, estimation, reading_guard
from hugwbc.runtime.estimation import JointFilter, StateEstimator
from hugwbc.runtime.loop import ControlLoop
from hugwbc.runtime.rollout import rollout
from hugwbc.sim import Actuators, Ground, SensorProfile, Simulation

ROBOT = load_robot()


def _standing_torque(q, orientation):
    """Joint torques of a robot at rest whose feet carry half of its weight each."""
    kinematics = Kinematics(load_robot())
    state = RobotState(q=q, dq=np.zeros(19), orientation=orientation, angular_velocity=np.zeros(3))
    kinematics.update(state)
    model, data = kinematics.model, kinematics.data
    torque = pin.computeGeneralizedGravity(model, data, kinematics.q)
    pin.computeJointJacobians(model, data, kinematics.q)
    for side in SIDES:
        sole = kinematics.frame_id(f"{side}_sole")
        jacobian = pin.getFrameJacobian(model, data, sole, pin.LOCAL_WORLD_ALIGNED)
        torque = torque - jacobian[:3].T @ np.array([0.0, 0.0, 0.5 * 9.81 * ROBOT.mass])
    return torque[kinematics.columns]


def _at_rest(orientation, waist=0.0):
    """Readings of a robot that stands still: gravity in the torso's frame, joint torques that carry the weight."""
    q = ROBOT.nominal.copy()
    q[ROBOT.waist] = waist
    torso = rotations.multiply(orientation, rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), waist))
    return RobotState(
        q=q,
        dq=np.zeros(19),
        orientation=orientation,
        angular_velocity=np.zeros(3),
        torque=_standing_torque(q, orientation),
        imu_gyro=np.zeros(3),
        imu_accelerometer=rotations.rotate_inverse(torso, np.array([0.0, 0.0, 9.81])),
    )


def _angle(a, b):
    return 2.0 * np.linalg.norm(rotations.multiply(rotations.conjugate(a), b)[1:])


def test_a_plan_moves_the_joints_when_the_readings_of_its_time_arrive():
    estimator, still = (
        StateEstimator(load_robot()),
        dataclasses.replace(_at_rest(np.array([1.0, 0.0, 0.0, 0.0])), age=0.01),
    )
    plan = np.zeros(19)
    plan[ROBOT.waist] = 50.0
    estimator.reset(still)
    speeds = []
    for k in range(1, 12):
        reading = dataclasses.replace(still, time=0.002 * k)
        speeds.append(estimator.update(reading, plan if k == 2 else np.zeros(19)).dq[ROBOT.waist])
    # Planned for the time up to 0.014 s, which the reading of that time, the seventh, shows.
    assert speeds[:6] == pytest.approx(np.zeros(6), abs=1e-9)
    assert speeds[6] > 0.05


@pytest.mark.parametrize("absurd", [np.full(19, np.nan), np.full(19, np.inf), np.full(19, 1e12), np.zeros(8)])
def test_an_absurd_plan_is_ignored(absurd):
    with_plan, without, reading = (
        StateEstimator(load_robot()),
        StateEstimator(load_robot()),
        _at_rest(np.array([1.0, 0.0, 0.0, 0.0])),
    )
    with_plan.reset(reading)
    without.reset(reading)
    for k in range(1, 5):
        now = dataclasses.replace(reading, time=0.002 * k)
        estimates = with_plan.update(now, absurd), without.update(now)
    np.testing.assert_array_equal(estimates[0].dq, estimates[1].dq)


@pytest.mark.parametrize("waist", [0.0, 0.8])
def test_a_robot_at_rest_stays_where_it_is(waist):
    orientation = rotations.from_yaw_pitch_roll(2.0, 0.1, -0.05)
    reading = dataclasses.replace(_at_rest(orientation, waist), position=np.array([10.0, -5.0, 1.0]))
    estimator = StateEstimator(load_robot())
    first = estimator.reset(reading)
    assert first.position == pytest.approx([10.0, -5.0, 1.0], abs=1e-12)
    for k in range(1, 500):
        estimate = estimator.update(dataclasses.replace(reading, position=None, time=0.002 * k))
    assert estimate.position == pytest.approx([10.0, -5.0, 1.0], abs=1e-6)
    assert estimate.velocity == pytest.approx(np.zeros(3), abs=1e-6)
    assert _angle(estimate.orientation, orientation) < 1e-6
    assert estimate.q == pytest.approx(reading.q, abs=1e-9)
    assert estimator.contact.all()


def test_the_waist_may_turn_an_imu_about_an_axis_beside_the_pelvis_origin(tmp_path):
    table = table_file("h1").read_text()
    table = table.replace("child: torso_link, xyz: [0, 0, 0]", "child: torso_link, xyz: [-0.04, 0, 0.05]")
    (tmp_path / "high").mkdir()
    (tmp_path / "high" / "high.yaml").write_text(table)
    simulation = Simulation(robot=str(tmp_path / "high"), sensing=SensorProfile("clean"))
    assert simulation.model.body("torso_link").pos == pytest.approx([-0.04, 0.0, 0.05])
    errors = []

    def compare(truth, estimate):
        errors.append(np.concatenate((estimate.position - truth.position, estimate.velocity - truth.velocity)))

    rollout("qp", Command(w=0.6), simulation, duration=1.0, on_step=compare)
    np.testing.assert_array_less(np.sqrt(np.mean(np.square(errors), axis=0)), [0.005] * 3 + [0.012, 0.002, 0.012])


def test_gravity_and_still_feet_correct_a_wrong_tilt_but_not_the_heading():
    upright = rotations.from_yaw_pitch_roll(1.0, 0.0, 0.0)
    reading = _at_rest(upright)
    estimator = StateEstimator(load_robot())
    tilted = rotations.from_yaw_pitch_roll(1.2, 0.04, -0.04)
    estimator.reset(dataclasses.replace(reading, orientation=tilted))
    for k in range(1, 1000):
        estimate = estimator.update(dataclasses.replace(reading, orientation=tilted, time=0.002 * k))
    # The accelerometer's bias, which a tilt looks like, takes its share.
    assert abs(rotations.pitch_of(estimate.orientation)) < 5e-3
    assert abs(rotations.roll_of(estimate.orientation)) < 5e-3
    assert estimate.yaw == pytest.approx(1.2, abs=0.01)


def test_without_a_position_it_starts_with_the_soles_on_the_ground():
    estimator = StateEstimator(load_robot())
    estimate = estimator.reset(_at_rest(rotations.from_yaw_pitch_roll(0.0, 0.0, 0.0)))
    kinematics = Kinematics(load_robot())
    kinematics.update(estimate)
    assert kinematics.position("left_sole")[2] == pytest.approx(0.0, abs=1e-3)
    assert estimate.position[:2] == pytest.approx([0.0, 0.0])


def test_a_foot_in_the_air_is_not_observed_and_enters_where_it_lands(monkeypatch):
    """Both feet leave the ground, a fall of 0.1 s with the accelerometer at zero, and come down again."""
    reading = _at_rest(rotations.from_yaw_pitch_roll(0.0, 0.0, 0.0))
    monkeypatch.setattr(reading_guard, "ACCELEROMETER", 1e3)  # the impact takes one reading
    estimator = StateEstimator(load_robot())
    start = estimator.reset(reading)
    falling = dataclasses.replace(reading, torque=np.zeros(19), imu_accelerometer=np.zeros(3))
    for k in range(1, 51):
        estimate = estimator.update(dataclasses.replace(falling, time=0.002 * k))
    assert not estimator.contact.any()
    # The torques tell a few milliseconds late that the feet have left the ground.
    assert estimate.position - start.position == pytest.approx([0.0, 0.0, -0.5 * 9.81 * 0.1**2], abs=2e-3)
    assert estimate.velocity == pytest.approx([0.0, 0.0, -0.981], abs=0.01)
    landing = dataclasses.replace(reading, imu_accelerometer=np.array([0.0, 0.0, 9.81 + 0.981 / 0.002]))
    estimator.update(dataclasses.replace(landing, time=0.002 * 51))
    for k in range(52, 200):
        estimate = estimator.update(dataclasses.replace(reading, time=0.002 * k))
    assert estimate.velocity == pytest.approx(np.zeros(3), abs=1e-3)
    assert estimate.position[2] == pytest.approx(start.position[2] - 0.5 * 9.81 * 0.1**2, abs=2e-3)


def test_readings_that_are_incomplete_are_passed_on_and_broken_ones_replaced():
    reading = _at_rest(rotations.from_yaw_pitch_roll(0.0, 0.0, 0.0))
    estimator = StateEstimator(load_robot())
    estimator.reset(reading)
    for incomplete in (dataclasses.replace(reading, imu_gyro=None), dataclasses.replace(reading, torque=None)):
        assert estimator.update(incomplete) is incomplete
    estimator.update(reading)
    for broken in (
        dataclasses.replace(reading, q=np.full(19, np.nan)),
        dataclasses.replace(reading, dq=np.full(19, 1e200), time=0.002),
        dataclasses.replace(reading, imu_gyro=np.full(3, -1e300), time=0.002),
        dataclasses.replace(reading, imu_accelerometer=np.full(3, 1e30), time=0.002),
    ):
        estimate = estimator.update(broken)
        assert estimate.is_finite and estimate.coasted
    estimate = estimator.update(dataclasses.replace(reading, time=0.01))
    assert estimate.velocity == pytest.approx(np.zeros(3), abs=1e-6), "none of them leaves anything behind"


@pytest.mark.parametrize("spoilt", ["waist", "quaternion"])
@pytest.mark.parametrize("name", ["h1", "g1"])
def test_what_turns_an_imu_into_a_pelvis_may_fail_for_a_while(name, spoilt):
    """The orientation that comes with a reading is the first one's alone: the filter has its own."""
    simulation = Simulation(robot=name, sensing="robot", seed=0)
    estimator, robot = StateEstimator(load_robot(name)), load_robot(name)
    estimator.reset(simulation.sense(), 0.002)
    for tick in range(130):
        simulation.step(JointCommand.position(robot, robot.nominal), 0.002)
        state = simulation.sense()
        if tick >= 100:
            q, nowhere = state.q.copy(), np.full(4, np.nan)
            if spoilt == "waist":
                q[robot.waist] = np.nan
            state = dataclasses.replace(state, q=q, orientation=nowhere, angular_velocity=np.full(3, np.nan))
        estimate = estimator.update(state)
        assert estimate.is_usable
    assert bool(estimate.coasted) == (spoilt == "waist")


def test_it_starts_with_the_first_usable_reading():
    estimator, reading = StateEstimator(load_robot()), _at_rest(np.array([1.0, 0.0, 0.0, 0.0]))
    nothing = dataclasses.replace(reading, orientation=np.full(4, np.nan), imu_gyro=np.full(3, np.nan))
    estimator.reset(nothing)
    assert estimator.update(dataclasses.replace(nothing, time=0.002)).time == 0.002
    for tick in range(2, 20):
        estimate = estimator.update(dataclasses.replace(reading, time=0.002 * tick))
        assert estimate.is_usable
    assert estimate.position[2] == pytest.approx(ROBOT.nominal_height, abs=0.02)


@pytest.mark.parametrize(("name", "ticks"), [("h1", 1500), ("g1", 1000)])  # the IMU is on the trunk, and on the pelvis
def test_it_follows_the_walking_robot(name, ticks):
    """The controller reads the truth, so that the estimator's errors do not feed back."""
    robot = load_robot(name)
    simulation = Simulation(sensing="robot", seed=2, robot=robot, actuators=Actuators(), ground=Ground.named("firm"))
    controller, estimator = WholeBodyController(robot=robot, period=0.002), StateEstimator(robot=robot)
    state = simulation.reset(xy=(3.0, 1.0), yaw=1.0)
    controller.reset(state)
    estimator.reset(dataclasses.replace(simulation.sense(), position=state.position))
    errors, command = [], Command.from_mapping({"v_x": 0.5, "omega": 0.3}, Gait.WALKING, robot)
    for tick in range(ticks):
        state = simulation.step(controller.act(state, command, UpperBody.none()), controller.period)
        estimate = estimator.update(simulation.sense())
        if tick > 250:
            tilt = [f(estimate.orientation) - f(state.orientation) for f in (rotations.pitch_of, rotations.roll_of)]
            errors.append([*(estimate.velocity - state.velocity), *tilt])
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    print(f"velocity {rms[:3].max():.4f} m/s, tilt {rms[3:].max():.4f} rad")  # docs/log/qp.md has it
    assert np.all(rms[:3] < 0.03)
    assert np.all(rms[3:] < 0.01)
    assert np.linalg.norm((estimate.position - state.position)[:2]) < 0.1  # the H1 walks 1.5 m and turns by 50 degrees


@pytest.mark.parametrize(("newest", "expected"), [([0.0, 0.0, 0.4], 0.4), ([0.0, 0.0, 90.0], 0.2)])
def test_the_newest_gyro_reading_moves_the_pelvis_if_it_can_be_true(newest, expected):
    estimator, reading = StateEstimator(load_robot()), _at_rest(np.array([1.0, 0.0, 0.0, 0.0]))
    estimator.reset(reading)
    turning = dataclasses.replace(reading, imu_gyro=np.array([0.0, 0.0, 0.2]), time=0.01)
    estimate = estimator.update(turning, None, np.array(newest))
    assert estimate.angular_velocity[2] == pytest.approx(expected, abs=0.01)


def test_the_loop_tells_the_estimator_what_the_controller_plans():
    told = []

    class Listening(StateEstimator):
        def update(self, state, planned=None, newest_gyro=None):
            told.append(planned)
            return super().update(state, planned, newest_gyro)

    controller = WholeBodyController(load_robot())
    loop = ControlLoop(
        controller, Constant(Command()), Simulation(sensing="robot", seed=0), estimator=Listening(load_robot())
    )
    loop.reset()
    loop.step(loop.decide(0.0), loop.period)
    np.testing.assert_array_equal(told[-1], controller.planned_acceleration)
    assert told[-1].shape == (19,) and np.abs(told[-1]).max() > 0.0
    broken = dataclasses.replace(loop.simulation.state(), q=np.full(19, np.nan))
    controller.act(broken, Command(), UpperBody.none())
    assert controller.planned_acceleration is None


@pytest.mark.parametrize("odd", [0.004, 0.1, 0.0])
def test_one_irregular_reading_leaves_the_joint_filter_as_it_was(odd):
    joints, still = JointFilter(ROBOT), np.zeros(19)
    gains = []
    for _ in range(2):
        for _ in range(3000):
            joints.update(still, still, 0.002)
        gains.append(joints._gains[3].copy())
        joints.update(still, still, odd)
    np.testing.assert_allclose(gains[1], gains[0], rtol=1e-3)


@pytest.mark.parametrize("back", [0.5, 20.0])
def test_a_clock_that_begins_anew_does_not_end_the_estimate(back):
    simulation = Simulation()
    loop = ControlLoop(WholeBodyController(ROBOT), Command(v_x=0.4, gait=Gait.WALKING), simulation)
    loop.reset()
    sense = simulation.sense
    simulation.sense = lambda: dataclasses.replace(sense(), time=sense().time - back * (simulation.time > 1.2))
    while simulation.time < 2.0 and not simulation.fallen:
        loop.step(loop.decide(simulation.time), loop.period)
    estimator = loop.control.estimator
    assert not simulation.fallen and estimator._P.max() < 0.1


@pytest.mark.parametrize("plans", [False, True])
@pytest.mark.parametrize("joint", [0, ROBOT.waist])
def test_the_joint_filter_is_a_kalman_filter_of_each_joint(joint, plans):
    """Against the textbook's matrices, over steps of unequal length."""
    rng, joints = np.random.default_rng(0), JointFilter(ROBOT)
    joints.reset(ROBOT.nominal, np.zeros(19))
    noise = np.diag([estimation.ENCODER_NOISE**2, estimation.JOINT_VELOCITY_NOISE**2])
    x, covariance = np.array([ROBOT.nominal[joint], 0.0]), noise
    acceleration = estimation.WAIST_ACCELERATION if joint == ROBOT.waist else estimation.LEG_ACCELERATION
    spread = acceleration * (estimation.UNPLANNED if plans else 1.0)
    for _ in range(50):
        dt, planned = rng.uniform(0.001, 0.01), 50.0 * rng.normal(size=19) if plans else None
        q, dq = ROBOT.nominal + 0.01 * rng.normal(size=19), rng.normal(size=19)
        joints.update(q, dq, dt, planned)
        step, push = np.array([[1.0, dt], [0.0, 1.0]]), np.array([0.5 * dt**2, dt])
        x = step @ x + (0.0 if planned is None else push * planned[joint])
        covariance = step @ covariance @ step.T + spread**2 * np.outer(push, push)
        gain = covariance @ np.linalg.inv(covariance + noise)
        x = x + gain @ (np.array([q[joint], dq[joint]]) - x)
        covariance = covariance - gain @ covariance
        np.testing.assert_allclose([joints.q[joint], joints.dq[joint]], x, rtol=0.0, atol=1e-9)


def test_the_covariance_is_that_of_the_pelvis_it_gives():
    """By finite differences of what the filter corrects: orientation, velocity and the bias of the gyro."""
    estimator, rng = StateEstimator(load_robot()), np.random.default_rng(0)
    reading = _at_rest(rotations.from_yaw_pitch_roll(2.0, 0.1, -0.05), 0.4)
    estimator.reset(reading)
    speeds = np.zeros(19)
    speeds[ROBOT.waist] = 0.4
    turning = dataclasses.replace(reading, imu_gyro=np.array([0.3, -0.2, 0.5]), dq=speeds)
    for tick in range(1, 6):
        estimator.update(dataclasses.replace(turning, time=0.002 * tick))

    def pelvis(change):
        kept = estimator._R, estimator._rows.copy(), estimator.gyro_bias
        turn = pin.exp3(change[:3])
        estimator._R, estimator._rows[:] = turn @ estimator._R, estimator._rows @ turn.T
        estimator._v += change[3:6]
        estimator.gyro_bias = estimator.gyro_bias + change[estimation._GYRO_BIAS]
        orientation, _, _, velocity = estimator._pelvis()
        estimator._R, estimator._rows[:], estimator.gyro_bias = kept
        estimator._pelvis()
        return rotations.to_matrix(orientation), velocity

    size, step = estimation._SIZE, 1e-6
    jacobian = np.zeros((6, size))
    for column, change in enumerate(step * np.eye(size)):
        (turned, faster), (back, slower) = pelvis(change), pelvis(-change)
        jacobian[:, column] = np.concatenate((pin.log3(turned @ back.T), faster - slower)) / (2.0 * step)
    root = rng.normal(size=(size, size))
    estimator._P = root @ root.T
    expected, arm = jacobian @ estimator._P @ jacobian.T, jacobian[3:, estimation._GYRO_BIAS]
    expected[3:, 3:] += estimation._GYRO_NOISE**2 * arm @ arm.T
    np.testing.assert_allclose(estimator.covariance(), expected, atol=1e-6)


def test_at_rest_the_bias_of_the_gyro_is_found():
    bias, estimator = np.array([0.005, -0.004, 0.003]), StateEstimator(load_robot())
    reading = dataclasses.replace(_at_rest(rotations.from_yaw_pitch_roll(2.0, 0.1, -0.05)), imu_gyro=bias)
    estimator.reset(dataclasses.replace(reading, imu_gyro=np.zeros(3)))
    for tick in range(1, 1501):
        estimator.update(dataclasses.replace(reading, time=0.002 * tick))
    np.testing.assert_allclose(estimator.gyro_bias, bias, atol=1e-3)
