import math

import pytest
from hypothesis import given, strategies as st

from hugwbc.errors import ConfigError
from hugwbc.learned.recipe.conditions_on_figures import Condition
from hugwbc.learned.recipe.stage_schedules import StageSchedule

GOOD = (Condition("evaluation/falls", "<", 0.02),)


@pytest.mark.parametrize(("shape", "halfway"), [("linear", 0.3), ("cosine", 0.3), ("geometric", math.sqrt(0.5 * 0.1))])
def test_a_ramp_goes_from_its_first_to_its_second_value(shape: str, halfway: float) -> None:
    schedule = StageSchedule(shape, (0.5, 0.1), (0.2, 0.8))
    assert [schedule.value(progress) for progress in (0.0, 0.2, 0.8, 1.0)] == [0.5, 0.5, 0.1, 0.1]
    assert schedule.value(0.5) == pytest.approx(halfway)


def test_a_cosine_is_flat_at_its_ends_and_a_line_is_not() -> None:
    slopes = [StageSchedule(shape, (0.0, 1.0)).value(0.01) / 0.01 for shape in ("linear", "cosine")]
    assert slopes == pytest.approx([1.0, 0.0247], abs=1e-3)


def test_steps_change_at_their_places() -> None:
    schedule = StageSchedule("steps", ("none", "noise", "motion"), (0.0, 0.25, 0.5))
    assert [schedule.value(p) for p in (0.0, 0.249, 0.25, 0.5, 1.0)] == ["none", "none", "noise", "motion", "motion"]


def test_tuples_move_entry_by_entry() -> None:
    assert StageSchedule("linear", ((3.6, 4.2), (2.0, 2.0))).value(0.5) == pytest.approx((2.8, 3.1))


def test_a_gated_value_moves_when_its_conditions_hold() -> None:
    schedule = StageSchedule("gated", (0.0, 0.5, 1.0), when=GOOD, back_when=(Condition("evaluation/falls", ">", 0.2),))
    level, values = 0, []
    for falls in (0.5, 0.01, 0.1, 0.0, 0.0, 0.3):
        level = schedule.next_level(level, {"evaluation/falls": falls}, [])
        values.append(schedule.value(0.9, level))
    assert values == [0.0, 0.5, 0.5, 1.0, 1.0, 0.5]


def test_other_shapes_have_no_levels() -> None:
    assert StageSchedule("linear", (0.0, 1.0)).next_level(0, {"evaluation/falls": 0.0}, []) == 0


@given(st.floats(0.0, 1.0), st.floats(1e-6, 1e3), st.floats(1e-6, 1e3))
def test_a_ramp_stays_between_its_values(progress: float, first: float, last: float) -> None:
    for shape in ("linear", "cosine", "geometric"):
        value = StageSchedule(shape, (first, last)).value(progress)
        assert min(first, last) * (1 - 1e-9) <= value <= max(first, last) * (1 + 1e-9)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("linear", (1.0,)), "1 values; give two"),
        (("linear", (1.0, 2.0), (0.5, 0.5)), "not a rising sequence"),
        (("linear", (1.0, 2.0), (0.5, 1.5)), "from 0 to 1"),
        (("linear", (True, False)), "use steps for other values"),
        (("geometric", (0.0, 1.0)), "above 0; use linear"),
        (("steps", (1.0, 2.0), (0.1, 0.5)), "the first one must be at 0"),
        (("steps", (), ()), "no values"),
        (("gated", (1.0, 2.0)), "lacks 'when'"),
    ],
)
def test_a_schedule_that_makes_no_sense_is_refused(arguments: tuple, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        StageSchedule(*arguments)
