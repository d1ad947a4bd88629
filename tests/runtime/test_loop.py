"""The control loop's joints: commands that stay within the limits, and times of what is really called."""

import dataclasses

import numpy as np
import pytest

from hugwbc import Command, load_robot, rotations
from hugwbc.commands import default_command
from hugwbc.controller import JointCommand, UpperBody, override_arms
from hugwbc.errors import CommandError, ConfigError
from hugwbc.gait import Gait
from hugwbc.runtime.controllers import HoldController
from hugwbc.runtime.estimation import StateEstimator
from hugwbc.runtime.loop import ControlLoop, substeps_of, world_targets
from hugwbc.scripts.view import Constant
from hugwbc.sim import SensorProfile, Simulation
from hugwbc.state import RobotState
from hugwbc.targets import HandTargets
from hugwbc.upper_ik import UpperBodySource

ROBOT = load_robot()
TAKEN = 10  # ticks


class _Taken:
    """External arm targets at the joints' upper limits for a while, then none."""

    solution = None

    def __init__(self):
        self.ticks = 0

    def reset(self):
        self.ticks = 0

    def update(self, state, hands, command, dt, commanded=None, followed=None):
        self.ticks += 1
        taken = self.ticks <= TAKEN
        return (UpperBody.targets(ROBOT.upper[ROBOT.arms]) if taken else UpperBody.none()), command


class _Swinging(HoldController):
    """Its own arms are at their lower limits when they are handed back, and at their upper limits ever after."""

    ticks = 0

    def act(self, state, command, upper_body):
        self.ticks += 1
        q = ROBOT.nominal.copy()
        q[ROBOT.arms] = (ROBOT.lower if self.ticks <= TAKEN + 1 else ROBOT.upper)[ROBOT.arms]
        return override_arms(JointCommand.position(ROBOT, q), upper_body, ROBOT)


def test_what_fades_after_a_hand_back_does_not_push_the_arms_beyond_the_limits():
    loop = ControlLoop(_Swinging(load_robot()), Constant(Command()), Simulation(sensing="exact"), _Taken())
    loop.reset()
    commands = np.array([loop.decide(tick * loop.period).q[ROBOT.arms] for tick in range(40)])
    low, high = (limit[ROBOT.arms] for limit in ROBOT.target_range)
    assert commands[TAKEN] == pytest.approx(ROBOT.upper[ROBOT.arms]), "no jump at the hand-back"
    # Own command and what fades add up to almost twice the joints' range.
    assert commands[TAKEN + 1] == pytest.approx(high)
    assert np.all(commands >= low) and np.all(commands <= high)
    assert commands[-1] == pytest.approx(ROBOT.upper[ROBOT.arms])
    assert loop.control.log.report().positions_limited > 0


def test_a_controller_reads_the_estimate_where_there_is_an_estimator():
    """The sensors do not know where the robot is; the true state does."""

    class Seeing(HoldController):
        def act(self, state, command, upper_body):
            self.seen = state
            return super().act(state, command, upper_body)

    controller, simulation = Seeing(load_robot()), Simulation(sensing="exact")
    loop = ControlLoop(controller, Constant(Command()), simulation, estimator=StateEstimator(load_robot()))
    loop.reset()
    for tick in range(5):
        loop.step(loop.decide(tick * loop.period), loop.period)
    true = simulation.state()
    assert true.time == pytest.approx(5 * loop.period) and true.position is not None
    loop.decide(5 * loop.period)
    assert controller.seen.position == pytest.approx(true.position, abs=0.02)
    assert np.abs(controller.seen.position - true.position).max() > 0.0, "an estimate, not the truth"


@pytest.mark.parametrize("period", [0.004, 0.012, 0.02, 0.026])
def test_a_controller_of_any_period_gets_an_estimate_of_now(period):
    controller = HoldController(ROBOT)
    controller.period = period
    loop = ControlLoop(controller, Command(), Simulation(sensing=SensorProfile("clean")))
    loop.reset()
    for tick in range(6):
        assert loop.control.estimate.time == pytest.approx(tick * period)
        loop.step(loop.decide(tick * period), period)


def test_hand_targets_of_every_frame_in_the_world():
    """Turned left by 90 degrees and pitched down by 90: the pelvis looks down, with its top ahead, to the left.

    The frame of its heading does not lean with it.
    """
    half = np.sqrt(0.5)
    yaw, pitch = np.array([half, 0.0, 0.0, half]), np.array([half, 0.0, half, 0.0])
    product = np.zeros(4)
    product[0] = yaw[0] * pitch[0] - yaw[1:] @ pitch[1:]
    product[1:] = yaw[0] * pitch[1:] + pitch[0] * yaw[1:] + np.cross(yaw[1:], pitch[1:])
    position = np.array([1.0, 2.0, 0.9])
    tilted = RobotState(ROBOT.nominal, np.zeros(19), product, np.zeros(3), position=position)
    lean = rotations.from_yaw_pitch_roll(np.pi / 2.0, 0.3, 0.0)
    leaning = RobotState(ROBOT.nominal, np.zeros(19), lean, np.zeros(3), position=position)
    point = (0.3, 0.0, 0.1)
    pelvis, heading, world = (HandTargets.of(point, None, frame) for frame in ("pelvis", "heading", "world"))
    assert world_targets(pelvis, tilted)[0] == pytest.approx([1.0, 2.1, 0.6])
    assert world_targets(heading, leaning)[0] == pytest.approx([1.0, 2.3, 1.0])
    assert world_targets(world, tilted)[0] == pytest.approx(point)
    assert np.isnan(world_targets(pelvis, tilted)[1]).all() and np.isnan(world_targets(None, tilted)).all()


def test_a_period_that_no_number_of_physics_steps_fills_is_refused():
    assert substeps_of(0.02, 0.002, "x") == 10
    with pytest.raises(ConfigError, match=r"controller 'x' is 0\.003 s"):
        substeps_of(0.003, 0.002, "x")


def test_the_body_stays_for_a_lost_target_and_comes_back_when_the_stream_of_targets_has_ended():
    low = HandTargets.of((0.45, 0.2, 0.5), (0.45, -0.2, 0.5), "world", whole_body=True)

    class Stream:
        """Sends new targets in every tick of the first second, then none."""

        hands = low

        def command_at(self, t):
            return Command()

        def hands_at(self, t):
            if t < 1.0:
                self.hands = dataclasses.replace(low, stamp=t)
            lost = dataclasses.replace(low, left=np.full(3, np.nan))
            return lost if 0.7 < t < 0.8 else self.hands

    source = UpperBodySource(load_robot())
    loop = ControlLoop(HoldController(load_robot()), Stream(), Simulation(sensing="exact"), source)
    loop.reset()
    heights = []
    for tick in range(round(4.0 / loop.period)):
        loop.decide(tick * loop.period)
        heights.append(loop.control.chain.command.h)
        loop.simulation.data.time += loop.period  # the robot stays as it is: this is about commands
    second = round(1.0 / loop.period)
    assert heights[second] < -0.1
    assert np.all(np.diff(heights[: second + 1]) <= 1e-9), "no way back for targets that are not usable for a snapshot"
    assert heights[-1] == 0.0, "the request has ended"


class _Stubborn:
    """A source that walks for five ticks, and then does as it is told."""

    def __init__(self, command=None, hands=None):
        self.command, self.hands, self.asked = command, hands, 0

    def command_at(self, t):
        self.asked += 1
        return Command(v_x=0.3, gait=Gait.WALKING) if self.asked <= 5 or self.command is None else self.command()

    def hands_at(self, t):
        return None if self.asked <= 5 or self.hands is None else self.hands()


def _raise(error):
    raise error


@pytest.mark.parametrize(
    ("what", "words"),
    [
        ({"command": lambda: None}, "the source raised TypeError: it gave a NoneType"),
        ({"command": lambda: _raise(RuntimeError("gone"))}, "the source raised RuntimeError: gone"),
        ({"command": lambda: Command(v_x=10**400)}, "the source raised CommandError"),
        ({"command": lambda: Command(v_x=0.3, gait=b"walking")}, "unknown gait"),
        ({"hands": lambda: 1 / 0}, "the source raised ZeroDivisionError"),
        ({"hands": lambda: (0.3, 0.2, 0.1)}, "and a tuple instead of a Command, and HandTargets or None"),
    ],
)
def test_a_source_that_raises_or_gives_something_else_leads_to_a_stand_and_is_told(what, words):
    robot = load_robot("g1")
    simulation = Simulation(sensing="exact", robot=robot)
    loop = ControlLoop(HoldController(robot), _Stubborn(**what), simulation, UpperBodySource(robot))
    loop.reset()
    commands = []
    for tick in range(60):
        assert loop.decide(tick * loop.period).is_finite
        commands.append(loop.control.chain.command)
    assert all(command.gait is Gait.WALKING for command in commands[:25]), "half a second of the last command"
    assert commands[-1] == default_command(Gait.STANDING, robot) != Command()
    report = loop.control.log.report()
    assert report.source_failures == 55 and report.failures == 0 and any(words in m for m in report.messages)


def test_hand_targets_of_two_numbers_move_no_arm_and_can_be_shown():
    hands = HandTargets((0.3, 0.2), [0.3, -0.2, 0.1])  # type: ignore[arg-type]
    loop = ControlLoop(
        HoldController(load_robot()),
        Constant(Command(), hands),
        Simulation(sensing="exact"),
        UpperBodySource(load_robot()),
    )
    loop.reset()
    for tick in range(3):
        assert loop.decide(tick * loop.period).q == pytest.approx(ROBOT.nominal)
        assert np.isnan(loop.snapshot().hand_target_world[0]).all()


class _Unruly(HoldController):
    """A controller whose plans cannot be read."""

    phase = property(lambda self: _raise(RuntimeError("no clock")))
    footholds = property(lambda self: [[0.1, 0.2]])
    planned_acceleration = property(lambda self: _raise(CommandError("no plan")))


def test_plans_that_raise_or_have_another_form_are_none_and_are_told():
    loop = ControlLoop(_Unruly(load_robot()), Constant(Command()), Simulation())
    loop.reset()
    loop.step(loop.decide(0.0), loop.period)
    snapshot = loop.snapshot()
    assert np.isnan(snapshot.phase) and snapshot.foothold.shape == (2, 2) and np.isnan(snapshot.foothold).all()
    assert loop.control.log.report().failures > 0
    assert loop.control.log.report().messages[0].startswith("planned_acceleration of hold raised CommandError: no plan")


def test_hands_that_become_soft_during_the_takeover_never_have_negative_stiffness():
    """The public way: hand targets, and a tenth of a second later the same with a stiffness of 50 N/m."""

    class Softer(Constant):
        def hands_at(self, t):
            return HandTargets.of((0.3, 0.3, 0.1), (0.3, -0.3, 0.1), stiffness=50.0 if t >= 0.1 else None)

    loop = ControlLoop(
        HoldController(load_robot()), Softer(Command()), Simulation(sensing="exact"), UpperBodySource(load_robot())
    )
    loop.reset()
    least = min(loop.decide(tick * loop.period).kp.min() for tick in range(40))
    assert 0.0 < least < 20.0 and loop.control.log.report().gains_limited == 0


@pytest.mark.parametrize("sensing", ["exact", "robot"])
def test_a_decision_before_the_run_has_begun_is_refused(sensing):
    loop = ControlLoop(HoldController(load_robot()), Command(), Simulation(sensing=sensing))
    with pytest.raises(ConfigError, match="call reset of the loop first"):
        loop.decide(0.0)
    loop.reset()
    assert loop.decide(0.0).is_finite
