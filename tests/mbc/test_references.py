import numpy as np
import pytest

from hugwbc import Command, Gait, load_robot
from hugwbc.mbc.command_filter import CommandFilter
from hugwbc.mbc.feet import Ground
from hugwbc.mbc.footsteps import Pendulum, StepPlan, StepRequest
from hugwbc.mbc.gait_plan import GaitPlan, Mode
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.references import Crouch, References

ROBOT, PARAMS, DT = load_robot(), ControllerParams(), 0.002


def _plan(mode):
    """A plan in a mode: walking, leaping on the ground, or standing."""
    gait = {Mode.WALKING: Gait.WALKING, Mode.LEAPING: Gait.JUMPING, Mode.STANDING: Gait.STANDING}[mode]
    plan = GaitPlan()
    while plan.mode is not mode:
        plan.advance(gait, 2.0, DT, may_start=True, may_stop=False)
    return plan


def _follow(dynamics, plan, seconds, *, omega=0.0, v_x=0.0, ground=None, start=None):
    """The references after some time with a command that has been reached."""
    command_filter, command = CommandFilter(PARAMS, load_robot()), Command(v_x=v_x, omega=omega, gait=Gait.WALKING)
    for _ in range(500):
        smooth = command_filter.update(command, DT)
    references = References(PARAMS, plan, ground or Ground())
    references.reset(start or dynamics)
    for _ in range(round(seconds / DT)):
        references.update(dynamics, smooth, DT)
    return references


def test_the_heading_turns_at_the_commanded_rate_and_does_not_run_away(dynamics_of):
    dynamics, plan = dynamics_of(3.0), _plan(Mode.WALKING)
    references = _follow(dynamics, plan, 0.4, omega=0.5)
    assert references.yaw == pytest.approx(3.2) and references.orientation.yaw_rate == 0.5
    assert references.to_heading @ [np.cos(3.2), np.sin(3.2)] == pytest.approx([1.0, 0.0], abs=1e-12)
    # The robot does not turn: the reference waits 0.3 rad ahead of it.
    assert _follow(dynamics, plan, 2.0, omega=0.5).yaw == pytest.approx(3.3)


def test_standing_the_heading_returns_to_the_feet(dynamics_of):
    """Both feet point 0.2 rad to the left of the pelvis."""
    dynamics = dynamics_of(joints={"left_hip_yaw": 0.2, "right_hip_yaw": 0.2})
    plan = _plan(Mode.STANDING)
    assert _follow(dynamics, plan, 0.2, omega=1.0).yaw == pytest.approx(0.1, abs=5e-3), "0.5 rad/s"
    later = _follow(dynamics, plan, 1.0, omega=1.0)
    assert later.yaw == pytest.approx(0.2, abs=5e-3) and later.orientation.yaw_rate == 0.0


def test_the_ground_follows_the_feet_smoothly_and_stays_in_flight(dynamics_of, standing_state):
    below, above = dynamics_of(), dynamics_of(position=standing_state.position + np.array([0.0, 0.0, 0.05]))
    references = _follow(above, _plan(Mode.STANDING), 0.1, start=below)
    level = _follow(below, _plan(Mode.STANDING), 0.1).ground
    # A first-order lag of 0.1 s.
    assert references.ground - level == pytest.approx(0.05 * (1.0 - np.exp(-1.0)), abs=5e-4)
    assert references.height.target == pytest.approx(references.ground + ROBOT.nominal_height)
    flying = _plan(Mode.LEAPING)
    while not flying.airborne:
        flying.advance(Gait.JUMPING, 2.0, DT, may_start=True, may_stop=False)
    assert _follow(above, flying, 0.1, start=below).ground == pytest.approx(level)


def test_on_a_slope_the_pelvis_rises_as_it_walks(dynamics_of):
    ground = Ground()
    ground.gradient[:] = [0.0, 0.1]  # uphill to the left of the world, which is ahead of the robot
    references = _follow(dynamics_of(np.pi / 2.0), _plan(Mode.WALKING), 0.01, v_x=0.5, ground=ground)
    assert references.height.rate == pytest.approx(0.05)


def _settle(dynamics, foothold, seconds=2.0):
    """The depth after standing on the right ankle for a long time with the left foot to land somewhere at once."""
    crouch = Crouch(PARAMS)
    pivot = dynamics.position("right_ankle_link")[:2]
    pendulum = Pendulum(pivot=pivot, com=pivot, omega=3.2, dcm=pivot)
    request = StepRequest(pendulum, np.zeros(2), 0.0, 0.0, 0.0, 0, 0.25, 0.065)
    step = StepPlan(pivot + np.array(foothold), pivot, (0.0, 0.0))
    height = float(dynamics.position("pelvis")[2] - dynamics.position("right_sole")[2])
    for _ in range(round(seconds / 0.002)):
        crouch.prepare(dynamics, request, step, 0.0, height)
        crouch.advance(0.002)
    return crouch


def test_an_ordinary_step_needs_no_crouch(dynamics_of):
    dynamics = dynamics_of()
    assert _settle(dynamics, [0.3, 0.25]).depth == 0.0


def test_the_pelvis_comes_down_until_the_leg_is_as_long_as_it_may_be(dynamics_of):
    dynamics = dynamics_of()
    crouch = _settle(dynamics, [0.5, 0.4])
    hip = dynamics.position("left_hip_pitch_link") - [0.0, 0.0, crouch.depth]
    ankle = np.array([0.5, 0.4, 0.0]) + dynamics.position("right_ankle_link")
    assert np.linalg.norm(hip - ankle) == pytest.approx(0.8 - PARAMS.leg_reserve, abs=1e-3)
    assert 0.05 < crouch.depth < PARAMS.max_crouch


def test_it_goes_no_lower_than_its_bound_and_comes_up_again(dynamics_of):
    dynamics = dynamics_of()
    crouch = _settle(dynamics, [5.0, 0.0])
    assert crouch.depth == pytest.approx(PARAMS.max_crouch, abs=1e-3)
    depths = []
    for _ in range(2000):
        crouch.advance(0.002)
        depths.append(crouch.depth)
    assert depths[-1] == pytest.approx(0.0, abs=1e-4)
    assert -np.min(np.diff(depths)) / 0.002 <= PARAMS.rise_rate[0] + 1e-9
