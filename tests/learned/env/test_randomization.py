"""Each parameter is drawn at two fixed values, and the physics must differ by what mechanics says."""

import numpy as np
import pytest
import torch

from hugwbc.errors import ConfigError
from hugwbc.learned.config import EnvConfig, RandomizationConfig
from hugwbc.learned.env.humanoid_env import HumanoidEnv
from hugwbc.learned.env.randomization import Latency, SensorErrors, draw_delays, randomize
from hugwbc.robot import load_robot
from hugwbc.sim.actuators import Actuators
from hugwbc.sim.batch import BatchSimulation
from hugwbc.sim.sensors import ROBOT as SENSORS

ROBOT = load_robot()
PLAIN = vars(RandomizationConfig.off(friction=1.0))
COUNT = 3


def simulate(**changes: object) -> BatchSimulation:
    simulation = BatchSimulation(COUNT, robot=load_robot())
    config = RandomizationConfig(**{**PLAIN, **changes})  # type: ignore[arg-type]
    randomize(simulation, config, np.random.default_rng(0))
    simulation.ctrl[:] = simulation.tensor(ROBOT.nominal)
    simulation.forward(torch.arange(COUNT))
    return simulation


def torque(simulation: BatchSimulation, error: float, speed: float) -> np.ndarray:
    """Joint torques with every target ahead of its joint by an error [rad], at a joint speed [rad/s]."""
    simulation.ctrl[:] = simulation.tensor(ROBOT.nominal + error)
    simulation.qvel[:, 6:] = speed
    simulation.forward(torch.arange(COUNT))
    return simulation.torque.numpy().copy()


def weight(simulation: BatchSimulation) -> float:
    """Mean force under the feet of a robot that has come to rest [N]."""
    forces = []
    for step in range(120):
        simulation.step(1)
        if step >= 20:
            forces.append(simulation.foot_force()[:, :, 2].sum(1))
    return float(torch.stack(forces).mean())


def slide(simulation: BatchSimulation) -> float:
    """Return how far the soles slide within 0.1 s of a push by 1 m/s, as a mean over robots [m]."""
    simulation.step(10)
    simulation.qvel[:, 0] = 1.0
    start = simulation.sole_position()[:, :, 0]
    simulation.step(20)
    return float((simulation.sole_position()[:, :, 0] - start).mean())


def test_friction_decides_how_far_a_robot_slides() -> None:
    """Less friction than the floor's own counts as well."""
    slid = [slide(simulate(friction=(friction, friction))) for friction in (0.1, 0.2, 0.3, 1.0)]
    assert slid[0] > 1.1 * slid[1] > 1.2 * slid[2]
    assert slid[1] > 2.0 * slid[3]


def test_masses_weigh_on_the_ground() -> None:
    stiff = (4.0, 4.0)  # joints that hardly give, so that the robot is at rest
    plain = weight(simulate(gains=stiff))
    assert plain == pytest.approx(ROBOT.mass * 9.81, rel=0.02)
    assert weight(simulate(gains=stiff, torso_mass=(10.0, 10.0))) == pytest.approx(plain + 98.1, rel=0.02)
    assert weight(simulate(gains=stiff, link_mass=(1.5, 1.5))) == pytest.approx(1.5 * plain, rel=0.02)


def test_heavier_links_are_harder_to_turn() -> None:
    gained = []
    for factor in (1.0, 2.0):
        simulation = simulate(link_mass=(factor, factor))
        simulation.qpos[:, 2] = 2.0  # in the air
        simulation.ctrl[:, ROBOT.index("left_hip_yaw_joint")] += 0.5
        simulation.step(1)
        gained.append(float(simulation.qvel[:, 6 + ROBOT.index("left_hip_yaw_joint")].mean()))
    # Twice the inertia but the same rotor: between half the speed and all of it.
    assert 0.5 * gained[0] < gained[1] < 0.95 * gained[0]


def test_centres_of_mass_move() -> None:
    plain, torso, links = simulate(), simulate(torso_centre=0.1), simulate(link_centre=0.1)
    mass = plain.model.body_mass
    body = plain.model.body("torso_link").id
    centres = [one.batch.bind("subtree_com")[:, 0] for one in (plain, torso, links)]
    shift = torso.expand("body_ipos")[:, body].numpy() - plain.model.body_ipos[body]
    assert 0.01 < np.abs(shift).max() <= 0.1
    # The robot stands upright and looks along x: body axes are world axes but for the nominal joint angles' small yaw.
    np.testing.assert_allclose(centres[1] - centres[0], shift * mass[body] / mass.sum(), atol=1e-6)
    moved = links.expand("body_ipos")[:, 1:].numpy() - plain.model.body_ipos[1:]
    assert (np.abs(moved) <= 0.1).all() and (np.abs(moved).max(axis=(0, 2)) > 0.005).all()
    assert np.abs(centres[2] - centres[0]).max() > 1e-4


def test_gains_strength_and_offset_change_the_torque_of_each_joint() -> None:
    plain = simulate()
    np.testing.assert_allclose(torque(plain, 0.02, 0.1), np.tile(0.02 * ROBOT.kp - 0.1 * ROBOT.kd, (COUNT, 1)))
    half = torque(simulate(strength=(0.5, 0.5)), 0.02, 0.1)
    np.testing.assert_allclose(half, 0.5 * torque(plain, 0.02, 0.1))
    stiff = simulate(gains=(1.5, 1.5))
    np.testing.assert_allclose(torque(stiff, 0.02, 0.1), 1.5 * torque(plain, 0.02, 0.1))
    drawn = simulate(gains=(0.5, 1.5))
    stiffness, damping = torque(drawn, 0.02, 0.0) / (0.02 * ROBOT.kp), torque(drawn, 0.0, -0.1) / (0.1 * ROBOT.kd)
    assert np.ptp(stiffness) > 0.5 and np.abs(stiffness - damping).max() > 0.3  # each joint's own, independent
    shifted = torque(simulate(offset=0.02), 0.0, 0.0) / ROBOT.kp
    assert 0.01 < np.abs(shifted).max() <= 0.02 and np.ptp(shifted) > 0.02
    # Strength scales what the offset asks for as well.
    both = torque(simulate(offset=0.02, strength=(0.5, 0.5), gains=(2.0, 2.0)), 0.0, 0.0) / ROBOT.kp
    assert 0.01 < np.abs(both).max() <= 0.02


def test_what_is_off_changes_no_other_draw() -> None:
    draws = []
    for changes in ({}, {"offset": 0.02, "strength": (0.8, 1.2), "link_mass": (0.8, 1.2)}):
        simulation = BatchSimulation(COUNT, robot=load_robot())
        friction = randomize(simulation, RandomizationConfig(**changes), np.random.default_rng(1))
        draws.append((friction, simulation.expand("geom_friction").clone()))
    np.testing.assert_array_equal(draws[0][0], draws[1][0])
    np.testing.assert_array_equal(draws[0][1], draws[1][1])


def make_env(**changes: object) -> HumanoidEnv:
    randomization = RandomizationConfig(**{**PLAIN, **changes})  # type: ignore[arg-type]
    return HumanoidEnv(EnvConfig(count=COUNT, randomization=randomization, waist_rate=0.0), seed=2, threads=1)


def test_a_push_changes_the_velocity() -> None:
    calm, pushed = make_env(push_interval=1), make_env(push_interval=1, push_velocity=1.0)
    for env, seen in ((calm, False), (pushed, True)):
        env.age[:] = 10
        disturbed = env.step(torch.zeros(COUNT, 19)).disturbed
        assert disturbed is not None
        assert (disturbed[env.agile] == seen).all()  # some arms of the others may be intervened
    change = (pushed.simulation.qvel[:, :2] - calm.simulation.qvel[:, :2]).abs()
    assert (change.amax(1) > 0.05).all() and change.max() < 1.2


def test_damping_has_a_factor_a_joint() -> None:
    simulation, factor = BatchSimulation(COUNT, robot=load_robot()), np.linspace(1.0, 3.0, 19)
    randomize(simulation, RandomizationConfig(**PLAIN), np.random.default_rng(0), factor)  # type: ignore[arg-type]
    np.testing.assert_allclose(torque(simulation, 0.0, 0.1), np.tile(-0.1 * factor * ROBOT.kd, (COUNT, 1)), atol=1e-9)


class Recorder:
    """A stand-in for a simulation that records the target of every physics step."""

    def __init__(self, count: int) -> None:
        self.ctrl, self.device = torch.zeros(count, 1), torch.device("cpu")
        self.acted: list[list[float]] = []

    def step(self, substeps: int, targets: torch.Tensor) -> torch.Tensor:
        assert len(targets) == substeps
        self.acted.extend(targets[:, :, 0].tolist())
        return torch.zeros(len(self.ctrl), dtype=torch.bool)


def test_targets_act_as_many_physics_steps_later_as_each_robot_s_delay() -> None:
    delays = np.array([0, 1, 4, 6])
    simulation = Recorder(4)
    latency = Latency(delays, 4, simulation)  # type: ignore[arg-type]
    latency.reset(torch.arange(4), torch.full((4, 1), -1.0))
    for target in range(4):
        simulation.ctrl[:] = target
        latency.step()
        assert (simulation.ctrl == target).all()
    given = np.repeat(np.arange(4.0), 4)
    for robot, delay in enumerate(delays):
        expected = np.concatenate((np.full(delay, -1.0), given))[:16]
        assert [row[robot] for row in simulation.acted] == expected.tolist()


def test_delays_are_drawn_in_physics_steps() -> None:
    assert draw_delays(5, (0.0, 0.0), 0.005, np.random.default_rng(0)) is None
    delays = draw_delays(2000, (0.005, 0.02), 0.005, np.random.default_rng(0))
    assert delays is not None and set(delays.tolist()) == {1, 2, 3, 4}


def make(latency: float) -> HumanoidEnv:
    env = make_env(latency=(latency, latency))
    env.age[:] = 10
    return env


def test_a_latency_of_a_control_step_shifts_the_motion_by_one() -> None:
    late, prompt = make(0.02), make(0.0)
    generator = torch.Generator().manual_seed(0)
    actions = [0.3 * torch.randn(COUNT, 19, generator=generator) for _ in range(6)]
    scales = prompt.config.action_scales(ROBOT)
    # What acts before the first late target: the joint positions of the start.
    hold = torch.tensor((prompt.simulation.qpos[:, 7:].numpy() - ROBOT.nominal) / scales, dtype=torch.float32)
    for action in actions:
        late.step(action)
    for action in [hold, *actions[:-1]]:
        prompt.step(action)
    np.testing.assert_allclose(late.simulation.qpos, prompt.simulation.qpos, atol=1e-4)
    other = make(0.0)
    for action in actions:
        other.step(action)
    assert (other.simulation.qpos - prompt.simulation.qpos).abs().max() > 0.01


def test_the_state_of_a_run_without_latency_goes_on_with_one() -> None:
    """What acted last goes on until the first late target."""
    late, prompt = make(0.03), make(0.0)
    late.load_state_dict(prompt.state_dict())
    assert late.latency is not None
    torch.testing.assert_close(late.latency.targets[1], prompt.simulation.ctrl)


@pytest.mark.parametrize("latency", [0.0, 0.02])
def test_a_diverged_robot_is_noticed_in_any_physics_step(latency: float) -> None:
    env = make(latency)
    env.simulation.qvel[1, 8] = np.nan
    assert env.step(torch.zeros(COUNT, 19)).done.tolist() == [False, True, False]


def test_all_links_grow_and_shrink_together_to_the_earlier_robot_s_mass() -> None:
    light = simulate(mass=(0.87, 0.87)).expand("body_mass").numpy().sum(1)
    np.testing.assert_allclose(light, 0.87 * ROBOT.mass)
    low, high = RandomizationConfig().mass
    heavy = load_robot("h1").mass
    assert low * heavy < load_robot("h1-2023").mass < heavy < high * heavy


def test_the_friction_of_drives_has_a_factor_a_joint() -> None:
    def friction(factors: tuple[float, float]) -> np.ndarray:
        simulation = BatchSimulation(COUNT, actuators=Actuators(), robot=load_robot())
        randomize(simulation, RandomizationConfig(**{**PLAIN, "drive_friction": factors}), np.random.default_rng(0))
        return simulation.expand("dof_frictionloss")[:, 6:].numpy()

    plain, drawn = friction((1.0, 1.0)), friction((0.5, 1.5))
    np.testing.assert_allclose(plain, np.tile(ROBOT.friction, (COUNT, 1)))
    factor = drawn / plain
    assert 0.5 <= factor.min() < 0.7 and 1.3 < factor.max() <= 1.5 and np.ptp(factor, axis=0).min() > 0.0


def test_the_randomised_range_reaches_from_the_true_state_to_more_than_the_arena_s_errors() -> None:
    config = RandomizationConfig()
    assert config.sensing[0] == 0.0 and config.sensing[1] > 1.0
    least = ROBOT.command_delay
    assert config.latency[0] == 0.0 and config.latency[1] > SENSORS.latency + least


def test_errors_have_the_profile_s_spread_and_biases_stay_for_an_episode(small_env: HumanoidEnv) -> None:
    errors = SensorErrors(8, 19, (1.0, 1.0), torch.Generator().manual_seed(0))
    errors.reset(torch.arange(8))
    truth = small_env.readings
    read = [errors.sensed(truth) for _ in range(400)]
    for name, noise, bias in (("q", SENSORS.encoder, SENSORS.encoder_offset), ("dq", SENSORS.joint_velocity, 0.0),
                              ("angular_velocity", SENSORS.gyro, SENSORS.gyro_bias)):  # fmt: skip
        error = torch.stack([getattr(one, name) - getattr(truth, name) for one in read])
        assert 0.9 * noise < error.std(0).mean() < 1.1 * noise, name
        assert abs(error.mean(0).square().mean().sqrt() - bias) < 0.4 * bias + 0.1 * noise, name
    torch.testing.assert_close(torch.linalg.vector_norm(read[0].gravity, dim=1), torch.ones(8))
    tilt = torch.stack([torch.linalg.cross(truth.gravity, one.gravity) for one in read]).mean(0)
    assert 0.3 * SENSORS.attitude_bias < tilt[:, :2].square().mean().sqrt() < 2.0 * SENSORS.attitude_bias
    before = errors.gyro_bias.clone()
    errors.reset(torch.tensor([3]))
    changed = (errors.gyro_bias != before).any(1)
    assert changed.tolist() == [i == 3 for i in range(8)]


def test_each_robot_has_its_own_factor_and_zero_is_the_truth(small_env: HumanoidEnv) -> None:
    exact = SensorErrors(8, 19, (0.0, 0.0), torch.Generator().manual_seed(0))
    exact.reset(torch.arange(8))
    assert exact.sensed(small_env.readings) is small_env.readings
    factors = SensorErrors(500, 19, (0.5, 1.5), torch.Generator().manual_seed(0)).scale
    assert 0.5 <= factors.min() < 0.6 and 1.4 < factors.max() <= 1.5


def test_what_a_user_draws_of_the_drives_limits_stays() -> None:
    simulation = BatchSimulation(COUNT, robot=load_robot())
    weak = 0.5 * simulation.expand("actuator_forcerange").clone()
    simulation.expand("actuator_forcerange")[:] = weak
    simulation.step(2)
    limits = simulation.expand("actuator_forcerange")
    assert (limits.abs() <= weak.abs() + 1e-6).all() and limits.abs().sum() > 0.9 * weak.abs().sum()


def test_a_trunk_that_would_weigh_less_than_nothing_is_refused() -> None:
    simulation = BatchSimulation(1, robot=load_robot())
    simulation.model.body_mass[simulation.model.body(simulation.robot.trunk).id] = 0.9
    with pytest.raises(ConfigError, match=r"^torso_mass begins at -1 kg, and the trunk of h1 weighs 0.90 kg; begin ab"):
        randomize(simulation, RandomizationConfig(), np.random.default_rng(0))
