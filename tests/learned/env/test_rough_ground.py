import dataclasses

import numpy as np
import torch

from hugwbc.learned.config import EnvConfig, RandomizationConfig, TerrainConfig
from hugwbc.learned.env.humanoid_env import HumanoidEnv
from hugwbc.learned.env.rough_ground import RoughGround
from hugwbc.learned.policy import critic_observations as obs
from hugwbc.learned.policy.terms import LENGTH_SCALE, TERRAIN_SIZE

ROUGH = TerrainConfig(roughness=0.05, levels=4)


def make(count: int = 8, config: TerrainConfig = ROUGH) -> RoughGround:
    return RoughGround(count, config, np.random.default_rng(0))


def make_env(count: int = 8, **terrain: float) -> HumanoidEnv:
    calm = RandomizationConfig(push_velocity=0.0)
    config = EnvConfig(count=count, terrain=dataclasses.replace(ROUGH, **terrain), randomization=calm)
    return HumanoidEnv(config, seed=3, threads=1)


def test_heights_are_those_of_the_field() -> None:
    ground, rng = make(), np.random.default_rng(1)
    half = np.array(ground.terrain.size) / 2.0
    xy = rng.uniform(-half, half, (2000, 2))
    heights = ground.height_at(torch.tensor(xy, dtype=torch.float32)).numpy()
    np.testing.assert_allclose(heights, ground.terrain.height_at(xy), atol=2e-5)
    assert torch.isfinite(ground.height_at(torch.tensor([[np.nan, np.inf], [-1e9, 0.0]]))).all()


def test_samples_are_what_rays_of_the_simulation_hit() -> None:
    env = make_env(start_level=3)
    assert env.ground is not None
    position, heading = env.readings.position, env.readings.heading
    samples = env.ground.samples(position[:, :2], heading).numpy()
    points = obs.terrain_points().numpy()
    cos, sin = heading.cos().numpy()[:, None], heading.sin().numpy()[:, None]
    x = position[:, :1].numpy() + cos * points[:, 0] - sin * points[:, 1]
    y = position[:, 1:2].numpy() + sin * points[:, 0] + cos * points[:, 1]
    origins = np.stack((x, y, np.full_like(x, 3.0)), axis=-1)
    only_floor = np.array([1, 0, 0, 0, 0, 0], dtype=np.uint8)
    distance, _ = env.simulation.batch.ray(pnt=origins, vec=np.array([0.0, 0.0, -1.0]), geomgroup=only_floor)
    np.testing.assert_allclose(samples, 3.0 - distance, atol=2e-5)
    expected = (position[:, 2:] - env.robot.nominal_height - torch.from_numpy(samples)) * LENGTH_SCALE
    torch.testing.assert_close(env.observe().critic[:, -TERRAIN_SIZE:], expected)
    assert samples.std() > 0.005


def test_levels_get_rougher_and_repeat_after_a_period() -> None:
    ground = make()
    # As far as the feet and the samples of a robot reach that has not been moved back yet.
    grid = torch.cartesian_prod(torch.linspace(-3.0, 3.0, 61), torch.linspace(-3.0, 3.0, 61))
    largest = [ground.height_at(grid + centre).abs().max().item() for centre in ground._centres]
    assert largest[0] == 0.0
    assert largest == sorted(largest) and 0.045 < largest[3] <= 0.05
    for centre in ground._centres:
        for direction in ([4.0, 0.0], [0.0, -4.0]):
            period = torch.tensor(direction)
            here = grid[(grid * period).sum(1) < -4.0] + centre  # more than 1 m on the other side
            torch.testing.assert_close(ground.height_at(here), ground.height_at(here + period), atol=1e-5, rtol=0.0)


def test_robots_that_go_far_are_moved_by_whole_periods() -> None:
    ground = make(3)
    ground.level[:] = torch.tensor([0, 3, 1])
    xy = ground._centres[ground.level] + torch.tensor([[2.3, -1.0], [-9.0, 2.4], [2.1, -2.2]])
    assert ground.shift(xy).tolist() == [[-4.0, 0.0], [8.0, -4.0], [0.0, 0.0]]


def test_levels_follow_falls_and_tracking_and_the_gate_says_why() -> None:
    ground = make(5)
    ground.level[:] = torch.tensor([0, 1, 2, 3, 3])
    fell = torch.tensor([True, True, False, False, False])
    ground.advance(torch.arange(5), fell, torch.tensor([0.9, 0.9, 0.75, 0.9, 0.31]))
    assert ground.level.tolist() == [0, 0, 3, 3, 3]
    assert ground.report() == "level 1.80 of 3, 2 up, 2 fell back, 1 held: linear velocity reward 0.31 < 0.70"
    assert ground.report() == "level 1.80 of 3, 0 up, 0 fell back"


def test_robots_start_on_their_level_with_their_feet_above_the_ground() -> None:
    env = make_env(count=64, start_level=3)
    ground = env.ground
    assert ground is not None
    assert torch.bincount(ground.level).tolist() == [16] * 4
    offset = env.readings.position[:, :2] - ground._centres[ground.level]
    assert offset.abs().max() <= 2.0
    # Joints start up to 0.1 rad from nominal, which lowers a sole's centre by a few centimetres at most.
    assert env.readings.clearance.min() > -0.04 and env.readings.clearance.max() < 0.2
    for _ in range(25):
        env.step(torch.zeros(64, 19))
    # The robots stand now: soles on the local ground, a spot of it above or below their centres.
    standing = env.readings.pitch.abs() < 0.3
    assert standing.float().mean() > 0.5
    assert env.readings.clearance[standing].abs().median() < 0.03


def test_a_robot_at_the_end_of_its_region_is_moved_and_notices_nothing() -> None:
    env, other = make_env(start_level=3), make_env(start_level=3)
    assert env.ground is not None
    for one, distance in ((env, 2.2), (other, 2.2 - 4.0)):
        one.simulation.qpos[:, 0] = one.ground._centres[one.ground.level, 0] + distance
        one.simulation.forward(torch.arange(8))
        one.age[:] = 10
    for _ in range(3):
        for one in (env, other):
            one.simulation.qvel[:, 0] += 1.0
            one.step(torch.zeros(8, 19))
    offset = env.simulation.qpos[:, 0] - env.ground._centres[env.ground.level, 0]
    assert (offset < 0.0).all()
    torch.testing.assert_close(env.readings.clearance, other.readings.clearance, atol=1e-3, rtol=0.0)


def test_a_run_on_a_plane_goes_on_on_rough_ground() -> None:
    flat = HumanoidEnv(EnvConfig(count=8), seed=3, threads=1)
    flat.simulation.qpos[:, 0] += 30.0
    assert not any(name.startswith("terrain") for name in flat.state_dict())
    env = make_env()
    env.load_state_dict(flat.state_dict())
    assert not env.ground.shift(env.readings.position[:, :2]).any()


def test_a_robot_that_has_just_passed_the_end_of_its_region_is_resumed_as_it_is() -> None:
    """A robot is moved back in the next step, in the resumed run as in the uninterrupted one."""
    straight, resumed = make_env(start_level=3), make_env(start_level=3)
    straight.age[:] = 10
    straight.simulation.qpos[:, 0] = straight.ground._centres[straight.ground.level, 0] + 2.24
    straight.simulation.qvel[:, 0] = 1.0
    straight.simulation.forward(torch.arange(8))
    straight.step(torch.zeros(8, 19))
    assert straight.ground.shift(straight.readings.position[:, :2]).any(1).all()
    resumed.load_state_dict({name: value.clone() for name, value in straight.state_dict().items()})
    for env in (straight, resumed):
        env.step(torch.zeros(8, 19))
    assert torch.equal(straight.simulation.qpos, resumed.simulation.qpos)
