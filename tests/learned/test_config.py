import math
import pathlib
from collections.abc import Callable

import pytest

from hugwbc.errors import HugwbcError
from hugwbc.learned import config

BAD: list[tuple[Callable, str, object]] = [
    (config.RewardWeights, "feet_slip", math.nan),
    (config.RewardWeights, "termination", -math.inf),
    (config.RewardWeights, "linear_velocity_tracking", 0.0),
    (config.ExtraWeights, "alive", math.nan),
    (config.CurriculumConfig, "alpha_interval", 0),
    (config.CurriculumConfig, "speed_interval", 0),
    (config.CurriculumConfig, "warm_up_iterations", -1),
    (config.CurriculumConfig, "penalty_growth", math.nan),
    (config.CurriculumConfig, "linear_threshold", math.inf),
    (config.CurriculumConfig, "agile_fraction", 1.1),
    (config.TerrainConfig, "threshold", math.nan),
    (config.TerrainConfig, "start_level", 10),
    (config.RandomizationConfig, "friction", (1.0, 0.5)),
    (config.RandomizationConfig, "gains", (math.nan, 1.0)),
    (config.RandomizationConfig, "strength", (1.2, 0.8)),
    (config.RandomizationConfig, "link_mass", (0.0, 1.0)),
    (config.RandomizationConfig, "latency", (-0.01, 0.0)),
    (config.RandomizationConfig, "torso_mass", (-20.0, 0.0)),
    (config.PPOConfig, "gamma", 1.5),
    (config.PPOConfig, "horizon", 0),
    (config.PPOConfig, "std_min", math.nan),
    (config.PPOConfig, "std_steps", 0.0),
    (config.PPOConfig, "entropy_weight", -0.1),
    (config.PPOConfig, "learning_rate_range", (1e-3, 1e-5)),
    (config.EnvConfig, "count", 0),
    (config.EnvConfig, "motions", pathlib.Path("recordings")),
    (config.TrainConfig, "threads", 0),
    (config.TrainConfig, "seed", -1),
    (config.TrainConfig, "seed", 10**40),
    (config.TrainConfig, "hours", math.nan),
    (config.TrainConfig, "evaluation_seconds", math.inf),
    (config.RecordConfig, "max_speed", math.nan),
    (config.RecordConfig, "max_speed", 2.5),
]


@pytest.mark.parametrize(("settings", "name", "value"), BAD, ids=lambda value: getattr(value, "__name__", str(value)))
def test_what_would_fail_later_is_refused_at_once_and_by_name(settings: Callable, name: str, value: object) -> None:
    with pytest.raises(HugwbcError, match=rf"{name}\b.* (is|=) "):
        settings(**{name: value})


def test_a_term_but_for_those_of_the_curricula_can_be_switched_off() -> None:
    assert config.RewardWeights(feet_slip=0.0).feet_slip == 0.0
    assert config.ExtraWeights(alive=0.0).alive == 0.0
