import pytest

from hugwbc.evaluation.figures import Comparison, against
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
    assert figure(value, low, high, paper=1.0).against_paper is verdict
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


def test_two_controllers_are_told_apart_where_their_intervals_do_not_overlap():
    low, high = figure(1.0, 0.9, 1.1), figure(2.0, 1.5, 2.5, controller="b")
    assert against(low, high) is Comparison.BETTER and against(high, low) is Comparison.WORSE
    overlapping = figure(1.2, 1.0, 1.4, controller="b")
    assert (
        against(low, overlapping) is Comparison.UNCLEAR_BETTER and against(overlapping, low) is Comparison.UNCLEAR_WORSE
    )
    assert against(low, figure(1.0, None, None, published=2.0)) is Comparison.NONE
    force = [figure(f.value, f.estimate.low, f.estimate.high, higher=True) for f in (low, high)]
    assert against(*force) is Comparison.WORSE
