import numpy as np
import pytest

from hugwbc import load_robot, rotations
from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.footsteps import Pendulum, StepRequest, nominal_offset, plan_step, time_step
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.swing import SwingTrajectory
from tests.conftest import make_state

OMEGA, STEP_TIME, COP_REACH = 3.2, 0.25, 0.065
PARAMS = ControllerParams()


def _offset(velocity, *how):
    offset = nominal_offset(complex(*velocity), *how)
    return np.array([offset.real, offset.imag])


def _periodic(velocity, yaw_rate, step_time, width, steps=6):
    """Walk a pendulum by the nominal offsets alone: footholds and body positions at step starts, by integration."""
    pivot, heading, stance = np.zeros(2), 0.0, 0
    dcm = _offset(velocity, yaw_rate, step_time, OMEGA, width, stance)
    com = dcm.copy()
    track = []
    for _ in range(steps):
        n = 2000
        for _ in range(n):  # dcm' = omega (dcm - pivot), com' = omega (dcm - com)
            com, dcm = com + OMEGA * (dcm - com) * step_time / n, dcm + OMEGA * (dcm - pivot) * step_time / n
        heading += yaw_rate * step_time
        stance = 1 - stance
        offset = _offset(velocity, yaw_rate, step_time, OMEGA, width, stance)
        pivot = dcm - rotations.rotation_z(heading)[:2, :2] @ offset
        track.append((pivot, com, heading))
    return track


def test_straight_gait_repeats_with_the_commanded_step_and_width():
    track = _periodic(np.array([0.8, 0.0]), 0.0, 0.25, 0.3)
    steps = np.diff([pivot for pivot, _, _ in track], axis=0)
    assert steps[:, 0] == pytest.approx(0.8 * 0.25, abs=2e-3)
    assert np.abs(steps[:, 1]) == pytest.approx(0.3, abs=4e-3)
    assert np.all(steps[:-1, 1] * steps[1:, 1] < 0)


def test_turning_gait_keeps_its_speed_along_the_circle():
    track = _periodic(np.array([0.5, 0.0]), 1.0, 0.25, 0.3, steps=24)
    # The centre of mass runs on a circle of radius v / yaw rate, and two steps turn by 0.5 rad.
    bodies = np.array([body for _, body, _ in track[-9:]])
    chords = [np.linalg.norm(np.diff(bodies[first::2], axis=0), axis=1) for first in (0, 1)]
    assert np.ptp(chords[0]) < 2e-3
    assert np.ptp(chords[1]) < 2e-3
    assert np.mean([chord.mean() for chord in chords]) == pytest.approx(2 * (0.5 / 1.0) * np.sin(0.25), rel=0.03)


def test_offsets_of_the_two_feet_are_mirror_images():
    left = _offset(np.array([0.3, 0.2]), 0.4, 0.3, OMEGA, 0.28, 0)
    right = _offset(np.array([0.3, -0.2]), -0.4, 0.3, OMEGA, 0.28, 1)
    assert left == pytest.approx(right * [1.0, -1.0])


def _pendulum(dcm):
    return Pendulum(pivot=np.zeros(2), com=np.zeros(2), omega=OMEGA, dcm=np.asarray(dcm, dtype=float))


def _request(dcm, velocity=(0.0, 0.0), swing=0):
    return StepRequest(_pendulum(dcm), np.asarray(velocity), 0.0, 0.0, 0.02, swing, STEP_TIME, COP_REACH)


def _plan(dcm, velocity=(0.0, 0.0), swing=0, remaining=0.1):
    return plan_step(ControllerParams(), _request(dcm, velocity, swing), remaining)


def test_a_push_moves_the_foothold_by_what_it_grows_to():
    calm, pushed = _plan([0.0, 0.08]), _plan([0.0, 0.12])
    assert pushed.missed == (0.0, 0.0)
    growth = np.exp(OMEGA * 0.1)
    assert pushed.foothold - calm.foothold == pytest.approx([0.0, 0.04 * growth], abs=1e-9)


def test_footholds_stay_within_reach_and_never_cross():
    params = ControllerParams()
    for dcm in ([5.0, 5.0], [-5.0, -5.0], [0.0, -5.0]):
        for swing, outward in ((0, 1.0), (1, -1.0)):
            plan = _plan(dcm, swing=swing)
            assert any(plan.missed)
            assert params.max_step[0] <= plan.foothold[0] <= params.max_step[1]
            assert params.min_foot_distance <= outward * plan.foothold[1] <= params.max_foot_distance


def test_the_centre_of_pressure_stays_under_the_foot():
    for x in (-1.0, 1.0):
        cop = _plan([x, 0.1]).cop
        assert abs(cop[0] + 0.02) == pytest.approx(COP_REACH)
        assert cop[1] == 0.0


def test_the_centre_of_mass_follows_the_pendulum():
    """Against an integration of c'' = omega^2 (c - p)."""
    pendulum, cop = _pendulum([0.15, 0.05]), np.array([0.02, 0.0])
    com, velocity = np.zeros(2), OMEGA * np.array([0.15, 0.05])
    for _ in range(2000):
        velocity = velocity + OMEGA**2 * (com - cop) * 1e-4
        com = com + velocity * 1e-4
    assert pendulum.com_after(cop, 0.2) == pytest.approx(com, abs=1e-4)


def test_pendulum_velocity_of_pure_translation_is_the_velocity(dynamics_of):
    dynamics = dynamics_of(velocity=np.array([0.3, -0.2, 0.0]))
    pendulum = Pendulum.about(np.zeros(3), dynamics)
    assert (pendulum.dcm - pendulum.com) * pendulum.omega == pytest.approx([0.3, -0.2], abs=1e-9)
    assert pendulum.omega == pytest.approx(np.sqrt(9.81 / dynamics.com[2]))


def test_the_pendulum_of_shorter_legs_may_be_lower():
    """A squat of the G1, and then a fall."""
    dynamics = Dynamics(load_robot("g1"))
    dynamics.update(make_state(dynamics.robot.nominal))
    for height, counts in ((0.35, 0.35), (0.1, 0.5 * dynamics.robot.leg_length)):
        pendulum = Pendulum.about(dynamics.com - [0.0, 0.0, height], dynamics)
        assert pendulum.omega == pytest.approx(np.sqrt(9.81 / counts))


def test_on_a_slope_the_pendulum_moves_as_on_level_ground(dynamics_of):
    """Climbing at the slope's rate with no angular momentum, the effective velocity is that of the centre of mass."""
    dynamics, gradient = dynamics_of(velocity=np.array([0.5, 0.0, 0.05])), np.array([0.1, 0.0])
    pivot = np.array([dynamics.com[0] - 0.2, dynamics.com[1], 0.0])
    pendulum = Pendulum.about(pivot, dynamics, gradient)
    assert pendulum.omega == pytest.approx(np.sqrt(9.81 / (dynamics.com[2] - 0.02)))
    assert (pendulum.dcm - pendulum.com) * pendulum.omega == pytest.approx([0.5, 0.0], abs=1e-9)


def _choose(dcm, remaining=0.2, *, foot=(0.0, 0.25), params=PARAMS):
    """What is decided when the left foot swings and the divergent component is at a place relative to the right one."""
    request = _request(dcm)
    swing = SwingTrajectory(params)
    swing.start(np.array([*foot, 0.1]))
    step = plan_step(params, request, remaining)
    return time_step(params, request, step, swing, STEP_TIME - remaining, remaining)


def test_a_foothold_within_reach_keeps_time():
    remaining, step = _choose([0.0, 0.1])
    assert remaining == 0.2
    assert step.missed == (0.0, 0.0)


@pytest.mark.parametrize(("dcm", "foot"), [([0.0, -0.2], (0.0, 0.25)), ([0.0, 0.45], (0.0, 0.45))])
def test_the_foot_lands_sooner_when_the_robot_falls_past_either_foot(dcm, foot):
    """Past the stance foot, which the swing foot cannot cross, or further out than it reaches."""
    remaining, step = _choose(dcm, foot=foot)
    assert remaining < 0.2
    duration = STEP_TIME - 0.2 + remaining
    assert duration == pytest.approx(STEP_TIME / (1.0 + PARAMS.step_timing))
    on_time = abs(step.missed[1]) * np.exp(OMEGA * (0.2 - remaining))
    assert abs(step.missed[1]) < on_time


def test_a_foot_that_could_not_arrive_is_not_hurried():
    near, _ = _choose([0.0, -0.2], remaining=0.12, foot=(0.0, 0.1))
    far, _ = _choose([0.0, -0.2], remaining=0.12, foot=(0.0, 0.6))
    assert near < 0.12 <= far


def test_the_frequency_stays_within_its_share_for_any_state():
    rng = np.random.default_rng(0)
    for _ in range(200):
        remaining = rng.uniform(0.01, STEP_TIME)
        chosen, _ = _choose(rng.uniform(-1.0, 1.0, 2), remaining, foot=rng.uniform(-0.5, 0.5, 2))
        pace = STEP_TIME / (STEP_TIME - remaining + chosen)
        assert 1.0 - PARAMS.step_timing - 1e-9 <= pace <= 1.0 + PARAMS.step_timing + 1e-9
        assert chosen == remaining or min(chosen, remaining) >= 0.06


def test_what_was_decided_holds_until_the_foot_is_down():
    """The same state asked again at the time that was chosen gives the same time."""
    sooner, _ = _choose([0.0, -0.2])
    request = _request([0.0, -0.2])
    swing = SwingTrajectory(PARAMS)
    swing.start(np.array([0.0, 0.25, 0.1]))
    step = plan_step(PARAMS, request, sooner)
    again, _ = time_step(PARAMS, request, step, swing, STEP_TIME - 0.2, sooner)
    assert again == pytest.approx(sooner)
