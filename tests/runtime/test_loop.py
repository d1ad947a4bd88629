"""The control loop's joints: commands that stay within the limits, and times of what is really called."""

import dataclasses

import numpy as np
import pytest

from hugwbc import Command, load_robot
from hugwbc.controller import JointCommand, UpperBody, override_arms
from hugwbc.errors import ConfigError
from hugwbc.runtime.controllers import HoldController
from hugwbc.runtime.estimation import StateEstimator
from hugwbc.runtime.loop import ControlLoop, substeps_of, world_targets
from hugwbc.runtime.safety import target_limits
from hugwbc.scripts.command_source import Constant
from hugwbc.sim import Simulation
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

    def update(self, state, hands, command, dt, commanded=None):
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
    loop = ControlLoop(_Swinging(), Constant(Command()), Simulation(sensing="exact"), _Taken())
    loop.reset()
    commands = np.array([loop.decide(tick * loop.period).q[ROBOT.arms] for tick in range(40)])
    low, high = (limit[ROBOT.arms] for limit in target_limits(ROBOT))
    assert commands[TAKEN] == pytest.approx(ROBOT.upper[ROBOT.arms]), "no jump at the hand-back"
    # Own command and what fades add up to almost twice the joints' range.
    assert commands[TAKEN + 1] == pytest.approx(high)
    assert np.all(commands >= low) and np.all(commands <= high)
    assert commands[-1] == pytest.approx(ROBOT.upper[ROBOT.arms])
    assert loop.safe.report().positions_limited > 0


def test_the_filter_is_not_asked_twice_where_nothing_fades():
    loop = ControlLoop(_Swinging(), Constant(Command()), Simulation(sensing="exact"))
    loop.reset()
    for tick in range(3):
        loop.decide(tick * loop.period)
    assert loop.safe.report().positions_limited == 0 and loop.safe.report().ticks == 3


def test_a_controller_reads_the_estimate_where_there_is_an_estimator():
    """The sensors do not know where the robot is; the true state does."""

    class Seeing(HoldController):
        def act(self, state, command, upper_body):
            self.seen = state
            return super().act(state, command, upper_body)

    controller, simulation = Seeing(), Simulation(sensing="exact")
    loop = ControlLoop(controller, Constant(Command()), simulation, estimator=StateEstimator())
    loop.reset()
    for tick in range(5):
        loop.step(loop.decide(tick * loop.period), loop.period)
    true = simulation.state()
    assert true.time == pytest.approx(5 * loop.period) and true.position is not None
    loop.decide(5 * loop.period)
    assert controller.seen.position == pytest.approx(true.position, abs=0.02)
    assert np.abs(controller.seen.position - true.position).max() > 0.0, "an estimate, not the truth"


def test_hand_targets_of_every_frame_in_the_world():
    """Turned left by 90 degrees and pitched down by 90: the pelvis looks down, with its top ahead, to the left."""
    half = np.sqrt(0.5)
    yaw, pitch = np.array([half, 0.0, 0.0, half]), np.array([half, 0.0, half, 0.0])
    product = np.zeros(4)
    product[0] = yaw[0] * pitch[0] - yaw[1:] @ pitch[1:]
    product[1:] = yaw[0] * pitch[1:] + pitch[0] * yaw[1:] + np.cross(yaw[1:], pitch[1:])
    position = np.array([1.0, 2.0, 0.9])
    tilted = RobotState(ROBOT.nominal, np.zeros(19), product, np.zeros(3), position=position)
    upright = RobotState(ROBOT.nominal, np.zeros(19), yaw, np.zeros(3), position=position)
    point = (0.3, 0.0, 0.1)
    pelvis, heading, world = (HandTargets.of(point, None, frame) for frame in ("pelvis", "heading", "world"))
    assert world_targets(pelvis, tilted)[0] == pytest.approx([1.0, 2.1, 0.6])
    assert world_targets(heading, upright)[0] == pytest.approx([1.0, 2.3, 1.0])
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

    source = UpperBodySource()
    loop = ControlLoop(HoldController(), Stream(), Simulation(sensing="exact"), source)
    loop.reset()
    heights = []
    for tick in range(round(4.0 / loop.period)):
        loop.decide(tick * loop.period)
        heights.append(loop.safe.command.h)
        loop.simulation.data.time += loop.period  # the robot stays as it is: this is about commands
    second = round(1.0 / loop.period)
    assert heights[second] < -0.1
    assert np.all(np.diff(heights[: second + 1]) <= 1e-9), "no way back for targets that are not usable for a moment"
    assert heights[-1] == 0.0, "the request has ended"
