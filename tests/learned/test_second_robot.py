"""The learned room on a second robot, the G1: 29 joints, 9 contact links, wrists and waist joints in no chain."""

import shutil

import numpy as np
import pytest
import torch

from hugwbc import Command, Gait, UpperBody, load_robot
from hugwbc.errors import ConfigError
from hugwbc.learned.config import EnvConfig, PPOConfig, RandomizationConfig, TrainConfig
from hugwbc.learned.env import HumanoidEnv
from hugwbc.learned.env.arm_intervention import NoiseTargets
from hugwbc.learned.policy import load_policy
from hugwbc.learned.rl.trainer import Trainer
from hugwbc.runtime import rollout
from hugwbc.runtime.controllers import ControllerSpec, load_controller
from hugwbc.scripts.motion import arm_noise_range, generate_motions, load_motion
from hugwbc.sim import Simulation
from hugwbc.sim.arena import Arena

G1 = load_robot("g1")


@pytest.mark.parametrize("intervention", ["noise", "motion"])
def test_sixteen_g1_step_with_finite_rewards(intervention) -> None:
    config = EnvConfig(count=16, robot="g1", intervention=intervention, squat_gain=1.0, swing_gain=0.5)
    env = HumanoidEnv(config, seed=1, threads=1)
    env.curriculum.alpha = 1.0
    generator = torch.Generator().manual_seed(0)
    for _ in range(50):
        result = env.step(0.5 * torch.randn(16, 29, generator=generator))
        assert bool(torch.isfinite(result.reward).all())
    seen = env.observe()
    assert seen.history.shape == (16, 5 * 93) and seen.critic.shape == (16, 93 + 18 + 38 + 1)
    assert all(bool(torch.isfinite(part).all()) for part in (seen.history, seen.command, seen.critic, seen.estimate))


def test_joints_in_no_chain_are_held_by_their_drives_at_action_0() -> None:
    """In a stand, waist roll and pitch stay at their nominal positions, which are 0."""
    config = EnvConfig(count=2, robot="g1", intervention="none", randomization=RandomizationConfig.off())
    env = HumanoidEnv(config, seed=1, threads=1)
    env.command[:], env.gait[:] = 0.0, int(Gait.STANDING)
    for _ in range(15):
        env.step(torch.zeros(2, 29))
    assert len(G1.held) == 2 and float(env.readings.q[:, env.body.held].abs().max()) < 0.06


def test_a_policy_of_a_g1_is_learnt_saved_and_refused_for_an_h1(tmp_path, monkeypatch) -> None:
    config = TrainConfig(
        env=EnvConfig(count=4, robot="g1"),
        ppo=PPOConfig(horizon=4, minibatches=1),
        steps=32,
        seed=1,
        threads=1,
        evaluation_steps=0,
        out=tmp_path,
    )
    trainer = Trainer(config)
    trainer.run(lambda row, gates: None)
    assert trainer.iteration == 2 and trainer.ppo.skipped == 0
    policy = load_policy(tmp_path)
    assert policy.robot is G1 and policy.contract.joints == G1.joint_names
    state = Simulation(robot=G1, sensing="exact").reset()
    policy.reset(state)
    command = policy.act(state, Command(v_x=0.3, gait=Gait.WALKING), UpperBody.none())
    assert command.q.shape == (29,) and np.abs(command.q - G1.nominal).max() < 0.5
    name = f"policy '{tmp_path.name}' is for the robot g1, and this is h1"
    with pytest.raises(ConfigError, match=name):
        ControllerSpec("learned", str(tmp_path)).told(Arena())
    with pytest.raises(ConfigError, match=name):
        load_controller("learned", str(tmp_path), robot="h1")
    ControllerSpec("learned", str(tmp_path)).told(Arena(robot="g1"))
    shutil.copytree(tmp_path, tmp_path / "models/g1/policies/g1")
    monkeypatch.setattr("hugwbc.learned.policy.network_files.models_dir", lambda: tmp_path / "models")
    assert ControllerSpec("learned").told(Arena(robot="g1")).label == "learned g1", "the shipped one, once there is one"
    assert rollout("learned", Command(), Simulation(robot=G1), duration=0.1).robot == "g1"
    with pytest.raises(ConfigError, match=r"snapshot.safetensors is for the robot g1, and this is h1"):
        Trainer(TrainConfig(env=EnvConfig(count=4), start_from=tmp_path / "snapshot.safetensors", out=tmp_path / "b"))


def test_noise_of_the_arms_stays_within_their_range_and_mirrors() -> None:
    low, high = arm_noise_range(G1)
    assert (low >= G1.lower[G1.arms]).all() and (high <= G1.upper[G1.arms]).all()
    assert high[0] == 2.6 and high[2] == G1.upper[G1.arms][2] == 2.618, "the authors' or the limit"
    np.testing.assert_allclose([low[8], high[8]], [-high[1], -low[1]])  # shoulder roll
    np.testing.assert_allclose([low[7], high[7]], [low[0], high[0]])  # shoulder pitch
    targets = NoiseTargets(G1, 50, 90, torch.Generator().manual_seed(0)).targets()
    assert targets.shape == (50, 14)


def test_a_motion_file_is_read_for_the_robot_whose_arms_it_moves(tmp_path) -> None:
    (motion,) = generate_motions(G1, seed=0, count=1, duration=1.0)
    motion.save(tmp_path / "g1.npz")
    np.testing.assert_array_equal(load_motion(tmp_path / "g1.npz", G1).positions, motion.positions)
    bent = np.zeros((51, 14))
    bent[:, 2] = 4.0  # shoulder yaw, within the H1's range alone
    np.savez(tmp_path / "h1.npz", fps=50.0, joint_names=np.array(G1.arm_names), positions=bent)
    with pytest.raises(ConfigError, match=r"beyond joint limits.*the signs and zeros of the g1"):
        load_motion(tmp_path / "h1.npz", G1)
