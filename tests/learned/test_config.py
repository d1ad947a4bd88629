import math
import pathlib
from collections.abc import Callable

import pytest

from hugwbc.errors import HugwbcError
from hugwbc.learned import config

NAN, INF = math.nan, math.inf
BAD: dict[Callable, list[tuple[str, object]]] = {
    config.RewardWeights: [("feet_slip", NAN), ("termination", -INF), ("linear_velocity_tracking", 0.0)],
    config.ExtraWeights: [("alive", NAN)],
    config.CurriculumConfig: [
        *(("alpha_interval", 0), ("speed_interval", 0), ("warm_up_iterations", -1), ("penalty_growth", NAN)),
        *(("linear_threshold", INF), ("agile_fraction", 1.1)),
    ],
    config.TerrainConfig: [("threshold", NAN), ("start_level", 10)],
    config.RandomizationConfig: [
        *(("friction", (1.0, 0.5)), ("gains", (NAN, 1.0)), ("strength", (1.2, 0.8)), ("link_mass", (0.0, 1.0))),
        *(("latency", (-0.01, 0.0)), ("torso_mass", (-20.0, 0.0))),
    ],
    config.PPOConfig: [
        *(("gamma", 1.5), ("horizon", 0), ("std_min", NAN), ("std_steps", 0.0), ("entropy_weight", -0.1)),
        ("learning_rate_range", (1e-3, 1e-5)),
    ],
    config.EnvConfig: [("count", 0), ("motions", pathlib.Path("recordings"))],
    config.TrainConfig: [("threads", 0), ("seed", -1), ("seed", 10**40), ("hours", NAN), ("evaluation_seconds", INF)],
}


@pytest.mark.parametrize("settings", BAD, ids=lambda settings: settings.__name__)
def test_what_would_fail_later_is_refused_at_once_and_by_name(settings: Callable) -> None:
    for name, value in BAD[settings]:
        with pytest.raises(HugwbcError, match=rf"{name}\b.* (is|=) "):
            settings(**{name: value})


def test_gaits_to_calibrate_are_checked_before_a_training() -> None:
    with pytest.raises(HugwbcError, match="unknown gait 'walk'"):
        config.CalibrationConfig(policy=pathlib.Path("one"), gaits=("standing", "walk"))
