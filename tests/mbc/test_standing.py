import dataclasses

import numpy as np
import pytest

from hugwbc import Gait, load_robot, rotations
from hugwbc.mbc import feet
from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.footsteps import Pendulum
from hugwbc.mbc.gait_plan import GaitPlan, Mode
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.references import References
from hugwbc.mbc.standing import Standing

PARAMS, DT = ControllerParams(), 0.002
YAW = 2.0
TO_HEADING = rotations.rotation_z(-YAW)[:2, :2]


@pytest.fixture
def stand(standing_state):
    """A stand in a gait's shift of the weight, or none, with a velocity in the heading frame; and its dynamics."""

    def make(velocity=(0.0, 0.0), gait=Gait.STANDING, elapsed=0.0):
        dynamics, plan = Dynamics(load_robot()), GaitPlan()
        references = References(PARAMS, plan, feet.Ground())
        moving = dataclasses.replace(
            standing_state,
            orientation=rotations.from_yaw_pitch_roll(YAW, 0.0, 0.0),
            velocity=np.array([*(TO_HEADING.T @ velocity), 0.0]),
        )
        dynamics.update(moving)
        references.reset(dynamics)
        plan.advance(gait, 2.0, DT, may_start=False, may_stop=True)
        plan.elapsed += elapsed
        standing = Standing(PARAMS, plan, references)
        standing.update(dynamics)
        return standing, dynamics

    return make


def test_the_centre_of_mass_belongs_between_the_feet(stand):
    standing, dynamics = stand()
    middle = sum(feet.pivot(dynamics, foot, PARAMS.balance_ahead) for foot in range(2))[:2] / 2.0
    assert standing.com.target == pytest.approx(middle) and standing.com.heading == pytest.approx(YAW)
    assert standing.com.servo == pytest.approx([1.0, 1.0]) and standing.com.feedforward == pytest.approx([0.0, 0.0])


@pytest.mark.parametrize(
    ("velocity", "catches", "first_swing"),
    [((0.1, 0.0), False, None), ((0.8, 0.0), True, None), ((0.0, 0.8), True, 1), ((0.0, -0.8), True, 0)],
)
def test_pushed_out_of_balance_it_begins_to_step(stand, velocity, catches, first_swing):
    """Pushed to the left, the right foot moves first: the left one carries."""
    standing, _ = stand(velocity)
    assert standing.catching == (PARAMS.capture_time if catches else 0.0)
    assert first_swing in (None, standing.first_swing)
    standing.reset()
    assert standing.catching == 0.0 and not standing.ready


def test_a_jump_may_begin_from_a_calm_stand_or_after_a_while(stand):
    assert stand((0.05, 0.0))[0].ready
    assert not stand((0.3, 0.0))[0].ready
    late, _ = stand((0.3, 0.0), elapsed=PARAMS.settle_time)
    assert late.settled and late.ready


def test_the_shift_ends_where_the_first_step_begins(stand):
    """The pendulum, over the centre of pressure of the feed-forward until the shift is over, by its solution."""
    standing, dynamics = stand(gait=Gait.WALKING)
    pivots = [feet.pivot(dynamics, foot, PARAMS.balance_ahead) for foot in range(2)]
    pendulum = Pendulum.about((pivots[0] + pivots[1]) / 2.0, dynamics)
    dcm, com, left, right = (float(TO_HEADING[1] @ at[:2]) for at in (pendulum.dcm, pendulum.com, *pivots))
    cop = com - standing.com.feedforward[1] / pendulum.omega**2
    assert right < cop < left
    after = cop + (dcm - cop) * np.exp(pendulum.omega * PARAMS.shift_time)
    width, growth = PARAMS.step_width, np.exp(pendulum.omega * 0.25)
    assert after - right == pytest.approx(width / (1.0 + growth), abs=1e-3)
    assert standing.com.servo[1] == 0.0 and not standing.ready
    assert stand(gait=Gait.WALKING, elapsed=PARAMS.max_shift_time)[0].ready


@pytest.mark.parametrize(("gait", "foot"), [(Gait.HOPPING_LEFT, 0), (Gait.HOPPING_RIGHT, 1)])
def test_before_a_hop_the_weight_moves_onto_its_foot(stand, gait, foot):
    half, dynamics = stand(gait=gait, elapsed=0.5 * PARAMS.hop_shift_time)
    pivots = [feet.pivot(dynamics, index, PARAMS.balance_ahead)[:2] for index in range(2)]
    middle = (pivots[0] + pivots[1]) / 2.0
    edge = pivots[foot] + dynamics.robot.sole_y[1] * (0.5 - foot) * 2.0 * TO_HEADING[1]  # the outer one of the sole
    assert half.com.target == pytest.approx(0.5 * (middle + edge), abs=1e-3)
    over, _ = stand(gait=gait, elapsed=PARAMS.hop_shift_time)
    assert over.com.target == pytest.approx(edge)
    # The divergent component, over the centre of pressure of the feed-forward, closes the gap at the rate of the gain.
    pendulum = Pendulum.about(0.5 * (feet.pivot(dynamics, 0, 0.0) + feet.pivot(dynamics, 1, 0.0)), dynamics)
    cop = TO_HEADING[1] @ pendulum.com - over.com.feedforward[1] / pendulum.omega**2
    rate = pendulum.omega * (TO_HEADING[1] @ pendulum.dcm - cop)
    assert rate == pytest.approx(PARAMS.hop_shift_gain * (TO_HEADING[1] @ (edge - pendulum.dcm)), rel=1e-3)
    assert over.com.servo.tolist() == [1.0, 0.0]
    assert not over.ready, "the robot itself has not moved"
    assert over._plan.mode is Mode.SHIFTING


@pytest.mark.parametrize(
    ("elapsed", "gap", "ready"),
    [(0.5, 0.011, True), (0.5, 0.013, False), (0.4, 0.0, False), (1.4, 0.013, False), (2.0, 0.023, True),
     (4.0, 0.047, True), (60.0, 0.049, False)],
)  # fmt: skip
def test_a_hop_begins_near_its_foot_and_later_less_near(stand, elapsed, gap, ready):
    shifted, dynamics = stand(gait=Gait.HOPPING_LEFT, elapsed=PARAMS.hop_shift_time)
    pendulum = Pendulum.about(0.5 * (feet.pivot(dynamics, 0, 0.0) + feet.pivot(dynamics, 1, 0.0)), dynamics)
    away = TO_HEADING @ (shifted.com.target - pendulum.dcm)
    for side in (-gap, gap):
        velocity = (away + np.array([0.0, side])) * pendulum.omega
        assert stand(velocity, gait=Gait.HOPPING_LEFT, elapsed=elapsed)[0].ready == ready
