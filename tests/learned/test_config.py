import math
import pathlib
from collections.abc import Callable

import pytest

from hugwbc.errors import HugwbcError
from hugwbc.learned.config import (
    CurriculumConfig,
    EnvConfig,
    ExtraWeights,
    PPOConfig,
    RandomizationConfig,
    RecordConfig,
    RewardWeights,
    TerrainConfig,
    TrainConfig,
)

BAD: list[tuple[Callable, str, object]] = [
    (RewardWeights, "feet_slip", math.nan),
    (RewardWeights, "termination", -math.inf),
    (RewardWeights, "linear_velocity_tracking", 0.0),
    (ExtraWeights, "alive", math.nan),
    (CurriculumConfig, "alpha_interval", 0),
    (CurriculumConfig, "speed_interval", 0),
    (CurriculumConfig, "warm_up_iterations", -1),
    (CurriculumConfig, "penalty_growth", math.nan),
    (CurriculumConfig, "linear_threshold", math.inf),
    (CurriculumConfig, "agile_fraction", 1.1),
    (TerrainConfig, "threshold", math.nan),
    (TerrainConfig, "start_level", 10),
    (RandomizationConfig, "friction", (1.0, 0.5)),
    (RandomizationConfig, "gains", (math.nan, 1.0)),
    (RandomizationConfig, "strength", (1.2, 0.8)),
    (RandomizationConfig, "link_mass", (0.0, 1.0)),
    (RandomizationConfig, "latency", (-0.01, 0.0)),
    (RandomizationConfig, "torso_mass", (-20.0, 0.0)),
    (PPOConfig, "gamma", 1.5),
    (PPOConfig, "horizon", 0),
    (PPOConfig, "std_min", math.nan),
    (PPOConfig, "std_steps", 0.0),
    (PPOConfig, "entropy_weight", -0.1),
    (PPOConfig, "learning_rate_range", (1e-3, 1e-5)),
    (EnvConfig, "count", 0),
    (EnvConfig, "motions", pathlib.Path("recordings")),
    (TrainConfig, "threads", 0),
    (TrainConfig, "seed", -1),
    (TrainConfig, "seed", 10**40),
    (TrainConfig, "hours", math.nan),
    (TrainConfig, "evaluation_seconds", math.inf),
    (RecordConfig, "max_speed", math.nan),
    (RecordConfig, "max_speed", 2.5),
]


@pytest.mark.parametrize(("config", "name", "value"), BAD, ids=lambda value: getattr(value, "__name__", str(value)))
def test_what_would_fail_later_is_refused_at_once_and_by_name(config: Callable, name: str, value: object) -> None:
    with pytest.raises(HugwbcError, match=rf"{name}\b.* (is|=) "):
        config(**{name: value})


def test_a_term_but_for_those_of_the_curricula_can_be_switched_off() -> None:
    assert RewardWeights(feet_slip=0.0).feet_slip == 0.0
    assert ExtraWeights(alive=0.0).alive == 0.0
