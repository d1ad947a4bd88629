"""Slipping soles: the friction that the QP assumes, and the speed that suits it."""

import math

import numpy as np
import pytest

from hugwbc import Command, Gait, load_robot
from hugwbc.mbc import WholeBodyController
from hugwbc.mbc.slip import SlipWatch
from hugwbc.runtime import Constant, Simulation, rollout
from hugwbc.sim import Variation

DT = 0.004
LOAD = np.array([[30.0, 40.0, 300.0], [0.0, 0.0, 0.0]])


def after(watch: SlipWatch, speed: float, seconds: float, load: np.ndarray = LOAD, dt: float = DT) -> SlipWatch:
    """Let the left sole move at a speed for some time."""
    for _ in range(round(seconds / dt)):
        watch.update(np.array([[0.0, speed], [0.0, 0.0]]), load, dt)
    return watch


def test_soles_that_hardly_move_leave_all_friction() -> None:
    watch = after(SlipWatch(0.7, 582.0), 0.2, 2.0)
    assert (watch.friction, watch.fastest) == (0.7, math.inf)


def test_a_brief_slide_at_a_touch_down_is_no_slip() -> None:
    watch = after(SlipWatch(0.7, 582.0), 0.8, 0.012)
    assert after(watch, 0.0, 0.1).friction == 0.7


def test_one_reading_of_a_slow_controller_is_no_slip_and_several_are() -> None:
    watch = after(SlipWatch(0.7, 582.0), 0.8, 0.02, dt=0.02)  # of a sole that touches down
    assert after(watch, 0.0, 0.4, dt=0.02).friction == 0.7
    assert after(watch, 0.8, 0.1, dt=0.02).friction < 0.3


def test_good_ground_that_was_taken_for_slippery_is_soon_good_again() -> None:
    watch = after(SlipWatch(0.7, 582.0), 0.47, 0.2)
    assert after(watch, 0.0, 10.0).friction == 0.7
    # What slips a second time is slippery: the friction rises slowly from below that.
    after(after(after(watch, 0.47, 0.2), 0.0, 7.0), 0.47, 0.2)
    assert after(watch, 0.0, 20.0).friction < 0.6


def test_a_sole_without_load_tells_nothing() -> None:
    assert after(SlipWatch(0.7, 582.0), 3.0, 0.5, np.array([[0.0, 5.0, 50.0], [30.0, 40.0, 300.0]])).friction == 0.7


def test_a_sole_that_slides_against_much_friction_is_on_good_ground() -> None:
    assert after(SlipWatch(0.7, 582.0), 1.0, 0.5, np.array([[0.0, 180.0, 300.0], [0.0, 0.0, 0.0]])).friction == 0.7


def test_a_slip_lowers_the_friction_and_the_speed_until_the_ground_holds() -> None:
    watch = after(SlipWatch(0.7, 582.0), 0.47, 0.2)
    assert watch.friction == pytest.approx(0.21)
    assert watch.fastest < 0.6
    low = watch.friction
    assert low < after(watch, 0.0, 5.0).friction < 0.7
    assert after(watch, 0.0, 60.0).friction == 0.7
    watch = after(SlipWatch(0.7, 582.0), 2.0, 5.0)
    assert watch.friction > 0.0
    watch.reset()
    assert watch.friction == 0.7


@pytest.mark.parametrize("friction", [0.8, 0.3])
def test_it_walks_on_good_and_on_slippery_ground(friction: float) -> None:
    controller = WholeBodyController(load_robot())
    simulation = Simulation(variation=Variation(friction=friction), seed=5)
    trace = rollout(controller, Constant(Command(v_x=0.5, gait=Gait.WALKING)), simulation, duration=3.0)
    assert not trace.fell
    diagnostics = controller.diagnostics
    assert diagnostics.friction == 0.7 if friction == 0.8 else diagnostics.friction < 0.3
    assert any("slippery" in line for line in diagnostics.report) is (diagnostics.friction < 0.2)
