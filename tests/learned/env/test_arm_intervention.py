import torch

from hugwbc.learned.env.arm_intervention import Intervention
from hugwbc.learned.env.arm_targets import NoiseTargets


def make(count: int, flip: float = 0.005, interval: int = 90) -> Intervention:
    generator = torch.Generator().manual_seed(0)
    source = NoiseTargets(count, interval, generator)
    return Intervention(torch.ones(count, dtype=torch.bool), flip, source, generator)


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
    generator = torch.Generator().manual_seed(0)
    source = Intervention(eligible, 0.5, NoiseTargets(100, 90, generator), generator)
    for _ in range(10):
        source.step()
    assert source.active[eligible].any()
    assert not source.active[~eligible].any()


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
