"""One robot in MuJoCo: reset, PD law, pushes, forces, latency, bad commands and falls."""

import dataclasses

import mujoco
import numpy as np
import pytest

from hugwbc import JointCommand, load_robot, rotations
from hugwbc.errors import UnknownNameError
from hugwbc.sim import Actuators, HeightField, Scene, Simulation, rough_terrain
from hugwbc.sim.arena import ENGINES
from hugwbc.sim.scenes import Box

ROBOT = load_robot()
WEIGHT = ROBOT.mass * 9.81
HOLD = JointCommand.position(ROBOT, ROBOT.nominal)


@pytest.fixture(scope="module")
def plane() -> Simulation:
    return Simulation(sensing="exact")


def test_reset_places_and_turns_the_robot(plane: Simulation) -> None:
    state = plane.reset(xy=(1.0, -2.0), yaw=0.7)
    np.testing.assert_allclose(state.position, [1.0, -2.0, 0.982], atol=1e-9)
    assert state.yaw == pytest.approx(0.7)
    np.testing.assert_array_equal(state.q, ROBOT.nominal)
    assert not state.dq.any() and not state.velocity.any()
    assert state.time == 0.0 and not plane.fallen
    np.testing.assert_array_equal(plane.reset(q=ROBOT.nominal + 0.05).q, ROBOT.nominal + 0.05)


def test_an_object_on_the_ground_is_no_link_of_the_robot() -> None:
    simulation = Simulation(scene=Scene((Box(name="box", position=(1.0, 0.0), size=(0.2, 0.2, 0.2)),)))
    simulation.step(HOLD, 0.02)
    assert simulation.data.ncon > 0 and simulation.links_on_ground == (), "the box lands first, and then sleeps"
    simulation.step(HOLD, 0.1)
    assert set(simulation.links_on_ground) == set(ROBOT.foot_links)


@pytest.mark.parametrize("xy", [(0.0, 0.0), (2.3, -1.1)])
def test_reset_on_terrain_stands_on_the_ground_below(xy: tuple[float, float]) -> None:
    terrain = rough_terrain(0.02, np.random.default_rng(0))
    simulation = Simulation(sensing="exact", terrain=terrain)
    state = simulation.reset(xy=xy)
    assert state.position[2] == pytest.approx(0.982 + float(terrain.height_at(np.array(xy))), abs=1e-9)
    for _ in range(10):
        state = simulation.step(HOLD, 0.02)
    assert not simulation.fallen
    assert simulation.ground_height(np.array(xy)) == pytest.approx(float(terrain.height_at(np.array(xy))))
    assert state.foot_force[:, 2].sum() > 0.5 * WEIGHT


def test_raised_flat_ground_behaves_as_the_plane_does(plane: Simulation) -> None:
    raised = Simulation(sensing="exact", terrain=HeightField(np.full((11, 11), 0.5), (4.0, 4.0)))
    low, high = plane.reset(), raised.reset()
    for _ in range(25):
        low, high = plane.step(HOLD, 0.02), raised.step(HOLD, 0.02)
    np.testing.assert_allclose(high.position - [0, 0, 0.5], low.position, atol=1e-6)


def test_the_pressure_centre_lies_in_the_sole_where_the_forces_balance(plane: Simulation) -> None:
    """At rest, the forces of both feet act below the centre of mass; on one foot only, the other has no centre."""
    plane.reset()
    for _ in range(100):
        plane.step(HOLD, 0.002)
    centres, state = plane.pressure_centres, plane.state()
    for centre, side in zip(centres, ("left", "right"), strict=True):
        away = centre - plane.data.site(f"{side}_sole").xpos
        assert abs(away[0]) < 0.16 and abs(away[1]) < 0.02 and abs(away[2]) < 0.01
    # The vertical forces' moment about the origin, from the contacts' sum, equals that from the centres.
    data, wrench, moment = plane.data, np.zeros(6), np.zeros(2)
    for index in range(data.ncon):
        mujoco.mj_contactForce(plane.model, data, index, wrench)
        moment += wrench[0] * data.contact.pos[index, :2]
    assert state.foot_force is not None
    np.testing.assert_allclose(state.foot_force[:, 2] @ centres[:, :2], moment, atol=1e-6)
    q = plane.robot.nominal.copy()
    q[plane.robot.index("left_knee_joint")] += 1.0
    plane.reset(q=q)
    assert np.isnan(plane.pressure_centres[0]).all()


def test_time_advances_by_whole_physics_steps(plane: Simulation) -> None:
    plane.reset()
    assert plane.step(HOLD, 0.02).time == pytest.approx(0.02)
    assert plane.step(HOLD, 0.0001).time == pytest.approx(0.022)  # never less than one step


def test_torque_of_ideal_drives_is_the_pd_law_within_the_limits() -> None:
    plane, rng = Simulation(sensing="exact", actuators=Actuators.ideal()), np.random.default_rng(0)
    clamped = 0
    for scale in (0.02, 0.3, 2.0):
        for _ in range(5):
            command = JointCommand(
                q=ROBOT.nominal + scale * rng.normal(size=19),
                dq=scale * rng.normal(size=19),
                kp=ROBOT.kp * rng.uniform(0.5, 1.5, 19),
                kd=ROBOT.kd * rng.uniform(0.5, 1.5, 19),
                tau=10 * scale * rng.normal(size=19),
            )
            state = plane.step(command, 0.002)
            law = command.tau + command.kp * (command.q - state.q) + command.kd * (command.dq - state.dq)
            np.testing.assert_allclose(plane.torque, np.clip(law, -ROBOT.torque_limit, ROBOT.torque_limit), atol=1e-9)
            clamped += int(np.sum(np.abs(law) > ROBOT.torque_limit))
    assert clamped > 10  # the last scale does reach the limits


def test_a_command_that_is_not_finite_is_held_off_and_counted() -> None:
    bad = dataclasses.replace(HOLD, q=np.where(np.arange(19) == 4, np.nan, ROBOT.nominal))
    faulty, sound = Simulation(sensing="exact"), Simulation(sensing="exact")
    good = dataclasses.replace(HOLD, q=ROBOT.nominal + 0.03)
    for simulation, second in ((faulty, bad), (sound, good)):
        simulation.reset()
        simulation.step(good, 0.02)
        simulation.step(second, 0.02)
    assert (faulty.rejected_commands, sound.rejected_commands) == (1, 0)
    np.testing.assert_array_equal(faulty.data.qpos, sound.data.qpos)
    assert faulty.state().is_finite
    assert not faulty.diverged


@pytest.mark.parametrize("absurd", [{"q": np.full(19, 1e9)}, {"tau": np.full(19, -1e11)}])
def test_a_command_beyond_what_the_physics_takes_is_held_off_and_counted(absurd) -> None:
    """MuJoCo gives no torque to any joint in a step in which one input is beyond 1e10."""
    simulation, sound = Simulation(sensing="exact"), Simulation(sensing="exact")
    for command in (HOLD, dataclasses.replace(HOLD, **absurd)):
        simulation.step(command, 0.02)
        sound.step(HOLD, 0.02)
    assert simulation.rejected_commands == 1
    np.testing.assert_array_equal(simulation.data.qpos, sound.data.qpos)


@pytest.mark.parametrize("name", ["h1", "g1"])
@pytest.mark.parametrize("engine", ["mujoco", "physx"])
@pytest.mark.parametrize("bend", [-0.3, 0.0, 0.6])
def test_a_robot_in_another_pose_starts_with_its_soles_on_the_ground(name, engine, bend) -> None:
    robot = load_robot(name)
    q = robot.nominal.copy()
    for part, share in (("knee", 1.0), ("hip_pitch", -0.5), ("ankle_pitch", -0.3)):  # the soles are not level
        q[robot.pair(part)] += share * bend
    simulation = ENGINES[engine](robot=robot, sensing="exact")
    simulation.reset(q=q)
    forces = []
    for _ in range(15):  # it falls by the gap of 2 mm within 20 ms
        simulation.step(JointCommand.position(robot, q), 0.002)
        forces.append(simulation.foot_force[:, 2].sum())
    assert forces[0] == 0.0 and forces[-1] > 0.0


def test_a_command_whose_numbers_change_acts_with_the_new_ones() -> None:
    plane = Simulation(sensing="exact", actuators=Actuators.ideal())
    q, elbow = ROBOT.nominal.copy(), ROBOT.index("left_elbow_joint")
    command = JointCommand.position(ROBOT, q)
    plane.step(command, 0.002)
    q[elbow] += 0.5
    plane.step(command, 0.002)
    assert plane.torque[elbow] == pytest.approx(0.5 * ROBOT.kp[elbow], rel=0.05)


def test_push_changes_the_velocity_at_once(plane: Simulation) -> None:
    plane.reset()
    plane.push(np.array([0.3, -0.2, 0.0]))
    np.testing.assert_allclose(plane.state().velocity, [0.3, -0.2, 0.0])
    plane.push(np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.5]))
    np.testing.assert_allclose(plane.state().velocity, [0.4, -0.2, 0.0])
    np.testing.assert_allclose(plane.state().angular_velocity, [0, 0, 0.5])
    np.testing.assert_allclose(plane.sense().angular_velocity, [0, 0, 0.5], atol=1e-12)


def test_force_acts_for_its_duration_only() -> None:
    simulation = Simulation(sensing="exact")
    simulation.apply_force(np.array([100.0, 0.0, 0.0]), 0.1)
    torso = simulation.model.body("torso_link").id
    acting = []
    for _ in range(20):
        simulation.step(HOLD, 0.01)
        acting.append(simulation.data.xfrc_applied[torso, 0])
    # Still set after 0.09 s; cleared by the step that starts at 0.1 s.
    assert acting[8] == 100.0
    assert acting[10:] == [0.0] * 10
    with pytest.raises(UnknownNameError, match=r"unknown link 'torso'. Did you mean 'torso_link'"):
        simulation.apply_force(np.zeros(3), 0.1, link="torso")


def test_force_gives_its_impulse_to_the_centre_of_mass() -> None:
    """In the air, 100 N for 0.1 s change the momentum by 10 Ns, and gravity takes 0.2 s of fall."""
    simulation = Simulation(sensing="exact")
    simulation.data.qpos[2] += 5.0
    simulation.apply_force(np.array([100.0, -50.0, 0.0]), 0.1, link="pelvis")
    simulation.step(HOLD, 0.2)
    mujoco.mj_subtreeVel(simulation.model, simulation.data)
    momentum = simulation.data.subtree_linvel[1] * ROBOT.mass
    np.testing.assert_allclose(momentum, [10.0, -5.0, -WEIGHT * 0.2], rtol=0.01)


@pytest.mark.parametrize("moved", [False, True])
def test_a_step_is_that_of_mujoco(moved: bool) -> None:
    """Also from a state that someone has changed since the last step."""
    simulation = Simulation(sensing="exact")
    simulation.step(HOLD, 0.02)
    if moved:
        simulation.data.qpos[2] -= 0.01
    expected = mujoco.MjData(simulation.model)
    mujoco.mj_copyData(expected, simulation.model, simulation.data)
    simulation.step(HOLD, simulation.timestep)
    expected.ctrl[:] = simulation.data.ctrl
    mujoco.mj_step(simulation.model, expected)
    np.testing.assert_array_equal(simulation.data.qvel, expected.qvel)


def test_reset_forgets_forces_and_bad_states() -> None:
    simulation = Simulation(sensing="exact")
    simulation.apply_force(np.array([500.0, 0, 0]), 10.0)
    simulation.data.qpos[2] = np.nan
    simulation.step(HOLD, 0.002)
    assert simulation.diverged and simulation.fallen
    simulation.reset()
    assert not simulation.diverged and not simulation.fallen
    simulation.step(HOLD, 0.02)
    assert not simulation.data.xfrc_applied.any()


@pytest.mark.parametrize(
    ("yaw", "pitch", "roll", "height", "fallen"),
    [
        (2.0, 0.9, 0.0, 2.0, False),
        (2.0, 1.1, 0.0, 2.0, True),
        (2.0, -1.1, 0.0, 2.0, True),
        (0.0, 0.0, 0.7, 2.0, False),
        (0.0, 0.0, -0.9, 2.0, True),
        (0.0, 0.0, 0.0, 0.5, False),
        (0.0, 0.0, 0.0, 0.4, True),
    ],
)
def test_fallen_by_inclination_and_height(plane, yaw, pitch, roll, height, fallen):
    plane.reset()
    plane.data.qpos[2] = height
    plane.data.qpos[3:7] = rotations.from_yaw_pitch_roll(yaw, pitch, roll)
    mujoco.mj_forward(plane.model, plane.data)
    assert plane.fallen is fallen


def test_a_limp_robot_falls_and_lies_still_without_diverging() -> None:
    simulation = Simulation(sensing="exact")
    limp = JointCommand(*np.zeros((5, 19)))
    simulation.push(np.array([1.0, 0.0, 0.0]))
    fell_after = next(step for step in range(200) if (simulation.step(limp, 0.02), simulation.fallen)[1])
    assert 0.2 < fell_after * 0.02 < 2.5
    for _ in range(100):
        simulation.step(limp, 0.02)
    assert simulation.fallen and not simulation.diverged
    assert np.abs(simulation.state().velocity).max() < 0.2


def test_hand_position_of_the_nominal_pose(plane: Simulation) -> None:
    plane.reset()
    left, right = plane.hand_position("left"), plane.hand_position("right")
    # Arms hang, forearms point forward: 0.28 m ahead of the elbow, which sits 1.85 cm ahead of the shoulder.
    np.testing.assert_allclose(left, right * [1, -1, 1], atol=1e-9)
    assert left[0] == pytest.approx(0.28 + 0.0185, abs=1e-6)
    # Heights down the arm: shoulder 0.42999, roll -0.0165 turned by 0.43633 with +0.0565 across, then the links.
    shoulder = 0.42999 + 0.0565 * np.sin(0.43633) - 0.0165 * np.cos(0.43633)
    assert left[2] == pytest.approx(0.982 + shoulder - 0.1343 - 0.198 - 0.015, abs=1e-6)


def test_trunk_against_a_wall_of_ground_counts_as_fallen() -> None:
    """Upright and high above the ground below it, but with the chest in a ridge."""
    heights = np.zeros((41, 61))
    heights[:, 50:] = 1.3  # a grid of 5 cm over 3 m: the ridge begins at x = 1.0 m
    simulation = Simulation(sensing="exact", terrain=HeightField(heights, (3.0, 2.0)))
    simulation.reset(xy=(0.5, 0.0))
    assert not simulation.fallen
    simulation.reset(xy=(0.94, 0.0))
    assert simulation.ground_height(np.array([0.94, 0.0])) == pytest.approx(0.0)
    assert simulation.fallen


def test_latency_returns_the_reading_of_that_time_ago() -> None:
    simulation = Simulation(sensing="exact", latency=0.01)
    start = simulation.reset()
    truths = [start, *(simulation.step(HOLD, 0.002) for _ in range(20))]
    sensed = simulation.sense()
    assert sensed.age == pytest.approx(0.01)
    assert sensed.time == pytest.approx(truths[-6].time)
    np.testing.assert_array_equal(sensed.q, truths[-6].q)
    np.testing.assert_array_equal(sensed.foot_force, truths[-6].foot_force)
    simulation.reset()
    assert simulation.sense().age == 0.0  # nothing older is known


def test_a_reset_leaves_nothing_of_the_gains_before():
    """An accelerometer that still feels soft joints would mislead an estimator at the start of the next run."""
    simulation = Simulation(sensing="exact")
    first = simulation.sense()
    soft = JointCommand(first.q, np.zeros(19), np.full(19, 5.0), np.ones(19), np.zeros(19))
    simulation.step(soft, 0.5)
    simulation.reset()
    again = simulation.sense()
    assert not first.torque.any() and not again.torque.any()  # nothing has been commanded
    for name in ("q", "dq", "orientation", "position", "velocity", "foot_force", "imu_gyro", "imu_accelerometer"):
        assert np.array_equal(getattr(again, name), getattr(first, name)), name
