import dataclasses

import numpy as np
import pytest

from hugwbc import Command, Gait, load_robot
from hugwbc.commands import default_command
from hugwbc.evaluation.plans import Knot, Schedule
from hugwbc.runtime import Simulation, load_controller, rollout
from hugwbc.runtime.braking import DECELERATION, JUMPS, LONGEST, PAUSE, SLOW, Braking
from hugwbc.runtime.loop import ControlLoop
from hugwbc.stride import MidStance
from tests.conftest import make_state

DT = 0.02
WALK = Command(v_x=1.0, omega=0.5, f=2.5, gait=Gait.WALKING)
STAND = Command(h=-0.1)
G1 = load_robot("g1")


@pytest.fixture
def state():
    """Return a state without the forces on the feet, which would tell the moment to stop in."""
    return dataclasses.replace(Simulation().reset(), foot_force=None)


def moving(state, speed):
    return dataclasses.replace(state, velocity=np.array([speed, 0.0, 0.0]))


def stop(braking, state, seconds=1.0):
    return [braking(STAND, state, DT) for _ in range(round(seconds / DT))]


def test_a_robot_that_moves_slows_down_in_its_gait(state):
    braking = Braking()
    for _ in range(50):
        assert braking(WALK, moving(state, 1.0), DT) == WALK
    commands = stop(braking, moving(state, 1.0), 2.0)
    assert all(command.gait is Gait.WALKING and command.f == WALK.f and command.h == STAND.h for command in commands)
    assert (commands[0].v_x, commands[0].omega) == pytest.approx((1.0 - 1.0 * DT, 0.5 - 2.0 * DT))
    assert commands[-1].v_x == commands[-1].omega == 0.0
    assert braking.active
    # It stands only when the robot is slow, not when the command is.
    slow = stop(braking, moving(state, 0.5 * SLOW[0]))
    assert slow[0].gait is Gait.WALKING and slow[-1] == STAND and not braking.active


def test_whole_numbers_brake_as_others_do(state):
    braking = Braking()
    braking(Command(v_x=1, v_y=0, omega=0, gait=Gait.WALKING), moving(state, 1.0), DT)
    assert braking(STAND, moving(state, 1.0), DT).v_x == pytest.approx(1.0 - DECELERATION[0] * DT)


def test_a_sway_within_a_stride_is_no_speed(state):
    braking, stride = Braking(), 1.0 / WALK.f
    for tick in range(100):
        braking(WALK, moving(state, np.sin(2.0 * np.pi * tick * DT / stride)), DT)
    assert stop(braking, moving(state, 0.0), DT)[0] == STAND


@pytest.mark.parametrize(
    ("motion", "stands"),
    [
        ({"velocity": (0.14, 0.14, 0.0)}, False),  # 0.2 m/s along the heading
        ({"velocity": (-0.1, 0.1, 0.0)}, True),
        ({"angular_velocity": (0.0, 0.0, -0.35)}, False),
        ({"angular_velocity": (0.0, 0.0, 0.25)}, True),
    ],
)
def test_it_stands_once_it_neither_moves_in_its_heading_frame_nor_turns(motion, stands):
    braking, state = Braking(), make_state(yaw=np.pi / 4, **({"velocity": np.zeros(3)} | motion))
    for _ in range(50):
        braking(WALK, state, DT)
    assert (stop(braking, state, 3.0)[-1] == STAND) is stands


def test_another_gait_begins_after_a_stop_and_a_stand_in_its_posture(state):
    braking = Braking()
    assert braking(STAND, moving(state, 1.0), DT) == STAND
    assert braking(WALK, moving(state, 1.0), DT) == WALK
    jump = dataclasses.replace(WALK, gait=Gait.JUMPING, p=0.3)
    commands = [braking(jump, moving(state, 1.0), DT) for _ in range(100)]
    assert all(command.gait is Gait.WALKING for command in commands) and braking.active
    commands = [braking(jump, moving(state, 0.0), DT) for _ in range(100)]
    stands = [command for command in commands if command.gait is Gait.STANDING]
    assert len(stands) * DT == pytest.approx(PAUSE, abs=2 * DT) and stands[0] == Command(h=jump.h, p=0.3, w=jump.w)
    assert commands[-1] == jump and not braking.active
    for _ in range(50):
        braking(jump, moving(state, 1.0), DT)
    assert braking(WALK, moving(state, 1.0), DT).gait is Gait.JUMPING
    assert braking(jump, moving(state, 1.0), DT) == jump, "back in the gait that it has, it goes on at once"


def test_a_stand_before_another_gait_has_the_defaults_of_the_robot(state):
    walk, braking = default_command(Gait.WALKING, G1), Braking(G1)
    braking(walk, moving(state, 0.0), DT)
    stop(braking, moving(state, 0.0))
    assert braking(walk, moving(state, 0.0), DT) == walk
    jump = dataclasses.replace(walk, gait=Gait.JUMPING)
    stands = [command for _ in range(100) if (command := braking(jump, moving(state, 0.0), DT)).gait is Gait.STANDING]
    assert set(stands) == {default_command(Gait.STANDING, G1)}


def test_a_leap_keeps_its_posture_while_it_stops(state):
    braking, jump = Braking(), Command(v_x=0.3, p=0.3, h=-0.1, gait=Gait.JUMPING)
    braking(jump, moving(state, 0.3), DT)
    assert all((command.p, command.h) == (0.3, -0.1) for command in stop(braking, moving(state, 0.3)))


@pytest.mark.parametrize("gait", [Gait.HOPPING_LEFT, Gait.HOPPING_RIGHT])
def test_a_hop_ends_by_jumps_on_both_legs(state, gait):
    braking, hop = Braking(), Command(v_y=0.2, h=-0.1, gait=gait)
    braking(hop, moving(state, 0.0), DT)
    commands = stop(braking, moving(state, 0.0), 2.0)
    jumps = [command for command in commands if command.gait is Gait.JUMPING]
    assert len(jumps) * DT == pytest.approx(JUMPS, abs=2 * DT) and commands[-1] == STAND
    assert {command.h for command in jumps} == {hop.h} and jumps[-1].v_y == 0.0
    # The other leg hops after jumps and a stand, and jumps go on without a stand.
    for other, gaits in ((gait.mirrored(), [Gait.JUMPING, Gait.STANDING, gait.mirrored()]), (Gait.JUMPING, [2])):
        braking = Braking()
        braking(hop, moving(state, 0.0), DT)
        asked = dataclasses.replace(hop, gait=other)
        commands = [braking(asked, moving(state, 0.0), DT) for _ in range(150)]
        assert list(dict.fromkeys(command.gait for command in commands)) == gaits and commands[-1] == asked


def test_an_unknown_velocity_is_waited_for_for_a_stride(state):
    braking, blind = Braking(), dataclasses.replace(state, velocity=None)
    for _ in range(50):
        braking(WALK, blind, DT)
    commands = stop(braking, blind, 2.0)
    first = next(index for index, command in enumerate(commands) if command == STAND)
    assert first * DT == pytest.approx(WALK.v_x / DECELERATION[0] + 1.0 / WALK.f, abs=3 * DT)


@pytest.mark.parametrize("late", [0.0, 0.1, 0.2, 0.3, 0.4])
def test_a_walk_ends_in_the_middle_of_a_stance_of_the_left_foot(state, late):
    braking, moment, stride = Braking(), MidStance(), 1.0 / WALK.f
    time = 0.0
    while True:
        force = np.zeros((2, 3))
        force[0 if time % stride < 0.5 * stride else 1, 2] = 500.0
        asked = WALK if time < 2.0 + late else STAND
        mid_stance = moment(time, force, stride)
        if braking(asked, moving(state, 0.0), DT, mid_stance=mid_stance).gait is Gait.STANDING:
            break
        time += DT
    assert 0.2 * stride <= time % stride < 0.2 * stride + 2 * DT
    assert 2.0 + late < time < 2.0 + late + WALK.v_x / DECELERATION[0] + stride + 2 * DT


def test_feet_that_do_not_take_turns_are_in_mid_stance_after_a_stride():
    moment, force = MidStance(), np.array([[0.0, 0.0, 300.0], [0.0, 0.0, 200.0]])
    told = [moment(DT * tick, force, 0.5) for tick in range(100)]
    assert all(told[round(0.5 / DT) + 1 :]) and sum(told[: round(0.5 / DT)]) == 1
    assert moment(2.0, None, 0.5), "where the forces are not known, any moment is right"


def test_a_robot_that_never_seems_slow_stands_in_the_end(state):
    braking = Braking()
    braking(WALK, moving(state, 1.0), DT)
    commands = stop(braking, moving(state, 1.0), 1.0 + LONGEST + 0.1)
    assert commands[-1] == STAND and commands[-10].gait is Gait.WALKING


SCRIPTS = {
    "a walk, then leaning jumps": (
        "learned",
        Command(v_x=1.05, gait=Gait.WALKING),
        Command(p=0.38, gait=Gait.JUMPING),
    ),
    "hops, then a stand": ("learned", Command(gait=Gait.HOPPING_LEFT), Command()),
    "hops, then the other leg": (
        "learned",
        Command(h=-0.11, gait=Gait.HOPPING_RIGHT),
        Command(omega=-0.22, gait=Gait.HOPPING_LEFT),
    ),
    "fast high steps at once": ("qp", Command(v_x=1.18, f=2.62, l=0.32, w=0.74, gait=Gait.WALKING), None),
    "a hop that is lowered and turns": (
        "qp",
        Command(gait=Gait.HOPPING_LEFT),
        Command(h=-0.18, omega=0.34, gait=Gait.HOPPING_LEFT),
    ),
    "leaning jumps, then a walk": (
        "qp",
        Command(v_x=-0.24, omega=0.17, p=0.18, gait=Gait.JUMPING),
        Command(f=2.89, w=-0.5, gait=Gait.WALKING),
    ),
    "jumps that are too fast": ("qp", Command(v_x=1.88, gait=Gait.JUMPING), None),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SCRIPTS)
def test_it_stays_up_where_a_command_at_once_made_it_fall(name):
    controller, first, then = SCRIPTS[name]
    source = Schedule((Knot(0.0, first), Knot(2.0, then or first)))
    for seed in (100, 101, 103):
        assert not rollout(controller, source, Simulation(seed=seed), duration=5.0).fell


class WalkThenStand:
    def command_at(self, t):
        return Command(v_x=1.0, gait=Gait.WALKING) if t < 2.0 else Command()

    def hands_at(self, t):
        return None


def test_the_policy_survives_a_switch_to_standing_at_1_m_s():
    """Without the brake it falls within a second, whatever the seed."""
    simulation = Simulation(seed=3)
    loop = ControlLoop(load_controller("learned"), WalkThenStand(), simulation)
    loop.reset()
    for tick in range(round(4.5 / loop.period)):
        loop.step(loop.decide(tick * loop.period), loop.period)
    assert not simulation.fallen
    assert 25 < loop.control.log.report().braked < 150
    assert np.hypot(*simulation.state().velocity[:2]) < 0.1
