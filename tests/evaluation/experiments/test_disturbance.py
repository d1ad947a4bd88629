import numpy as np
import pytest

from hugwbc.evaluation.experiments.disturbance import DisturbanceSettings, SurvivalSearch


def search_of(**settings) -> SurvivalSearch:
    return SurvivalSearch(DisturbanceSettings(**settings))


def run(search: SurvivalSearch, survives) -> list[tuple[float, int]]:
    """Loads tried and the number of trials of each; `survives(load, number)`."""
    tried: list[tuple[float, int]] = []
    while not search.done:
        load, numbers = search.load, list(search.numbers)
        if tried and tried[-1][0] == load:
            tried[-1] = (load, tried[-1][1] + len(numbers))
        else:
            tried.append((load, len(numbers)))
        search.record([survives(load, number) for number in numbers])
    return tried


@pytest.mark.parametrize("threshold", [3.0, 49.0, 51.0, 333.0, 799.0])
def test_a_sharp_threshold_is_bracketed(threshold):
    search = search_of(rollouts=4, first=50.0, limit=800.0, resolution=0.02)
    tried = run(search, lambda load, _: load <= threshold)
    assert search.refused is not None and search.tolerated <= threshold < search.refused
    assert search.refused - search.tolerated <= 0.02 * max(threshold, 50.0)
    assert len(tried) <= 1 + 4 + 6, "doubled up to the limit, and bisected from there"


def test_a_limit_that_is_survived_ends_the_search():
    search = search_of(rollouts=1, first=50.0, limit=130.0)
    assert run(search, lambda *_: True) == [(50.0, 1), (100.0, 1), (130.0, 1)]
    assert search.tolerated == 130.0 and search.refused is None


def test_the_answer_is_that_of_all_trials():
    """Each trial has its own threshold: the answer is the load that 98 % of them survive."""
    thresholds = np.random.default_rng(0).normal(200.0, 20.0, 4096)
    search = search_of(rollouts=4096, first=50.0, limit=800.0, resolution=0.001)
    tried = run(search, lambda load, number: load <= thresholds[number])
    assert search.refused is not None
    assert np.mean(thresholds >= search.tolerated) >= 0.98 > np.mean(thresholds >= search.refused)
    assert search.tolerated == pytest.approx(np.sort(thresholds)[81], rel=0.002)
    early = [count for _, count in tried if count < 4096]
    assert min(early) <= 16 and len(early) >= 5, "clear cases are decided early"


def test_one_fall_of_few_is_too_many():
    search = search_of(rollouts=49, first=50.0, limit=800.0)
    search.record([True] * 7 + [False])
    assert search.refused == 50.0, "of 49 trials, 98 % are 49"
    search = search_of(rollouts=50, first=50.0, limit=800.0)
    search.record([True] * 7 + [False])
    assert search.refused is None and list(search.numbers) == list(range(8, 16))
