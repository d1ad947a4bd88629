import pytest

from hugwbc.errors import ConfigError
from hugwbc.learned.config import PPOConfig, Schedule, TrainConfig


def test_a_value_is_linear_between_points_and_stays_outside() -> None:
    schedule = Schedule("ppo.entropy_weight", (10.0, 20.0, 40.0), (1.0, 3.0, 2.0))
    assert [schedule.at(steps) for steps in (0.0, 10.0, 15.0, 20.0, 30.0, 99.0)] == [1.0, 1.0, 2.0, 3.0, 2.5, 2.0]
    halved = Schedule("ppo.std_limit", (0.0, 10.0), (0.8, 0.2), "log")
    assert halved.at(5.0) == pytest.approx(0.4)


def test_a_training_adopts_the_values_of_its_steps() -> None:
    config = TrainConfig(
        schedules=(
            Schedule("env.rewards.feet_slip", (0.0, 1e6), (0.0, -0.4)),
            Schedule("env.loads.payload", (0.0, 1e6), (0.0, 4.0)),
            Schedule("ppo.horizon", (0.0, 1e6), (10.0, 20.0)),
        )
    )
    now = config.at(0.5e6)
    assert (now.env.rewards.feet_slip, now.env.loads.payload, now.ppo.horizon) == (-0.2, 2.0, 15)
    assert now.env.rewards.termination == config.env.rewards.termination and now.ppo.lam == config.ppo.lam


def test_settings_that_depend_on_each_other_change_together() -> None:
    """The fractions of the gaits sum to at most 1; one after the other, they would pass through 1.3."""
    shares = {"walking_fraction": (0.7, 0.1), "standing_fraction": (0.1, 0.4), "hopping_fraction": (0.2, 0.5)}
    for names in (tuple(shares), tuple(reversed(shares))):
        schedules = tuple(Schedule(f"env.command.{name}", (0.0, 1e6), shares[name]) for name in names)
        now = TrainConfig(schedules=schedules).at(1e6).env.command
        assert [getattr(now, name) for name in shares] == pytest.approx([0.1, 0.4, 0.5])


@pytest.mark.parametrize(
    ("schedule", "said"),
    [
        (("env.count", (0.0,), (4.0,)), "env.count"),
        (("ppo.entropy_weight", (1.0, 0.0), (1.0, 1.0)), "ascending"),
        (("ppo.entropy_weight", (0.0, 1.0), (1.0,)), "one for each value"),
        (("ppo.std_limit", (0.0, 1.0), (0.0, 1.0), "log"), "above 0"),
        (("env.rewards.feet_slop", (0.0,), (1.0,)), "feet_slop"),
        (("ppo.symmetry", (0.0,), (1.0,)), "no such number"),
        (("ppo.entropy_weight", (0.0, 5.0), (0.1, -1.0)), "entropy_weight"),
    ],
)
def test_what_cannot_be_is_refused_before_the_training(schedule: tuple, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        TrainConfig(schedules=(Schedule(*schedule),))


def test_without_schedules_nothing_changes() -> None:
    config = TrainConfig(ppo=PPOConfig(horizon=7))
    assert config.at(1e9) == config
