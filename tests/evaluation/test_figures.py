import dataclasses

import pytest

from hugwbc.evaluation.figures import Comparison, Difference, falls_figure, judged_fairly
from hugwbc.evaluation.intervals import Estimate
from tests.conftest import figure


@pytest.mark.parametrize(
    ("low", "value", "high", "verdict"),
    [
        (0.8, 0.9, 0.95, Comparison.BETTER),
        (0.8, 0.9, 1.1, Comparison.UNCLEAR_BETTER),
        (0.9, 1.2, 1.5, Comparison.UNCLEAR_WORSE),
        (1.1, 1.2, 1.5, Comparison.WORSE),
        (None, 1.2, None, Comparison.UNCLEAR_WORSE),
    ],
)
def test_verdict_against_the_paper(low, value, high, verdict):
    measured = figure(value, low, high, paper=1.0)
    assert measured.against_paper is verdict
    few = dataclasses.replace(measured, estimate=Estimate(value, low, high, 7)).against_paper
    assert few is (Comparison.UNCLEAR_BETTER if value < 1.0 else Comparison.UNCLEAR_WORSE)
    mirrored = {
        Comparison.BETTER: Comparison.WORSE, Comparison.WORSE: Comparison.BETTER,
        Comparison.UNCLEAR_BETTER: Comparison.UNCLEAR_WORSE, Comparison.UNCLEAR_WORSE: Comparison.UNCLEAR_BETTER,
    }  # fmt: skip
    assert figure(value, low, high, paper=1.0, higher=True).against_paper is mirrored[verdict]


def test_ratio_scales_the_interval():
    assert figure(0.6, 0.3, 0.9, paper=0.3).ratio == pytest.approx((2.0, 1.0, 3.0))
    assert figure(0.6, 0.3, 0.9).ratio is None
    assert figure(None, None, None, paper=0.3).ratio is None
    assert figure(0.6, 0.3, 0.9, paper=0.3).against_paper is Comparison.UNCLEAR_WORSE, (
        "the interval touches the paper's figure"
    )


def test_a_table_of_runs_that_fell_is_not_judged():
    error = figure(0.2, 0.1, 0.25, paper=0.3)
    for times, verdict in ((1, Comparison.BETTER), (2, Comparison.NONE)):
        falls = falls_figure("T", [True] * times + [False] * (20 - times))
        other = dataclasses.replace(error, table="another")
        for named in (falls, dataclasses.replace(falls, quantity="falls, p")):
            judged, _, apart = judged_fairly([error, named, other], "h1")
            assert (judged.against_paper, apart.against_paper) == (verdict, Comparison.BETTER)
            assert judged.ratio is not None and judged.paper == 0.3


def test_other_robots_are_not_compared_with_the_papers():
    figures = [figure(0.2, 0.1, 0.25, paper=0.3), figure(None, None, None, paper=0.3, published=0.27)]
    assert judged_fairly(figures, "h1-2023") == figures
    (alone,) = judged_fairly(figures, "g1")
    assert alone.value == 0.2 and alone.paper is alone.ratio is None and alone.against_paper is Comparison.NONE


@pytest.mark.parametrize(
    ("low", "high", "pairs", "p", "clear"),
    [
        (0.1, 0.3, 8, None, True),
        (-0.3, -0.1, 8, None, True),
        (0.0, 0.3, 8, None, False),
        (0.1, 0.3, 7, None, False),  # an interval of so few is too narrow
        (None, None, 6, 0.031, True),
        (None, None, 6, 0.0625, False),
        (None, None, 1, None, False),
    ],
)
def test_a_difference_is_clear_if_it_is_unlikely_to_be_chance(low, high, pairs, p, clear):
    difference = Difference("b", Estimate(0.2, low, high, pairs), p)
    assert difference.is_clear is clear
    unjudged = dataclasses.replace(difference, judged=False).is_clear
    assert unjudged is (clear and p is not None), "a mean lacks what fell early; that it fell is counted"
