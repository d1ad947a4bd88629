import pytest

from hugwbc.errors import HugwbcError
from hugwbc.learned.config import CurriculumConfig, EnvConfig, Schedule, TrainConfig


def test_a_value_is_linear_between_points_and_stays_outside() -> None:
    schedule = Schedule({10: 1.0, 20: 3.0, 40: 2.0})
    assert [schedule.at(steps) for steps in (0.0, 10.0, 15.0, 20.0, 30.0, 99.0)] == [1.0, 1.0, 2.0, 3.0, 2.5, 2.0]
    assert Schedule({0: 0.8, 10: 0.2}, "geometric").at(5.0) == pytest.approx(0.4)
    steps = Schedule({0: "network", 10: "none"}, "steps")
    assert [steps.at(place) for place in (0, 9, 10, 11)] == ["network"] * 2 + ["none"] * 2
    assert schedule.stretched(2.0).at(30.0) == schedule.at(15.0)


def test_a_training_has_the_values_of_its_steps() -> None:
    config = TrainConfig(
        schedules={
            "env.rewards.feet_slip": Schedule({0: 0.0, 1e6: -0.4}),
            "env.loads.payload": Schedule({0: 0.0, 1e6: 4.0}),
            "ppo.horizon": Schedule({0: 10, 1e6: 20}),
        }
    )
    now = config.at(0.5e6)
    assert (now.env.rewards.feet_slip, now.env.loads.payload, now.ppo.horizon) == (-0.2, 2.0, 15)
    assert now.env.rewards.termination == config.env.rewards.termination and now.ppo.lam == config.ppo.lam


def test_settings_that_depend_on_each_other_change_together() -> None:
    """The fractions of the gaits sum to at most 1; one after the other, they would pass through 1.3."""
    shares = {"walking_fraction": (0.7, 0.1), "standing_fraction": (0.1, 0.4), "hopping_fraction": (0.2, 0.5)}
    for names in (tuple(shares), tuple(reversed(shares))):
        schedules = {f"env.command.{n}": Schedule({0: shares[n][0], 1e6: shares[n][1]}) for n in names}
        now = TrainConfig(schedules=schedules).at(1e6).env.command
        assert [getattr(now, name) for name in shares] == pytest.approx([0.1, 0.4, 0.5])


@pytest.mark.parametrize(
    ("name", "points", "shape", "said"),
    [
        ("ppo.entropy_weight", {1.0: 1.0, 0.0: 1.0}, "linear", "ascending"),
        ("ppo.entropy_weight", {}, "linear", "one or more"),
        ("ppo.std_limit", {0.0: 0.0, 1.0: 1.0}, "geometric", "above 0"),
        ("env.intervention", {0.0: "none"}, "linear", "needs numbers"),
        ("env.intervention", {0.0: "nothing"}, "steps", "nothing"),
        ("env.rewards.feet_slop", {0.0: 1.0}, "linear", "feet_slip"),
        ("ppo.entropy_weight", {0.0: 0.1, 5.0: -1.0}, "linear", "entropy_weight"),
        ("ppo.critic_learning_rate", {0.0: 1e-3, 5.0: 1e-4}, "linear", "cannot change during a training"),
        ("env.curriculum.agile_fraction", {0.0: 0.5, 5.0: 0.2}, "linear", "cannot change during a training"),
        *(
            (f"env.{name}", {0.0: 1.0, 5.0: 0.5}, "steps", "cannot change during a training")
            for name in ("action_scale", "yaw_action_factor", "yaw_damping_factor", "waist_rate")
        ),
        ("env.randomization.push_velocity", {0.0: 0.1, 5.0: 0.5}, "linear", "rebuild all robots .* the shape steps"),
        ("env.terrain.roughness", {0.0: 0.01, 5.0: 0.05}, "geometric", "rebuild all robots .* the shape steps"),
        ("average_steps", {0.0: 0.0, 5.0: 1.0}, "linear", "give settings of env and ppo"),
    ],
)
def test_what_cannot_be_is_refused_before_the_training(name: str, points: dict, shape: str, said: str) -> None:
    with pytest.raises(HugwbcError, match=said):
        TrainConfig(schedules={name: Schedule(points, shape)})  # type: ignore[arg-type]


def test_values_between_two_points_are_refused_before_the_training() -> None:
    fractions = {
        "env.command.standing_fraction": Schedule({0: 0.2, 1e6: 0.9}),
        "env.command.walking_fraction": Schedule({0: 0.7, 1e6: 0.1}, "steps"),
    }
    with pytest.raises(HugwbcError, match=r"give at 1e\+06 steps: the fractions .* sum to 1.6"):
        TrainConfig(schedules=fractions)


def test_what_the_robots_are_rebuilt_for_may_change_in_steps_or_not_at_all() -> None:
    name = "env.randomization.push_velocity"
    in_steps = TrainConfig(schedules={name: Schedule({0: 0.1, 5: 0.5}, "steps")})
    assert in_steps.at(5).env.randomization.push_velocity == 0.5
    assert TrainConfig(schedules={name: Schedule({0: 0.1})}).at(5).env.randomization.push_velocity == 0.1


def test_a_setting_has_a_schedule_or_a_rule() -> None:
    ruled = EnvConfig(curriculum=CurriculumConfig(rules={"loads.payload": lambda value, curriculum: value}))
    rising = Schedule({0: 0.0, 5: 1.0})
    assert TrainConfig(env=ruled, schedules={"env.loads.hand_force": rising}).at(5).env.loads.hand_force == 1.0
    with pytest.raises(HugwbcError, match=r"'env.loads.payload' has a schedule, and a rule .* one of the two"):
        TrainConfig(env=ruled, schedules={"env.loads.payload": rising})
