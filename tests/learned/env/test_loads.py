"""What hands carry and what pulls, checked on the physics."""

import numpy as np
import torch

from hugwbc.gait import Gait
from hugwbc.learned.config import CommandConfig, EnvConfig, LoadConfig
from hugwbc.learned.env.humanoid_env import HumanoidEnv
from hugwbc.learned.env.loads import Loads
from hugwbc.robot import load_robot
from hugwbc.sim.batch import BatchSimulation

ROBOT = load_robot("h1")
COUNT = 4
NOBODY = torch.zeros(COUNT, dtype=torch.bool)


def make(config: LoadConfig, eligible: tuple[bool, ...] = (True,) * COUNT) -> tuple[BatchSimulation, Loads]:
    simulation = BatchSimulation(COUNT, robot=ROBOT)
    generator = torch.Generator().manual_seed(0)
    return simulation, Loads(simulation, ROBOT, config, torch.tensor(eligible), generator, 0.02)


def test_a_payload_is_a_point_mass_in_the_hand() -> None:
    simulation, loads = make(LoadConfig(payload=4.0, loaded_share=1.0), (True, True, True, False))
    com = simulation.batch.bind("subtree_com")
    simulation.forward(torch.arange(COUNT))
    before = com[:, 0].copy()
    loads.reset(torch.arange(COUNT), NOBODY)
    simulation.forward(torch.arange(COUNT))
    payload = loads.payload.double().numpy()
    assert (payload[:3] > 0.0).all() and payload.max() <= 4.0 and (payload[3] == 0.0).all()
    mass = simulation.expand("body_mass").numpy().sum(1)
    np.testing.assert_allclose(mass, ROBOT.mass + payload.sum(1))
    forearms = [simulation.model.body(f"{side}_elbow_link").id for side in ("left", "right")]
    position, matrix = simulation.batch.bind("xpos"), simulation.batch.bind("xmat")
    simulation.batch.forward()
    hands = position[:, forearms] + np.einsum(
        "nbij,j->nbi", matrix[:, forearms].reshape(COUNT, 2, 3, 3), ROBOT.hands[0]
    )
    moment = ROBOT.mass * before + (payload[..., None] * hands).sum(1)
    np.testing.assert_allclose(com[:, 0], moment / mass[:, None], atol=1e-6)
    # Laid down again, the arms are as light as before.
    loads.config = LoadConfig()
    loads.reset(torch.arange(COUNT), NOBODY)
    np.testing.assert_allclose(simulation.expand("body_mass").numpy().sum(1), ROBOT.mass)


def test_forces_begin_and_end_and_push_where_they_say() -> None:
    config = LoadConfig(
        hand_force=40.0, trunk_force=60.0, hand_interval=0.02, trunk_interval=0.02, hand_time=(0.1, 0.1)
    )
    simulation, loads = make(config, (True, True, True, False))
    hopping = torch.tensor([False, False, True, False])
    loads.step(hopping)
    assert (loads.hand_time[:2] > 0.0).all() and not loads.hand_force[2:].any() and not loads.trunk_force[2:].any()
    assert torch.linalg.vector_norm(loads.hand_force, dim=2).max() <= 40.0
    assert torch.linalg.vector_norm(loads.trunk_force, dim=1).max() <= 60.0 and not loads.trunk_force[:, 2].any()
    total = (loads.hand_force.sum(1) + loads.trunk_force).double().numpy()
    np.testing.assert_allclose(simulation.forces[:, :, :3].sum(1), total)
    simulation.qpos[:, 2] += 1.0  # in the air, where nothing else acts but weight
    simulation.forward(torch.arange(COUNT))
    acceleration = simulation.batch.bind("qacc")
    simulation.batch.forward()
    moved = acceleration[:, :3].copy()
    simulation.forces[:] = 0.0
    simulation.batch.forward()
    change = moved - acceleration[:, :3]
    assert (np.abs(change[:2]).max(1) > 0.01).all() and not change[3].any()
    before = loads.hand_force[:2].clone()
    for _ in range(4):
        loads.step(hopping)
    torch.testing.assert_close(loads.hand_force[:2], before)
    loads.config = LoadConfig()  # as a schedule may ask for in the middle of an episode
    loads.step(hopping)
    assert not simulation.forces.any()
    loads.config = config
    loads.hand_time[:] = loads.trunk_time[:] = 1.0
    loads.hand_force[:] = loads.trunk_force[:] = 5.0
    loads.reset(torch.tensor([0, 1]), NOBODY[:2])
    assert not loads.hand_force[:2].any() and not loads.trunk_force[:2].any()
    assert (loads.hand_time[:2] < 0.0).all() and (loads.trunk_time[:2] < 0.0).all()
    assert loads.hand_force[2:].all() and loads.trunk_force[2:].all(), "the others' go on"


def test_a_force_on_a_hand_acts_at_the_hand() -> None:
    simulation, loads = make(LoadConfig(hand_force=1.0))
    loads.hand_force[:, 0] = torch.tensor([0.0, 0.0, -10.0])
    loads.hand_time[:] = 1.0
    loads.step(torch.zeros(COUNT, dtype=torch.bool))
    body = simulation.model.body("left_elbow_link").id
    centre = simulation.batch.bind("xipos")
    position, matrix = simulation.batch.bind("xpos"), simulation.batch.bind("xmat")
    simulation.batch.forward()
    lever = position[0, body] + matrix[0, body].reshape(3, 3) @ ROBOT.hands[0] - centre[0, body]
    np.testing.assert_allclose(simulation.forces[0, body], [0, 0, -10.0, *np.cross(lever, [0, 0, -10.0])], atol=1e-9)


def test_who_hops_carries_nothing_and_the_agile_group_is_not_loaded() -> None:
    command = CommandConfig(standing_fraction=0.0, walking_fraction=0.5, hopping_fraction=0.5, resample_steps=3)
    loads = LoadConfig(payload=4.0, loaded_share=1.0)
    env = HumanoidEnv(EnvConfig(count=32, command=command, loads=loads), seed=0, threads=1)
    assert (env.gait[16:] >= Gait.HOPPING_LEFT).any()
    for _ in range(7):
        hops, loaded = env.gait >= Gait.HOPPING_LEFT, env.loads.payload.any(1)
        assert hops.any() and loaded.any() and not (hops & loaded).any() and not loaded[:16].any()
        assert env.observe().critic.isfinite().all()
        env.step(torch.zeros(32, len(ROBOT.joint_names)))


def test_what_the_critic_sees_is_in_the_heading_frame() -> None:
    _, loads = make(LoadConfig())
    loads.payload[0, 1] = 2.0
    loads.hand_force[0, 1] = torch.tensor([1.0, 2.0, 4.0])
    loads.trunk_force[0] = torch.tensor([0.0, 3.0, 0.0])
    row = loads.observation(torch.full((COUNT,), np.pi / 2))[0]
    torch.testing.assert_close(row[:2], torch.tensor([0.0, 2.0]))
    torch.testing.assert_close(row[2:8], torch.tensor([0.0, 0.0, 0.0, 2.0, -1.0, 4.0]), atol=1e-6, rtol=0.0)
    torch.testing.assert_close(row[8:], torch.tensor([3.0, 0.0, 0.0]), atol=1e-6, rtol=0.0)
