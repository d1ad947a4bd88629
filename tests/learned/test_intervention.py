import pytest
import torch

from hugwbc.learned.intervention import Intervention, noise_ranges
from hugwbc.robot import load_robot


def make(count: int, flip: float = 0.005, interval: int = 90) -> Intervention:
    return Intervention(torch.ones(count, dtype=torch.bool), flip, interval, torch.Generator().manual_seed(0))


def test_ranges_are_mirror_images_and_within_limits() -> None:
    low, high = noise_ranges()
    robot = load_robot()
    assert low.tolist() == pytest.approx([-2.6, -0.3, -1.2, -1.2, -2.6, -3.0, -4.3, -1.2])
    assert high.tolist() == pytest.approx([2.6, 3.0, 4.3, 2.5, 2.6, 0.3, 1.2, 2.5])
    assert (low.numpy() >= robot.lower[robot.arms]).all() and (high.numpy() <= robot.upper[robot.arms]).all()


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
    source = Intervention(eligible, 0.5, 90, torch.Generator().manual_seed(0))
    for _ in range(10):
        source.step()
    assert source.active[eligible].any()
    assert not source.active[~eligible].any()


def test_targets_ramp_for_two_thirds_then_hold() -> None:
    source = make(1)
    source.reset(torch.tensor([0]))
    robot = load_robot()
    start, end = torch.tensor(robot.nominal[robot.arms], dtype=torch.float32), source._target[0].clone()
    history = []
    for _ in range(89):
        source.step()
        history.append(source.targets()[0])
    torch.testing.assert_close(history[29], 0.5 * (start + end))  # half of 60 steps
    for late in history[59:]:
        torch.testing.assert_close(late, end)
    source.step()  # a new draw starts from the old target
    torch.testing.assert_close(source.targets()[0], end)


def test_blend_follows_alpha_under_intervention_only() -> None:
    source = make(2)
    source.active = torch.tensor([True, False])
    source.alpha = 0.25
    policy = torch.ones(2, 8)
    blended = source.blend(policy)
    torch.testing.assert_close(blended[0], 0.25 * source.targets()[0] + 0.75)
    torch.testing.assert_close(blended[1], policy[1])


def test_state_survives_a_round_trip() -> None:
    source, other = make(5), make(5)
    for _ in range(50):
        source.step()
    other.load_state_dict(source.state_dict())
    torch.testing.assert_close(other.targets(), source.targets())
    assert torch.equal(other.active, source.active)
