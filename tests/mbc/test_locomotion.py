"""Closed loop in the simulation: short runs with numeric tolerances, from hand-set targets."""

import itertools

import numpy as np
import pytest

from hugwbc import Command, Gait, JointCommand, UpperBody, load_robot
from hugwbc.commands import MEASURED_NAMES
from hugwbc.kinematics import Kinematics
from hugwbc.mbc import WholeBodyController
from hugwbc.sim import Simulation

WALKING = Gait.WALKING


class Run:
    """A closed loop; `rows` holds time, v_x, v_y, omega, h, p, w and both sole clearances after `since` [s]."""

    def __init__(
        self, command, seconds, *, period=0.002, since=0.0, xy=(0.0, 0.0), yaw=0.0, arms=None, push=None, push_at=1.0
    ):
        self.simulation = Simulation()
        self.controller = WholeBodyController(load_robot(), period=period)
        self.kinematics = Kinematics(load_robot())
        state = self.simulation.reset(xy=xy, yaw=yaw)
        self.controller.reset(state)
        self.rows, self.arm_errors, self.lift_offs = [], [], [[], []]
        on_ground = np.ones(2, dtype=bool)
        for tick in itertools.count():
            t = tick * period
            if t >= seconds or self.simulation.fallen:
                break
            upper_body = arms(t) if arms else UpperBody.none()
            if push is not None and tick == round(push_at / period):
                self.simulation.push(np.array(push))
            asked = command(t) if callable(command) else command
            state = self.simulation.step(self.controller.act(state, asked, upper_body), period)
            self.kinematics.update(state)
            m = self.kinematics.measured()
            in_air = np.array(m.clearance) > 0.02
            for foot in np.flatnonzero(in_air & on_ground):
                self.lift_offs[foot].append(t)
            on_ground = ~in_air
            if t >= since:
                self.rows.append([t, m.v_x, m.v_y, m.omega, m.h, m.p, m.w, *m.clearance])
                if arms:
                    arm_q = state.q[self.simulation.robot.arms]
                    self.arm_errors.append(np.max(np.abs(arm_q - upper_body.q)))
        self.state = state
        self.table = np.array(self.rows)

    @property
    def good(self):
        return not self.simulation.fallen and self.controller.diagnostics.fallbacks == 0

    def mean(self, column):
        return self.table[:, 1 + ["v_x", "v_y", "omega", "h", "p", "w"].index(column)].mean()

    def stride_frequency(self, since):
        times = [t for t in self.lift_offs[0] if t > since]
        return (len(times) - 1) / (times[-1] - times[0])


@pytest.mark.parametrize(
    ("posture", "tolerance"), [((-0.2, 0.3, 0.8), (0.005, 0.005, 0.005)), ((-0.3, 0.0, 0.0), (0.01, 0.02, 0.02))]
)
def test_it_stands_squats_pitches_and_turns_the_waist(posture, tolerance):
    run = Run(Command(**dict(zip("hpw", posture, strict=True))), 2.5, since=2.2)
    assert run.good
    assert np.all(np.abs(np.subtract([run.mean(name) for name in "hpw"], posture)) < tolerance)


def test_it_walks_forward_at_the_commanded_speed_frequency_and_swing_height():
    run = Run(Command(v_x=0.5, f=2.0, l=0.15, gait=WALKING), 5.0, since=2.5)
    assert run.good
    assert run.mean("v_x") == pytest.approx(0.5, abs=0.03)
    assert run.mean("v_y") == pytest.approx(0.0, abs=0.04)
    assert run.mean("h") == pytest.approx(0.0, abs=0.01)
    assert run.stride_frequency(2.5) == pytest.approx(2.0, abs=0.02)
    assert run.table[:, 7:].max(axis=0) == pytest.approx([0.15, 0.15], abs=0.015)


def test_it_turns_on_the_spot_far_from_the_origin():
    run = Run(Command(omega=0.4, f=1.5, gait=WALKING), 4.0, since=2.0, xy=(10.0, -5.0), yaw=2.0)
    assert run.good
    assert run.mean("omega") == pytest.approx(0.4, abs=0.04)
    assert np.linalg.norm(run.state.position[:2] - [10.0, -5.0]) < 0.3
    assert run.stride_frequency(1.0) == pytest.approx(1.5, abs=0.02)


def test_it_steps_sideways():
    run = Run(Command(v_y=0.3, gait=WALKING), 4.0, since=2.0)
    assert run.good
    assert run.mean("v_y") == pytest.approx(0.3, abs=0.05)
    assert run.mean("v_x") == pytest.approx(0.0, abs=0.03)


def _swinging_arms(t):
    phase, rate = np.arange(8.0), 2.0 * np.pi
    centre = np.array([-0.5, 0.4, 0.0, 0.5, -0.5, -0.4, 0.0, 0.5])
    return UpperBody.targets(centre + 0.4 * np.sin(rate * t + phase), 0.4 * rate * np.cos(rate * t + phase))


def test_arms_under_external_control_are_tracked_and_balanced():
    run = Run(Command(), 2.5, since=1.0, arms=_swinging_arms)
    assert run.good
    assert max(run.arm_errors) < 0.03
    assert abs(run.mean("h")) < 0.005


def test_it_starts_stops_and_starts_again():
    def script(t):
        walking = t < 2.0 or t > 3.5
        return Command(v_x=0.4 if walking else 0.0, gait=WALKING if walking else Gait.STANDING)

    run = Run(script, 4.8)
    assert run.good
    standing = run.table[(run.table[:, 0] > 3.0) & (run.table[:, 0] < 3.5)]
    assert np.abs(standing[:, 1:4]).max() < 0.1
    assert standing[:, 7:].max() < 0.01
    moving = run.table[run.table[:, 0] > 4.4]
    assert moving[:, 1].mean() > 0.25


def test_it_jumps_in_time_and_comes_to_rest_again():
    def script(t):
        return Command(v_x=0.3, gait=Gait.JUMPING if t < 3.5 else Gait.STANDING)

    run = Run(script, 6.0, since=1.0)
    assert run.good
    jumping = run.table[run.table[:, 0] < 3.5]
    assert jumping[:, 1].mean() == pytest.approx(0.3, abs=0.1)
    assert np.abs(jumping[:, 5]).max() < 0.15
    assert jumping[:, 7:].max(axis=0) == pytest.approx([0.15, 0.15], abs=0.02)
    # Both feet are off the ground for close to half of the time.
    assert (jumping[:, 7:].min(axis=1) > 0.01).mean() == pytest.approx(0.45, abs=0.1)
    lift_offs = [t for t in run.lift_offs[0] if 1.0 < t < 3.5]
    assert np.diff(lift_offs) == pytest.approx(np.full(len(lift_offs) - 1, 0.5), abs=0.01)
    standing = run.table[run.table[:, 0] > 5.5]
    assert np.abs(standing[:, 1:4]).max() < 0.05
    assert standing[:, 4].mean() == pytest.approx(0.0, abs=0.01)


def test_a_jump_that_turns_slowly_does_not_stick_to_the_ground():
    """Nor does its pelvis sway: each foot is pulled back as it is lifted."""
    run = Run(Command(omega=-0.25, f=2.7, gait=Gait.JUMPING), 3.0, period=0.004, since=1.0)
    assert run.good
    assert np.abs(run.table[:, 3] + 0.25).mean() < 0.08
    assert np.abs(run.table[:, 1]).mean() < 0.05
    assert np.diff(run.lift_offs[0][1:]) == pytest.approx(np.full(len(run.lift_offs[0]) - 2, 1.0 / 2.7), abs=0.007)


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [{"v_x": 1.8}, {"v_x": -0.6}, {"v_y": 0.6}, {"omega": 1.0}, {"f": 1.5}, {"f": 3.5}, {"h": -0.3}, {"p": 0.4}],
    ids=str,
)
def test_it_jumps_over_the_command_range(command):
    run = Run(Command(gait=Gait.JUMPING, **command), 5.0, since=2.0)
    assert run.good
    for name, value in command.items():
        done = run.mean(name) if name in MEASURED_NAMES else run.stride_frequency(2.0)
        assert done == pytest.approx(value, abs=0.05) if name == "f" else 0.5 < done / value < 1.5


@pytest.mark.parametrize("gait", [Gait.HOPPING_LEFT, Gait.HOPPING_RIGHT], ids=lambda gait: gait.label)
def test_it_hops_on_one_leg_and_lands_on_both(gait):
    def script(t):
        return Command(gait=gait if t < 4.0 else Gait.STANDING)

    run = Run(script, 6.5, since=2.0)
    assert run.good
    leg, free = (7, 8) if gait is Gait.HOPPING_LEFT else (8, 7)
    hopping = run.table[run.table[:, 0] < 4.0]
    assert hopping[:, free].min() > 0.03
    assert hopping[:, leg].max() == pytest.approx(0.15, abs=0.03)
    lift_offs = [t for t in run.lift_offs[leg - 7] if 1.8 < t < 4.0]
    assert len(lift_offs) >= 4 and np.diff(lift_offs) == pytest.approx(np.full(len(lift_offs) - 1, 0.5), abs=0.02)
    assert np.abs(hopping[:, 1:3].mean(axis=0)).max() < 0.1
    assert np.abs(hopping[:, 5]).max() < 0.1
    standing = run.table[run.table[:, 0] > 6.2]
    assert standing[:, 7:].max() < 0.01 and np.abs(standing[:, 1:4]).max() < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_it_hops_twenty_times_from_any_start_and_under_a_nudge(seed):
    rng = np.random.default_rng(seed)
    simulation, controller = Simulation(), WholeBodyController(load_robot())
    state = simulation.reset(yaw=rng.uniform(-3, 3), q=simulation.robot.nominal + rng.uniform(-0.05, 0.05, 19))
    controller.reset(state)
    hops, was_up = 0, False
    for tick in range(round(12.5 / controller.period)):
        if tick == round(4.0 / controller.period):
            simulation.push(np.array([*rng.uniform(-0.1, 0.1, 2), 0.0]))
        gait = Gait.HOPPING_LEFT if seed % 2 else Gait.HOPPING_RIGHT
        state = simulation.step(controller.act(state, Command(gait=gait), UpperBody.none()), controller.period)
        up = state.foot_force is not None and state.foot_force[:, 2].max() < 1.0
        hops += was_up and not up
        was_up = up
        assert not simulation.fallen
    assert hops >= 20


@pytest.mark.slow
def test_it_changes_between_walking_jumping_and_hopping():
    gaits = ((0.0, WALKING), (2.0, Gait.HOPPING_RIGHT), (5.0, WALKING), (8.0, Gait.JUMPING), (11.0, Gait.HOPPING_LEFT),
             (15.0, Gait.STANDING))  # fmt: skip

    def script(t):
        gait = [gait for start, gait in gaits if t >= start][-1]
        return Command(v_x=0.0 if gait is Gait.STANDING else 0.2, gait=gait)

    run = Run(script, 17.5)
    assert run.good

    def seen(begin, end, *, up):
        rows = run.table[(run.table[:, 0] > begin) & (run.table[:, 0] < end)]
        return bool((rows[:, 7:].min(axis=1) > 0.05).any()) is up

    assert seen(0.0, 2.0, up=False) and seen(4.0, 5.0, up=True) and seen(7.0, 8.0, up=False)
    assert seen(10.0, 11.0, up=True) and seen(14.0, 15.0, up=True)
    assert run.table[-1, 7:].max() < 0.01


def _hop_walk_jump(seed):
    """At any moment from a hop that travels and turns to a fast side walk, and from that to a jump."""
    rng = np.random.default_rng(seed)
    hop = Command(
        gait=(Gait.HOPPING_LEFT, Gait.HOPPING_RIGHT)[seed % 2],
        v_x=rng.uniform(-0.3, 0.6),
        v_y=rng.uniform(-0.2, 0.2),
        omega=rng.uniform(-0.5, 0.5),
    )
    walk = Command(gait=WALKING, v_x=rng.uniform(-0.3, 1.0), v_y=rng.choice([-0.6, 0.6]), f=rng.uniform(1.5, 3.5))
    jump = Command(gait=Gait.JUMPING, v_x=rng.uniform(-0.3, 1.5), omega=rng.uniform(-0.5, 0.5))
    ends = np.cumsum([rng.uniform(0.5, 2.5), rng.uniform(0.8, 2.0), 2.5])

    def script(t):
        return (hop, walk, jump, Command())[int(np.searchsorted(ends, t, side="right"))]

    return Run(script, ends[-1] + 1.5)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_it_changes_gait_at_any_moment(seed):
    assert _hop_walk_jump(seed).good


def test_a_hop_that_is_to_travel_and_turn_at_once_does_not_roll_over():
    run = Run(Command(v_x=0.55, omega=-0.32, gait=Gait.HOPPING_LEFT), 3.5, since=3.0)
    assert run.good
    assert run.mean("v_x") > 0.3 and run.mean("omega") < -0.15


def test_standing_it_steps_to_catch_itself_and_stands_again():
    run = Run(Command(), 4.0, push=(0.7, 0.0, 0.0))
    assert run.good
    steps = run.table[(run.table[:, 0] > 1.0) & (run.table[:, 0] < 2.5), 7:]
    assert steps.max() > 0.1  # what a push of 0.7 m/s asks for; without a step it falls
    assert np.abs(run.table[run.table[:, 0] > 3.5, 1:4]).max() < 0.1
    assert run.table[run.table[:, 0] > 3.5, 7:].max() < 0.01


@pytest.mark.slow
def test_pushed_in_a_full_squat_it_steps_and_squats_again():
    run = Run(Command(h=-0.3), 7.0, push=(0.5, 0.0, 0.0), push_at=2.6)
    assert run.good
    assert np.abs(run.table[run.table[:, 0] > 6.5, 1:4]).max() < 0.1
    assert run.table[-1, 4] < -0.25


@pytest.mark.parametrize("push", [(1.0, 0.0, 0.0), (0.0, -0.95, 0.0)])
def test_walking_it_survives_pushes_that_ask_for_a_long_and_for_an_early_step(push):
    """The first needs a step of 0.75 m, for which the pelvis comes down; the second a foot that lands sooner."""
    run = Run(Command(v_x=0.5, gait=WALKING), 3.0, push=push)
    assert run.good


def _survived_pushes(command, seed, count):
    """How many pushes of 0.6 m/s, direction after direction of eight and 2.2 to 2.7 s apart, it stays up after."""
    rng, period, survived = np.random.default_rng(seed), 0.002, 0
    simulation, controller = Simulation(), WholeBodyController(load_robot(), period=period)
    controller.reset(simulation.reset())
    state, joints = simulation.state(), JointCommand.position(simulation.robot, simulation.robot.nominal)
    for index in range(count + 1):
        for _ in range(round(rng.uniform(2.2, 2.7) / period)):
            joints = controller.act(state, command, UpperBody.none()) or joints
            state = simulation.step(joints, period)
            if simulation.fallen:
                state = simulation.reset()
                controller.reset(state)
                break
        else:
            survived += index > 0
        angle = index * np.pi / 4.0 + state.yaw
        simulation.push(0.6 * np.array([np.cos(angle), np.sin(angle), 0.0]))
        state = simulation.state()
    return survived


@pytest.mark.slow
@pytest.mark.parametrize("command", [Command(), Command(v_x=0.3, gait=WALKING)], ids=lambda command: command.gait.label)
def test_at_least_95_percent_of_pushes_from_all_sides_are_survived(command):
    assert sum(_survived_pushes(command, seed, 16) for seed in range(2)) >= 0.95 * 32


@pytest.mark.slow
@pytest.mark.parametrize(
    "asked",
    [{"v_x": 1.2}, {"v_x": -0.6}, {"v_y": -0.6}, {"omega": -1.0}, {"f": 3.5}, {"l": 0.3}, {"p": 0.4, "w": -1.0}],
    ids=str,
)
def test_it_covers_the_command_range(asked):
    command = Command(gait=WALKING, **asked)
    run = Run(command, 6.0, since=3.0)
    assert run.good
    for name, tolerance in (("v_x", 0.08), ("v_y", 0.08), ("omega", 0.08), ("p", 0.02), ("w", 0.05)):
        assert run.mean(name) == pytest.approx(getattr(command, name), abs=tolerance)
    assert run.stride_frequency(3.0) == pytest.approx(command.f, abs=0.05)


@pytest.mark.slow
def test_it_walks_into_a_deep_squat_and_back():
    def script(t):
        if t < 1.5 or 5.0 < t < 6.5:
            return Command(v_x=0.6, gait=WALKING)
        return Command(h=-0.3, w=-1.0 if t < 3.0 else 1.0, p=0.0 if t < 3.0 else 0.4)

    run = Run(script, 9.0, since=8.5)
    assert run.good
    assert run.mean("h") == pytest.approx(-0.3, abs=0.02)
