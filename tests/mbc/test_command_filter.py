import dataclasses

import numpy as np
import pytest

from hugwbc import Command, Gait, load_robot
from hugwbc.mbc.command_filter import CommandFilter, GaitState, VelocityTrim
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.reach import fastest_walk

PARAMS = ControllerParams()
DT = 0.002
# The legs of the lighter robot follow every commanded speed at 2 Hz.
LIGHT = load_robot("h1-2023")


def _history(command, seconds, start=(0.0, 0.0, 0.0), robot=load_robot()):  # noqa: B008
    command_filter = CommandFilter(PARAMS, robot)
    command_filter.reset(*start)
    return [command_filter.update(command, DT) for _ in range(round(seconds / DT))]


def _after(ticks, command, gait=None, commands=None):
    """The command after so many ticks, of a filter that is new unless it is given."""
    commands = commands or CommandFilter(PARAMS, load_robot())
    for _ in range(ticks):
        result = commands.update(command, DT, gait or GaitState())
    return result


def test_on_slippery_ground_the_whole_velocity_is_scaled():
    command = Command(v_x=0.8, v_y=0.6, omega=0.4, gait=Gait.WALKING)  # 1 m/s
    for fastest, share in ((0.5, 0.5), (0.3, 0.3), (1.1, 1.0)):
        smooth = _after(2000, command, GaitState(running=Gait.WALKING, fastest=fastest))
        assert (*smooth.velocity, smooth.omega) == pytest.approx((0.8 * share, 0.6 * share, 0.4 * share))


def test_posture_arrives_within_its_rates_and_without_overshoot():
    history = _history(Command(h=-0.2, p=0.4, w=-1.0), 4.0)
    for name, target, (rate, quickness) in (
        ("h", -0.2, PARAMS.height_rate),
        ("p", 0.4, PARAMS.pitch_rate),
        ("w", -1.0, PARAMS.waist_rate),
    ):
        values = np.array([getattr(command, name) for command in history])
        assert values[-1] == pytest.approx(target, abs=1e-4)
        assert np.max(np.abs(values)) <= abs(target) + 2e-3
        speed = np.diff(values) / DT
        assert np.max(np.abs(speed)) <= rate + 1e-9
        assert np.max(np.abs(np.diff(speed) / DT)) <= quickness + 1e-6
        rates = np.array([getattr(command, f"{name}_rate") for command in history])
        assert rates[1:] == pytest.approx(speed, abs=1e-9)


def test_a_posture_arrives_exactly_and_what_does_not_move_is_not_worked_out_again():
    command_filter, command = CommandFilter(PARAMS, load_robot()), Command(h=-0.2, p=0.4, w=-1.0)
    command_filter.reset(0.0, 0.0, 0.0)
    ticks = [command_filter.update(command, DT) for _ in range(round(4.0 / DT))]
    last = ticks[-1]
    assert (last.h, last.p, last.w) == (-0.2, 0.4, -1.0)
    assert (last.h_rate, last.p_rate, last.w_rate) == (0.0, 0.0, 0.0)
    assert command_filter.update(command, DT) is ticks[-1]
    assert command_filter.update(Command(h=-0.1), DT).h > -0.2
    assert command_filter.update(command, DT, GaitState(stepping=True)).h != -0.2


def test_velocities_ramp():
    history = _history(Command(v_x=2.0, v_y=-0.6, omega=1.0, gait=Gait.WALKING), 3.0, robot=LIGHT)
    velocity = np.array([[*command.velocity, command.omega] for command in history])
    assert velocity[-1] == pytest.approx([2.0, -0.6, 1.0])
    assert np.max(np.abs(np.diff(velocity, axis=0)) / DT, axis=0) == pytest.approx(PARAMS.velocity_rate)


def test_a_squat_too_deep_to_walk_in_is_limited():
    smooth = _after(2000, Command(h=-0.3, l=0.3, gait=Gait.WALKING))
    assert -0.2 < smooth.h < -0.1
    assert smooth.l < 0.2


def test_a_squat_that_strays_is_as_high_as_the_speed_that_it_has_needs():
    command, heights = Command(h=-0.3, gait=Gait.WALKING), {}
    for v_x, stray in ((0.0, 0.0), (0.0, -0.6), (-0.6, 0.0)):
        command_filter = CommandFilter(PARAMS, load_robot())
        asked = dataclasses.replace(command, v_x=v_x)
        heights[v_x, stray] = _after(1000, asked, GaitState(stray=stray), command_filter).h
    assert heights[0.0, -0.6] == pytest.approx(heights[-0.6, 0.0]) and heights[0.0, -0.6] > heights[0.0, 0.0] + 0.05
    # Once it has come to rest, it squats again.
    assert _after(1000, command, commands=command_filter).h == pytest.approx(heights[0.0, 0.0])


def test_a_walk_is_no_faster_than_the_hips_can_swing_the_legs():
    command = Command(v_x=2.0, gait=Gait.WALKING)
    smooth = _after(1000, command)
    fastest = fastest_walk(PARAMS, 2.0, robot=load_robot())
    assert smooth.velocity[0] == pytest.approx(fastest) and 1.5 < fastest < 2.0


def test_a_jump_keeps_room_to_sink_and_may_lift_its_feet_with_the_body():
    smooth = _after(2000, Command(h=-0.3, l=0.35, f=1.5, gait=Gait.JUMPING))
    # The body rises and sinks by g / (32 f^2) = 0.1363 m.
    assert smooth.h == pytest.approx(PARAMS.leap_depth + 0.1363, abs=1e-3)
    assert smooth.l == pytest.approx(0.31 + smooth.h + 0.1363, abs=1e-3)


def test_a_jump_waits_for_its_posture():
    history = _history(Command(h=-0.2, gait=Gait.JUMPING), 1.5)
    begin = [command.posed for command in history].index(True)
    assert not history[0].posed and history[begin].h == pytest.approx(history[-1].h, abs=0.005) and history[-1].posed
    assert _history(Command(gait=Gait.JUMPING), 0.1)[0].posed


def test_a_robot_that_stands_on_nearly_straight_legs_bends_them_to_jump():
    """The H1's knees are bent by 0.8 rad where it stands, the G1's by 0.3: 0.035 m of leg are left to push off with."""
    jump = Command(gait=Gait.JUMPING)
    for name, lowered in (("h1", 0.0), ("g1", -0.0266)):
        last = _history(jump, 1.0, robot=load_robot(name))[-1]
        assert last.h == pytest.approx(lowered, abs=1e-3)


def test_jumps_are_slower_than_a_walk():
    jump = Command(v_x=1.8, gait=Gait.JUMPING)
    command = _after(2000, jump, GaitState(running=Gait.JUMPING))
    assert command.velocity[0] == pytest.approx(1.4, abs=0.02), "what the H1 reaches in jumps of 2 Hz"
    assert _after(2000, dataclasses.replace(jump, f=3.0)).velocity[0] < 1.0, "faster swings leave less"


@pytest.mark.parametrize("gait", [Gait.HOPPING_LEFT, Gait.HOPPING_RIGHT])
def test_a_hop_is_lowered_slowly_and_less_where_it_travels_or_turns(gait):
    hops, deep = GaitState(running=gait), Command(h=-0.3, gait=gait)
    commands = CommandFilter(PARAMS, load_robot())
    before = _after(1000, Command(gait=gait), GaitState(running=gait, waiting=True), commands).h
    assert before - _after(100, deep, hops, commands).h < 0.012, "0.2 s, in which a walk gets 0.07 m lower"
    lowest = _after(2000, deep, hops, commands).h
    for faster in (dict(v_x=-0.4), dict(v_y=0.3, omega=0.2), dict(omega=-0.5)):
        moving = _after(2000, dataclasses.replace(deep, **faster), hops, commands).h
        assert moving == pytest.approx(-PARAMS.hop_lowering) and lowest < moving - 0.02


def test_a_jump_from_a_squat_does_not_travel():
    deep, jumps = Command(h=-0.3, gait=Gait.JUMPING), GaitState(running=Gait.JUMPING)
    lowest = _after(3000, deep, jumps).h
    for faster in (dict(v_x=-0.3), dict(v_y=0.3, omega=0.3)):
        assert _after(3000, dataclasses.replace(deep, **faster), jumps).h == pytest.approx(-PARAMS.jump_lowering)
    assert lowest < -0.16


def test_a_jump_that_travels_keeps_length_for_legs_that_lean_and_a_low_one_has_it():
    for h, used in ((0.0, -0.0596), (-0.09, -0.09)):
        command = Command(v_x=0.8, h=h, gait=Gait.JUMPING)
        assert _after(3000, command, GaitState(running=Gait.JUMPING)).h == pytest.approx(used, abs=1e-3)


def test_a_lower_command_never_jumps_higher():
    """Where the leg of a fast jump has no room to pass, its height is that of an upright one."""
    fast = Command(v_x=1.2, f=1.5, gait=Gait.JUMPING)
    upright, lower, low = (
        _after(3000, dataclasses.replace(fast, h=h), GaitState(running=Gait.JUMPING)).h for h in (0.0, -0.005, -0.05)
    )
    assert upright == pytest.approx(-0.06, abs=1e-3) and (lower, low) == pytest.approx((upright, upright), abs=1e-6)


def test_the_last_leap_keeps_its_posture():
    commands, leaps = CommandFilter(PARAMS, load_robot()), GaitState(running=Gait.JUMPING)
    _after(1000, Command(p=0.2, w=0.3, gait=Gait.JUMPING), leaps, commands)
    for gait in (Gait.WALKING, Gait.STANDING):
        command = _after(300, Command(w=-0.5, gait=gait), leaps, commands)
        assert (command.p, command.w) == (0.2, 0.3)
    command = _after(1000, Command(w=-0.5, gait=Gait.STANDING), GaitState(), commands)
    assert (command.p, command.w) == (0.0, -0.5)


def test_it_comes_to_rest_before_it_changes_gait():
    commands = CommandFilter(PARAMS, load_robot())
    walk, jump = (Command(v_x=0.5, gait=gait) for gait in (Gait.WALKING, Gait.JUMPING))
    _after(1000, walk, GaitState(running=Gait.WALKING), commands)
    smooth = _after(1000, jump, GaitState(running=Gait.WALKING), commands)
    assert smooth.velocity == pytest.approx([0.0, 0.0], abs=1e-9)
    smooth = _after(1000, jump, GaitState(running=Gait.JUMPING), commands)
    assert smooth.velocity == pytest.approx([0.5, 0.0], abs=1e-9)


@pytest.mark.parametrize("v_x", [0.4, 1.8])
def test_a_lower_command_never_walks_higher(v_x):
    """Where the stance leg's room ends, the height stays: with what the speed lowers it by."""
    heights = [
        _history(Command(h=h, v_x=v_x, gait=Gait.WALKING), 2.5, robot=LIGHT)[-1].h
        for h in (0.0, -0.02, -0.04, -0.06, -0.2, -0.3)
    ]
    assert np.all(np.diff(heights) <= 1e-6)
    assert heights[-1] == pytest.approx(heights[-2], abs=1e-6)
    assert heights[0] == pytest.approx(-PARAMS.speed_lowering * max(v_x - PARAMS.lowering_from, 0.0), abs=1e-6)


def test_a_gait_that_comes_to_rest_keeps_its_frequency_and_its_limits():
    commands, hopping = CommandFilter(PARAMS, load_robot()), GaitState(running=Gait.HOPPING_LEFT)
    hop = _after(2000, Command(gait=Gait.HOPPING_LEFT), hopping, commands)
    walk = Command(f=3.5, gait=Gait.WALKING)
    smooth = _after(1000, walk, hopping, commands)
    assert (smooth.f, smooth.h) == (hop.f, hop.h) == (2.0, -PARAMS.hop_lowering)
    smooth = _after(2000, walk, GaitState(running=Gait.WALKING), commands)
    assert (smooth.f, smooth.h) == (3.5, 0.0)


def test_a_hop_gathers_speed_only_once_it_hops():
    commands, command = CommandFilter(PARAMS, load_robot()), Command(v_x=0.6, omega=-0.6, gait=Gait.HOPPING_RIGHT)
    smooth = _after(500, command, GaitState(running=Gait.HOPPING_RIGHT, waiting=True), commands)
    assert smooth.velocity == pytest.approx([0.0, 0.0]) and smooth.omega == 0.0
    smooth = _after(100, command, GaitState(running=Gait.HOPPING_RIGHT), commands)
    gathered = 100 * DT * np.array(PARAMS.velocity_rate)
    assert [smooth.velocity[0], smooth.omega] == pytest.approx([gathered[0], -gathered[2]])


@pytest.mark.parametrize(("gait", "outwards"), [(Gait.HOPPING_LEFT, 1.0), (Gait.HOPPING_RIGHT, -1.0)])
def test_a_sideways_hop_is_slow_where_the_leg_crosses_over(gait, outwards):
    for side, most in ((outwards, 0.6), (-outwards, PARAMS.hop_inward_speed)):
        commands, velocities = CommandFilter(PARAMS, load_robot()), []
        for _ in range(1000):
            smooth = commands.update(Command(v_y=0.6 * side, gait=gait), DT, GaitState(running=gait))
            velocities.append(smooth.velocity[1])
        assert velocities[-1] == pytest.approx(most * side)
        assert np.abs(np.diff(velocities)).max() == pytest.approx(PARAMS.hop_side_rate * DT)


def _steps(trim, errors, ticks=125, *, velocity=(1.0, 0.0), **leap):
    for error in errors:
        for _ in range(ticks):
            trim.measure(np.array(velocity), np.add(velocity, error), 0.002)
        trim.end_step(**leap)


def test_a_leap_is_corrected_by_what_two_steps_of_a_walk_are():
    walk, leap = VelocityTrim(PARAMS), VelocityTrim(PARAMS)
    _steps(walk, [(0.05, 0.0)] * 5)
    _steps(leap, [(0.05, 0.0)] * 3, 250, leap=True)
    assert walk.value[0] > 0.0 and leap.value == pytest.approx(walk.value)


def test_sway_that_alternates_between_steps_is_not_integrated():
    trim = VelocityTrim(PARAMS)
    _steps(trim, [(0.0, 0.1), (0.0, -0.1)] * 5)
    assert trim.value == pytest.approx([0.0, 0.0], abs=1e-12)


def test_steps_during_and_after_a_change_of_command_do_not_count():
    trim = VelocityTrim(PARAMS)
    _steps(trim, [(0.01, 0.0), *[(0.12, 0.0)] * 5])
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


@pytest.mark.parametrize(
    ("velocity", "wanted"), [((0.0, 0.0), (0.0, 0.1)), ((0.03, -0.05), (0.0, 0.2)), ((-0.1, 0.05), (0.3, 0.0))]
)
def test_nothing_winds_up_while_something_holds_the_robot_or_pushes_it_back(velocity, wanted):
    trim = VelocityTrim(PARAMS)
    _steps(trim, [np.subtract(wanted, velocity)] * 20, velocity=velocity)
    assert not trim.value.any()


def test_a_push_counts_little_and_the_sum_is_bounded():
    trim = VelocityTrim(PARAMS)
    _steps(trim, [(2.0, 0.0)] * 2)
    assert trim.value[0] == pytest.approx(PARAMS.velocity_integral * PARAMS.velocity_integral_bound)
    _steps(trim, [(2.0, 0.0)] * 200)
    assert trim.value[0] == PARAMS.max_velocity_trim
    trim.reset()
    assert np.array_equal(trim.value, np.zeros(2))
