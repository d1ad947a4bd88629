from collections.abc import Callable
from typing import Any

import pytest

from hugwbc.learned.recipe.forecast import USUAL_RATES, forecast, measure_rates
from hugwbc.learned.recipe.recipe_records import Recipe


def test_the_figures_of_a_plan(make_recipe: Callable[..., Recipe], services: Any, tiny: str) -> None:
    gates = "gates: [{do: back, when: {evaluation/score: above 2 best}, at_most: 2}]\n    schedules"
    recipe = make_recipe(tiny, ("about: A", "rates: {train: 50}\nabout: A"), ("schedules", gates))
    costs = {cost.stage: cost for cost in forecast(recipe, services)}
    gaits = costs["gaits"]
    # Three measurements of 4 robots for 0.1 s of 50 steps; each counts half.
    assert (gaits.steps, gaits.most_steps, gaits.measured_steps) == (192, 3 * 192, 60)
    assert gaits.cpu_seconds == pytest.approx((192 + 30) / 50) and gaits.source == "recipe"
    assert costs["labels"].labels == 640 and costs["labels"].source == "usual"
    assert costs["labels"].cpu_seconds == pytest.approx(640 / USUAL_RATES["imitate"])
    # Two commands of walking at three knots, three times, for 6 s each.
    assert costs["calibrated"].simulated == 2 * 3 * 3 * 6.0
    assert costs["figures"].simulated == 120.0
    assert costs["policy"].cpu_seconds > 0.0


def test_a_measured_speed_comes_first(make_recipe: Callable[..., Recipe], services: Any) -> None:
    rates = measure_rates(make_recipe(), services, iterations=1)
    assert set(rates) == {"train", "imitate"} and min(rates.values()) > 0.0
    costs = {cost.stage: cost for cost in forecast(make_recipe(), services, rates)}
    assert costs["gaits"].source == "measured"
    assert costs["labels"].cpu_seconds == pytest.approx(640 / rates["imitate"])
