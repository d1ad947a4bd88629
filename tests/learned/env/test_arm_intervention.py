import pathlib

import numpy as np
import pytest
import torch

from hugwbc.errors import ConfigError
from hugwbc.learned.env.arm_intervention import (
    FADE_STEPS,
    NOISE_INTERVAL,
    ArmGains,
    ArmTargets,
    Intervention,
    MotionTargets,
    NoiseTargets,
    make_arm_targets,
)
from hugwbc.robot import load_mirror, load_robot
from hugwbc.scripts.motion import MOTION_FPS, ArmMotion, arm_noise_range, generate_motions
from hugwbc.sim.batch import BatchSimulation

ROBOT = load_robot()

FIRST = torch.tensor([0])
NOMINAL = torch.tensor(load_robot().nominal[load_robot().arms], dtype=torch.float32)


def generator() -> torch.Generator:
    return torch.Generator().manual_seed(0)


def make(count: int, flip: float = 0.005, interval: int = 90) -> Intervention:
    own = generator()
    return Intervention(torch.ones(count, dtype=torch.bool), flip, NoiseTargets(ROBOT, count, interval, own), own)


def test_indicator_flips_at_the_paper_s_rate() -> None:
    source = make(2000)
    flips = 0
    for _ in range(100):
        before = source.active.clone()
        source.step()
        flips += int((before ^ source.active).sum())
    # Binomial with n = 200,000 and p = 0.005: 1000 +- 32; five standard deviations.
    assert abs(flips - 1000) < 160


def test_only_eligible_robots_are_intervened() -> None:
    eligible = torch.tensor([True, False] * 50)
    own = generator()
    source = Intervention(eligible, 0.5, NoiseTargets(ROBOT, 100, 90, own), own)
    for _ in range(10):
        source.step()
    assert source.active[eligible].any()
    assert not source.active[~eligible].any()


def test_blend_follows_alpha_under_intervention_only() -> None:
    intervention = make(2)
    intervention.active = torch.tensor([True, False])
    policy = torch.ones(2, 8)
    blended = intervention.blend(policy, 0.25)
    torch.testing.assert_close(blended[0], 0.25 * intervention.source.targets()[0] + 0.75)
    torch.testing.assert_close(blended[1], policy[1])


def play(source: NoiseTargets | MotionTargets, steps: int) -> list[torch.Tensor]:
    history = []
    for _ in range(steps):
        source.step()
        history.append(source.targets()[0].clone())
    return history


def test_noise_ramps_for_two_thirds_then_holds() -> None:
    source = NoiseTargets(ROBOT, 1, 90, generator())
    source.reset(FIRST)
    history = play(source, 90)
    end = history[-2]
    torch.testing.assert_close(history[29], 0.5 * (NOMINAL + end))  # half of 60 steps
    for late in history[59:]:
        torch.testing.assert_close(late, end)  # the last is a new draw, which starts from the old target
    assert not torch.equal(play(source, 1)[0], end)


def test_paired_noise_is_mirror_symmetric() -> None:
    source = NoiseTargets(ROBOT, 400, 90, generator(), paired=0.5)
    targets = source._target.double().numpy()
    robot = load_robot()
    image = load_mirror(robot).arms(targets, robot)
    symmetric = np.abs(targets - image).max(axis=1) < 1e-6
    assert 150 < symmetric.sum() < 250
    low, high = arm_noise_range(ROBOT)
    assert (targets >= low - 1e-6).all() and (targets <= high + 1e-6).all()


def test_a_motion_takes_as_long_at_any_control_period() -> None:
    for period in (0.02, 0.025, 0.01):
        source = MotionTargets(ROBOT, 1, ramps(), generator(), period)
        assert ((source._length - 1) * period).tolist() == pytest.approx([39 / 25.0] * 2, abs=period)


def ramps() -> list[ArmMotion]:
    """Two motions at 25 Hz whose joints all rise by 0.01 rad a frame, one from 0, one from 10."""
    rise = 0.01 * np.arange(40)[:, None] * np.ones((1, 8))
    return [ArmMotion("low", 25.0, rise, ROBOT), ArmMotion("high", 25.0, 10.0 + rise, ROBOT)]


def test_motions_are_played_at_the_control_rate_to_their_end() -> None:
    source = MotionTargets(ROBOT, 1, ramps(), generator())
    source.reset(FIRST)
    source._frame[0] = 0
    length = (40 - 1) * round(MOTION_FPS / 25.0) + 1
    history = torch.stack(play(source, length - 1))
    base = 10.0 * float(history[-1, 0] > 5.0)
    after = torch.arange(FADE_STEPS, length) * 0.005 + base  # half the rise per step at twice the rate
    torch.testing.assert_close(history[FADE_STEPS - 1 :, 0], after)
    half = FADE_STEPS // 2
    ratio = (half + 1) / FADE_STEPS
    expected = (1.0 - ratio) * NOMINAL[0] + ratio * (base + (half + 1) * 0.005)
    assert history[half, 0].item() == pytest.approx(expected.item(), abs=1e-5)
    # The next motion starts from where this one ended.
    torch.testing.assert_close(play(source, 1)[0], history[-1], atol=0.01, rtol=0.0)


@pytest.mark.parametrize("kind", ["noise", "motion"])
def test_state_survives_a_round_trip_and_foreign_state_is_ignored(kind: str) -> None:
    def make(seed: int) -> NoiseTargets | MotionTargets:
        own = torch.Generator().manual_seed(seed)
        return NoiseTargets(ROBOT, 5, 90, own) if kind == "noise" else MotionTargets(ROBOT, 5, ramps(), own)

    source, other = make(0), make(1)
    play(source, 50)
    state = {name: value.clone() for name, value in source.state_dict().items()}
    other.load_state_dict(state)
    torch.testing.assert_close(other.targets(), source.targets())
    before = other.targets().clone()
    foreign = (
        MotionTargets(ROBOT, 5, ramps(), generator()) if kind == "noise" else NoiseTargets(ROBOT, 5, 90, generator())
    )
    other.load_state_dict(foreign.state_dict())
    assert torch.equal(other.targets(), before)


def test_a_source_by_name(tmp_path: pathlib.Path) -> None:
    def make(kind: str, motions: pathlib.Path | None = None) -> ArmTargets:
        return make_arm_targets(kind, ROBOT, 2, motions=motions, motions_seed=3, generator=generator())

    noise = make("noise")
    assert isinstance(noise, NoiseTargets) and noise.interval == NOISE_INTERVAL
    generated = make("motion")
    expected = MotionTargets(ROBOT, 2, generate_motions(ROBOT, 3), generator())
    for _ in range(60):
        generated.step()
        expected.step()
    assert torch.equal(generated.targets(), expected.targets())
    with pytest.raises(ConfigError):
        make("motion", tmp_path / "nothing")


def torque(simulation: BatchSimulation, error: float, speed: float) -> np.ndarray:
    simulation.ctrl[:] = simulation.tensor(ROBOT.nominal + error)
    simulation.qpos[:, 7:] = simulation.tensor(ROBOT.nominal)
    simulation.qvel[:, 6:] = speed
    simulation.forward(torch.arange(simulation.count))
    return simulation.torque[:, ROBOT.arms].numpy()


def test_gains_go_from_the_policy_s_to_the_servo_s_and_back() -> None:
    simulation = BatchSimulation(3, robot=ROBOT)
    gains = ArmGains(simulation, ROBOT)
    own = torque(simulation, 0.05, 0.1)
    np.testing.assert_allclose(own, np.tile(0.05 * ROBOT.kp[ROBOT.arms] - 0.1 * ROBOT.kd[ROBOT.arms], (3, 1)))
    gains.update(torch.tensor([0.0, 1.0, 0.5]))
    mixed = torque(simulation, 0.05, 0.1)
    np.testing.assert_allclose(mixed[0], own[0])
    np.testing.assert_allclose(mixed[1], 0.05 * ROBOT.arm_kp - 0.1 * ROBOT.arm_kd)
    np.testing.assert_allclose(mixed[2], 0.5 * (mixed[0] + mixed[1]))
    gains.update(torch.zeros(3))
    np.testing.assert_allclose(torque(simulation, 0.05, 0.1), own)
