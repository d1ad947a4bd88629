import numpy as np
import pytest

from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.velocity_trim import VelocityTrim

PARAMS = ControllerParams()


def _steps(trim, errors):
    for error in errors:
        for _ in range(125):
            trim.measure(np.zeros(2), np.asarray(error, dtype=float), 0.002)
        trim.end_step()


def test_sway_that_alternates_between_steps_is_not_integrated():
    trim = VelocityTrim(PARAMS)
    _steps(trim, [(0.0, 0.1), (0.0, -0.1)] * 5)
    assert trim.value == pytest.approx([0.0, 0.0], abs=1e-12)


def test_a_lasting_error_is_added_up_per_step():
    trim = VelocityTrim(PARAMS)
    _steps(trim, [(0.05, -0.02)] * 5)
    # The first step only fills the average.
    assert trim.value == pytest.approx(4 * PARAMS.velocity_integral * np.array([0.05, -0.02]))


def test_steps_during_and_after_a_change_of_command_do_not_count():
    trim = VelocityTrim(PARAMS)
    for step in range(6):
        for _ in range(125):
            trim.measure(np.zeros(2), np.array([0.01 if step == 0 else 0.12, 0.0]), 0.002)
        trim.end_step()
    # The command changes in step 1; steps 1, 2 and 3 do not count, step 4 fills the average, step 5 is integrated.
    assert trim.value == pytest.approx([PARAMS.velocity_integral * 0.12, 0.0])


def test_a_command_that_never_rests_is_corrected_all_the_same():
    trim, rng = VelocityTrim(PARAMS), np.random.default_rng(0)
    for _ in range(5):
        for _ in range(125):
            wanted = np.array([0.5, 0.0]) + rng.uniform(-0.02, 0.02, 2)
            trim.measure(wanted - [0.04, 0.0], wanted, 0.002)
        trim.end_step()
    assert trim.value == pytest.approx([4 * PARAMS.velocity_integral * 0.04, 0.0])


def test_a_change_that_takes_several_steps_counts_as_one_while_it_is_fast():
    """A ramp of 0.1 m/s a step, and then one of 0.02 m/s a step."""
    for rate, counted in ((0.1, False), (0.02, True)):
        trim, wanted = VelocityTrim(PARAMS), 0.0
        for _ in range(3):
            for _ in range(125):
                wanted += rate / 125
                trim.measure(np.array([wanted - 0.04, 0.0]), np.array([wanted, 0.0]), 0.002)
            trim.end_step()
        assert bool(trim.value[0]) is counted


def test_a_push_counts_little_and_the_sum_is_bounded():
    trim = VelocityTrim(PARAMS)
    _steps(trim, [(2.0, 0.0)] * 2)
    assert trim.value[0] == pytest.approx(PARAMS.velocity_integral * PARAMS.velocity_integral_bound)
    _steps(trim, [(2.0, 0.0)] * 200)
    assert trim.value[0] == PARAMS.max_velocity_trim
    trim.reset()
    assert np.array_equal(trim.value, np.zeros(2))
