import dataclasses

import numpy as np
import pytest
import torch

from hugwbc import rotations
from hugwbc.commands import COMMAND_SIGNS, command_ranges
from hugwbc.errors import UnknownNameError
from hugwbc.gait import Gait
from hugwbc.kinematics import Kinematics
from hugwbc.learned.config import CommandConfig, CurriculumConfig, EnvConfig, LoadConfig, RandomizationConfig
from hugwbc.learned.env.humanoid_env import START_JOINT_NOISE, START_VELOCITY, HumanoidEnv
from hugwbc.learned.env.readings import read
from hugwbc.learned.policy import critic_observations as obs
from hugwbc.learned.policy.terms import ACTION, COMMAND, CRITIC_CORE, ESTIMATE, HISTORY, size_of
from hugwbc.robot import SIDES, load_mirror, load_robot
from hugwbc.rotations import AXIAL_SIGNS, VECTOR_SIGNS
from hugwbc.state import RobotState
from tests.conftest import QUATERNION_SIGNS


def run(env: HumanoidEnv, steps: int, seed: int = 0) -> None:
    generator = torch.Generator().manual_seed(seed)
    for _ in range(steps):
        env.step(0.3 * torch.randn(env.actions[0].shape, generator=generator))


def state_of(env: HumanoidEnv, i: int) -> RobotState:
    qpos, qvel = env.simulation.qpos[i].numpy(), env.simulation.qvel[i].numpy()
    return RobotState(
        q=qpos[7:], dq=qvel[6:], orientation=qpos[3:7], angular_velocity=qvel[3:6], position=qpos[:3],
        velocity=qvel[:3],
    )  # fmt: skip


@pytest.mark.parametrize("robot", ["h1", "g1"])
def test_measured_quantities_agree_with_pinocchio(robot: str) -> None:
    env = HumanoidEnv(EnvConfig(count=8, robot=robot), seed=3, threads=1)
    run(env, 15)
    kinematics, r = Kinematics(load_robot(robot)), env.readings
    for i in range(env.count):
        state = state_of(env, i)
        kinematics.update(state)
        m = kinematics.measured()
        assert r.velocity[i, :2].tolist() == pytest.approx([m.v_x, m.v_y], abs=1e-5)
        assert r.yaw_rate[i].item() == pytest.approx(m.omega, abs=1e-4)
        assert r.height[i].item() == pytest.approx(m.h, abs=1e-5)
        assert r.pitch[i].item() == pytest.approx(m.p, abs=1e-5)
        assert r.roll[i].item() == pytest.approx(rotations.roll_of(state.orientation), abs=1e-5)
        assert r.heading[i].item() == pytest.approx(state.yaw, abs=1e-5)
        assert r.clearance[i].tolist() == pytest.approx(m.clearance, abs=1e-5)
        apart = kinematics.position("left_sole") - kinematics.position("right_sole")
        assert r.foot_offset[i].tolist() == pytest.approx(rotations.rotation_z(-state.yaw) @ apart, abs=1e-5)
        velocities = [kinematics.velocity(f"{side}_sole")[:3] for side in SIDES]
        np.testing.assert_allclose(r.foot_velocity[i], velocities, atol=1e-4)


def test_same_seed_same_run_whatever_the_threads() -> None:
    config = dataclasses.replace(EnvConfig(), count=8)
    a, b = HumanoidEnv(config, seed=5, threads=1), HumanoidEnv(config, seed=5, threads=2)
    c = HumanoidEnv(config, seed=6, threads=1)
    for env in (a, b, c):
        run(env, 40)
    assert np.array_equal(a.simulation.qpos, b.simulation.qpos)
    assert not np.array_equal(a.simulation.qpos, c.simulation.qpos)


def test_a_fallen_robot_ends_as_a_failure_and_starts_anew(small_env: HumanoidEnv) -> None:
    small_env.age[:] = 10
    small_env.simulation.qpos[2, 3:7] = torch.tensor([np.cos(0.6), 0.0, np.sin(0.6), 0.0])  # pitched by 1.2 rad
    result = small_env.step(torch.zeros(8, 19))
    assert result.terminated[2] and not result.truncated[2] and result.done[2]
    assert result.reward[2] < -3.0  # the paper's -200 times the period
    assert small_env.age[2] == 0
    assert small_env.readings.pitch[2].abs() < 0.2


def test_a_time_out_is_told_from_a_failure(small_env: HumanoidEnv) -> None:
    small_env.age[:] = 10
    small_env.age[5] = small_env.config.episode_steps - 1
    result = small_env.step(torch.zeros(8, 19))
    assert result.truncated.nonzero().tolist() == [[5]] and not result.terminated.any()
    assert result.final.critic.shape == (1, 121 + 1)
    assert small_env.age[5] == 0


def test_a_diverged_robot_touches_no_other() -> None:
    config = dataclasses.replace(EnvConfig(), count=6)
    healthy, faulty = HumanoidEnv(config, seed=5, threads=1), HumanoidEnv(config, seed=5, threads=1)
    for env in (healthy, faulty):
        env.age[:] = 10
    faulty.simulation.qvel[3, 10] = np.nan
    action = torch.zeros(6, 19)
    a, b = healthy.step(action), faulty.step(action)
    others = [0, 1, 2, 4, 5]
    assert b.done[3] and torch.isfinite(b.reward).all()
    assert torch.equal(a.reward[others], b.reward[others])
    assert torch.equal(healthy.simulation.qpos[others], faulty.simulation.qpos[others])
    assert faulty.statistics.pop()["diverged"] == 1
    assert faulty.simulation.qpos.isfinite().all()


PAPER = [(-0.6, 0.6), (-0.6, 0.6), (-0.6, 0.6), (1.5, 3.5), (0.1, 0.35), (-0.3, 0.0), (0.0, 0.4), (-1.0, 1.0)]


@pytest.mark.parametrize(
    ("robot", "ranges"),
    [("h1", PAPER), ("g1", [limits.initial for limits in command_ranges(Gait.WALKING, load_robot("g1")).values()])],
)
def test_commands_fill_their_ranges_and_standing_has_no_velocity(robot: str, ranges: list[tuple[float, float]]) -> None:
    env = HumanoidEnv(EnvConfig(count=500, robot=robot), seed=0, threads=1)
    low, high = torch.tensor(ranges).T
    lowest, highest, margin = env.command.min(0).values, env.command.max(0).values, 0.05 * (high - low)
    assert (lowest >= low - 1e-6).all() and (highest <= high + 1e-6).all()
    assert (lowest < low + margin).all() and (highest > high - margin).all()
    standing = env.gait == Gait.STANDING
    assert not env.command[standing, :3].any()
    assert standing.float().mean().item() == pytest.approx(0.2, abs=0.04)


def test_the_flying_leg_of_a_hop_is_to_stay_in_the_air(small_env: HumanoidEnv) -> None:
    small_env.gait[:4], small_env.gait[4:] = int(Gait.HOPPING_LEFT), int(Gait.HOPPING_RIGHT)
    small_env.phase[:] = 0.25
    transition = small_env._transition(small_env.readings, torch.zeros(8, dtype=torch.bool))
    contact = torch.tensor([[1.0, 0.0]] * 4 + [[0.0, 1.0]] * 4)
    torch.testing.assert_close(transition.contact, contact, atol=1e-5, rtol=0.0)
    torch.testing.assert_close(transition.target_clearance, (1.0 - contact) * small_env.command[:, 4:5])
    assert not transition.in_phase.any()


def test_a_gait_whose_episodes_end_early_keeps_its_share_of_the_time() -> None:
    command = CommandConfig(standing_fraction=0.5, walking_fraction=0.0, hopping_fraction=0.5, resample_steps=60)
    env = HumanoidEnv(EnvConfig(count=64, command=command, swing_gain=1.0), seed=0, threads=1)
    hops = []
    for _ in range(180):  # hops fall within a second, untrained, and stands after it
        env.step(torch.zeros_like(env.actions[0]))
        hops.append((env.gait >= Gait.HOPPING_LEFT).float().mean())
    assert env.statistics.pop()["episodes"] > 150
    assert float(torch.stack(hops).mean()) == pytest.approx(0.5, abs=0.1)


def test_hopping_robots_are_left_without_intervention(small_env: HumanoidEnv) -> None:
    small_env.gait[:] = int(Gait.WALKING)
    small_env.gait[6:] = int(Gait.HOPPING_LEFT)
    small_env.intervention.flip_probability = 1.0
    small_env.age[:] = 10
    small_env.step(torch.zeros(8, 19))
    assert small_env.intervention.active.tolist() == [False] * 4 + [True] * 2 + [False] * 2


def test_gait_and_command_change_in_mid_episode_and_the_phase_goes_on() -> None:
    env = HumanoidEnv(EnvConfig(count=200), seed=0, threads=1)
    env.age[:] = env.config.command.resample_steps - 1
    env.age[100:] = 10
    gait, command, phase = env.gait.clone(), env.command.clone(), env.phase.clone()
    result = env.step(torch.zeros(200, 19))
    changed = env.gait != gait
    kept = ~result.done
    assert 30 < int(changed[:100].sum()) < 90 and not changed[100:][kept[100:]].any()
    assert (env.command[:100] != command[:100]).any(1)[kept[:100]].all()
    advanced = (phase + 0.02 * command[:, 3]) % 1.0
    torch.testing.assert_close(env.phase[kept], advanced[kept])
    assert (env.age[:100][kept[:100]] == env.config.command.resample_steps).all()


def test_what_is_not_the_doing_of_a_robot_is_told_in_the_step_in_which_it_happens() -> None:
    calm = dataclasses.replace(RandomizationConfig(), push_velocity=0.0)
    loads = LoadConfig(hand_force=20.0, trunk_force=20.0, hand_interval=0.2, trunk_interval=0.2)
    command = CommandConfig(resample_steps=7)
    env = HumanoidEnv(EnvConfig(count=64, randomization=calm, loads=loads, command=command), seed=0, threads=1)

    def outside() -> torch.Tensor:
        forces = (env.loads.hand_force.flatten(1), env.loads.trunk_force)
        return torch.cat((*forces, env.intervention.active[:, None], env.command), 1)

    told = 0
    for _ in range(20):
        before = outside()
        result = env.step(torch.zeros(64, 19))
        going_on = ~result.done
        assert (result.disturbed == (outside() != before).any(1))[going_on].all()
        told += int(result.disturbed[going_on].sum())
    assert told > 200


def test_intervened_arms_receive_the_noise_targets(small_env: HumanoidEnv) -> None:
    small_env.curriculum.alpha = 1.0
    small_env.intervention.active[:] = False
    small_env.intervention.flip_probability = 0.0
    small_env.intervention.active[4:] = True
    small_env.age[:] = 10
    small_env.step(torch.zeros(8, 19))
    arms = small_env.robot.arms
    ctrl = small_env.simulation.ctrl[:, arms].float()
    torch.testing.assert_close(ctrl[4:], small_env.intervention.source.targets()[4:])
    torch.testing.assert_close(ctrl[:4], torch.tensor(small_env.robot.nominal[arms]).float().expand(4, 8))


def test_yaw_joints_have_their_own_action_scale_and_damping() -> None:
    config = EnvConfig(count=2, action_scale=0.2, yaw_action_factor=0.5, yaw_damping_factor=2.0)
    env = HumanoidEnv(config, seed=0, threads=1)
    yaw = env.robot.yaw_joints
    assert {env.robot.joint_names[i] for i in yaw} == {"left_hip_yaw_joint", "right_hip_yaw_joint", "torso_joint"}
    env.command[:] = 0.0
    env.step(torch.ones(2, 19))
    target = env.simulation.ctrl.numpy() - env.robot.nominal
    others = np.setdiff1d(np.arange(19), yaw)
    np.testing.assert_allclose(target[:, yaw], 0.1, atol=1e-6)
    np.testing.assert_allclose(target[:, others], 0.2, atol=1e-6)
    expected = env.robot.kd * np.where(np.isin(np.arange(19), yaw), 2.0, 1.0)
    np.testing.assert_allclose(env.config.damping(env.robot), expected)


def test_without_robots_to_intervene_on_the_noise_level_stays() -> None:
    curriculum = CurriculumConfig(agile_fraction=1.0, warm_up_iterations=0, alpha_interval=1)
    env = HumanoidEnv(EnvConfig(count=2, curriculum=curriculum), seed=0, threads=1)
    env.step(torch.zeros(2, 19))
    env.update_curriculum()
    assert env.curriculum.alpha == 0.0 and env.curriculum.gates["alpha"] == "off: no intervention"


def mirrored_twin(env: HumanoidEnv, twin: HumanoidEnv) -> None:
    """Put another environment into the mirror image of one."""
    mirror = load_mirror(env.robot)
    twin.age[:] = env.age
    twin.gait[:] = torch.tensor([int(Gait(int(value)).mirrored()) for value in env.gait])
    twin.command[:] = env.command * torch.tensor(COMMAND_SIGNS, dtype=torch.float32)
    twin.phase[:] = torch.where(env.gait == Gait.WALKING, (env.phase + 0.5) % 1.0, env.phase)
    twin.waist[:] = -env.waist
    twin.bias[:] = env.bias * torch.tensor([1.0, -1.0, -1.0])
    twin.actions[:] = torch.stack([obs.mirror(ACTION, env.robot)(actions) for actions in env.actions])
    twin.history[:] = obs.mirror(HISTORY, env.robot)(env.history.flatten(1)).view_as(env.history)
    qpos, qvel = env.simulation.qpos.numpy(), env.simulation.qvel.numpy()
    new_qpos, new_qvel = twin.simulation.qpos.numpy(), twin.simulation.qvel.numpy()
    pose = np.concatenate((qpos[:, :3] * VECTOR_SIGNS, qpos[:, 3:7] * QUATERNION_SIGNS), axis=1)
    new_qpos[:] = np.concatenate((pose, mirror.joints(qpos[:, 7:])), axis=1)
    speed = np.concatenate((qvel[:, :3] * VECTOR_SIGNS, qvel[:, 3:6] * AXIAL_SIGNS), axis=1)
    new_qvel[:] = np.concatenate((speed, mirror.joints(qvel[:, 6:])), axis=1)
    twin.simulation.ctrl[:] = torch.from_numpy(mirror.joints(env.simulation.ctrl.numpy()))
    twin.simulation.forward(torch.arange(env.count))
    twin.readings = read(twin.simulation)


def assert_mirrored(env: HumanoidEnv, twin: HumanoidEnv) -> None:
    """Compare what both observe, but for the terrain."""
    seen, image = env.observe(), twin.observe()
    torch.testing.assert_close(image.history, obs.mirror(HISTORY, env.robot)(seen.history), atol=0.02, rtol=0.0)
    torch.testing.assert_close(image.command, obs.mirror(COMMAND, env.robot)(seen.command), atol=1e-5, rtol=0.0)
    core = slice(0, size_of(CRITIC_CORE, env.robot))
    critic = obs.mirror(CRITIC_CORE, env.robot)(seen.critic[:, core])
    torch.testing.assert_close(image.critic[:, core], critic, atol=0.05, rtol=0.0)
    torch.testing.assert_close(image.estimate, obs.mirror(ESTIMATE, env.robot)(seen.estimate), atol=0.01, rtol=0.0)


@pytest.mark.parametrize("robot", ["h1", "g1"])
def test_a_mirrored_robot_sees_the_mirror_image_and_gets_the_same_reward(robot: str) -> None:
    config = EnvConfig(count=8, robot=robot, randomization=RandomizationConfig.off(), intervention="none")
    env, twin = (HumanoidEnv(config, seed=3, threads=1) for _ in range(2))
    env.gait[:] = torch.tensor([*Gait, Gait.WALKING, Gait.JUMPING, Gait.WALKING])
    env.age[:] = 10
    run(env, 6)
    mirrored_twin(env, twin)
    generator = torch.Generator().manual_seed(1)
    for _ in range(4):
        action = 0.3 * torch.randn(env.actions[0].shape, generator=generator)
        reward, image = env.step(action).reward, twin.step(obs.mirror(ACTION, env.robot)(action)).reward
        # The order in which the solver goes through the contacts leaves a little: rewards are of the size of 0.1.
        torch.testing.assert_close(image, reward, atol=2e-3, rtol=0.0)
        assert_mirrored(env, twin)


def test_mirrored_loads_are_seen_as_the_mirror_image() -> None:
    config = EnvConfig(count=8, randomization=RandomizationConfig.off(), intervention="none")
    env, twin = (HumanoidEnv(config, seed=3, threads=1) for _ in range(2))
    env.simulation.forward(torch.arange(8))
    env.readings = read(env.simulation)
    mirrored_twin(env, twin)
    torch.manual_seed(0)
    payload, hand, trunk = 4.0 * torch.rand(8, 2), 30.0 * torch.randn(8, 2, 3), 30.0 * torch.randn(8, 3)
    signs = torch.tensor(VECTOR_SIGNS, dtype=torch.float32)
    env.loads.payload[:], env.loads.hand_force[:], env.loads.trunk_force[:] = payload, hand, trunk
    twin.loads.payload[:], twin.loads.hand_force[:] = payload.flip(1), hand.flip(1) * signs
    twin.loads.trunk_force[:] = trunk * signs
    assert_mirrored(env, twin)


def test_restored_run_continues_bit_for_bit() -> None:
    config = dataclasses.replace(EnvConfig(), count=8)
    straight = HumanoidEnv(config, seed=5, threads=1)
    run(straight, 20, seed=1)
    state = {name: value.clone() for name, value in straight.state_dict().items()}
    resumed = HumanoidEnv(config, seed=5, threads=1)
    resumed.load_state_dict(state)
    for env in (straight, resumed):
        run(env, 20, seed=2)
    assert torch.equal(straight.simulation.qpos, resumed.simulation.qpos)
    assert torch.equal(straight.observe().critic, resumed.observe().critic)


ROBOTS = ("h1", "h1-2023")


def test_the_robot_of_the_settings_is_simulated():
    environments = {name: HumanoidEnv(EnvConfig(count=1, robot=name), seed=0, threads=1) for name in ROBOTS}
    masses = {name: env.simulation.model.body_mass.sum() for name, env in environments.items()}
    assert masses == {name: pytest.approx(load_robot(name).mass) for name in ROBOTS}
    with pytest.raises(UnknownNameError, match="robot"):
        EnvConfig(robot="g9")


def test_starts_are_about_the_nominal_pose_in_any_heading(small_env: HumanoidEnv) -> None:
    states, simulation = [], small_env.simulation
    for _ in range(63):
        small_env._place(torch.arange(8))
        states.append(torch.cat((simulation.qpos, simulation.qvel), 1))
    qpos, qvel = np.split(torch.cat(states).numpy(), [26], axis=1)
    nominal = small_env.nominal_qpos.numpy()
    np.testing.assert_array_equal(qpos[:, [0, 1, 2, 4, 5]], np.tile(nominal[[0, 1, 2, 4, 5]], (len(qpos), 1)))
    np.testing.assert_allclose(np.linalg.norm(qpos[:, 3:7], axis=1), 1.0, atol=1e-6)
    headings = 2.0 * np.arctan2(qpos[:, 6], qpos[:, 3])
    assert headings.min() < -3.0 and headings.max() > 3.0 and abs(headings.mean()) < 0.3
    for values, half_width in ((qpos[:, 7:] - nominal[7:], START_JOINT_NOISE), (qvel[:, :6], START_VELOCITY)):
        assert np.abs(values).max() <= half_width + 1e-6
        assert values.std() == pytest.approx(half_width / np.sqrt(3.0), rel=0.05)
    assert not qvel[:, 6:].any()
