import pytest

from hugwbc.errors import ConfigError
from hugwbc.learned.recipe.conditions_on_figures import Condition
from hugwbc.learned.recipe.stage_gates import Gate, open_gate

FALLS = (Condition("falls", "<", 0.1),)


def measured(*falls: float) -> list[dict[str, float]]:
    return [{"falls": value, "progress": (i + 1) / 10} for i, value in enumerate(falls)]


def test_a_gate_opens_when_its_conditions_hold_often_enough_in_a_row() -> None:
    gate = Gate("next", FALLS, times=2)
    assert not gate.open(measured(0.0))
    assert not gate.open(measured(0.0, 0.5, 0.0))
    assert gate.open(measured(0.5, 0.0, 0.0))


def test_a_gate_counts_from_its_progress_on() -> None:
    gate = Gate("next", FALLS, after=0.2, times=2)
    assert not gate.open(measured(0.0, 0.0))
    assert gate.open(measured(0.0, 0.0, 0.0))


def test_relative_conditions_look_at_what_came_before_each_measurement() -> None:
    gate = Gate("back", (Condition("falls", ">", 2.0, of_best=True),), times=2)
    assert gate.open(measured(0.1, 0.3, 0.3))
    assert not gate.open(measured(0.1, 0.15, 0.3))
    assert not gate.open(measured(0.3, 0.1, 0.15))


def test_the_first_open_gate_acts() -> None:
    stop, onwards = Gate("stop", (Condition("falls", ">", 0.5),)), Gate("next", FALLS)
    assert open_gate([stop, onwards], measured(0.0)) is onwards
    assert open_gate([stop, onwards], measured(0.9)) is stop
    assert open_gate([stop, onwards], measured(0.3)) is None


def test_its_reason_is_in_words() -> None:
    assert Gate("next", FALLS, times=2).reason() == "falls < 0.1 in 2 measurements"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"after": 1.5}, "progress of the stage from 0 to 1"),
        ({"times": 0}, "give 1 or more"),
        ({"do": "next", "change": {"steps": 1.0}}, "belongs to 'back'"),
    ],
)
def test_a_gate_that_makes_no_sense_is_refused(changes: dict, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        Gate(**({"do": "back", "when": FALLS} | changes))
