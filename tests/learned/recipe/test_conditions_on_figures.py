import pytest

from hugwbc.errors import ConfigError
from hugwbc.learned.recipe.conditions_on_figures import Condition, all_hold


@pytest.mark.parametrize(
    ("text", "value", "holds"),
    [
        ("< 0.02", 0.01, True),
        ("< 0.02", 0.02, False),
        ("<= 0.02", 0.02, True),
        ("> 0.5", 0.6, True),
        (">0.5", 0.5, False),
        (">= 5e-1", 0.5, True),
        ("below 0.02", 0.01, True),
        ("above 0.5", 0.5, False),
        ("above 0.5", 0.6, True),
        ("< 1", float("nan"), False),
        (">= -1", float("nan"), False),
    ],
)
def test_comparisons(text: str, value: float, holds: bool) -> None:
    assert Condition.parse("x", text).holds({"x": value}) is holds


def test_a_missing_figure_never_holds() -> None:
    assert not Condition.parse("x", "< 1e9").holds({"y": 0.0})


def test_a_condition_relative_to_the_best_value() -> None:
    worse, better = Condition.parse("score", "> 1.5 best"), Condition.parse("reward", "< 0.5 best")
    earlier = [{"score": 2.0, "reward": 1.0}, {"score": 3.0, "reward": 4.0}, {}]
    assert [worse.holds({"score": s}, earlier) for s in (2.9, 3.1)] == [False, True]
    assert [better.holds({"reward": r}, earlier) for r in (2.1, 1.9)] == [False, True]
    assert not worse.holds({"score": 1e9}, [])


def test_its_words_are_those_of_the_recipe() -> None:
    assert str(Condition.parse("score", "> 1.5 best")) == "score > 1.5 best"


def test_all_must_hold() -> None:
    conditions = [Condition.parse("a", "< 1"), Condition.parse("b", "> 1")]
    assert all_hold(conditions, {"a": 0.0, "b": 2.0}) and not all_hold(conditions, {"a": 0.0, "b": 0.0})


@pytest.mark.parametrize("text", ["0.02", "< ", "= 3", "< 1 worst", "< 1e", "< nan", "__import__('os')"])
def test_another_form_is_refused_with_the_valid_ones(text: str) -> None:
    with pytest.raises(ConfigError, match=r"not a condition on falls; write below 0\.02"):
        Condition.parse("falls", text)
