import dataclasses

import numpy as np
import pytest

from hugwbc import Command, Gait, load_robot
from hugwbc.mbc.command_filter import CommandFilter
from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.feet import Ground
from hugwbc.mbc.gait_plan import GaitPlan, Mode
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.reach import highest_lift
from hugwbc.mbc.references import References, Tick
from hugwbc.mbc.tasks import SwingFootTask
from hugwbc.mbc.walking import Walking
from hugwbc.state import GRAVITY

PARAMS, DT = ControllerParams(), 0.002


class Step:
    """The first step of a walk in place, of the left foot, by the clock alone: the robot's state is given."""

    def __init__(self, state):
        self.plan, self.ground, self.dynamics = GaitPlan(), Ground(), Dynamics(load_robot())
        self.references = References(PARAMS, self.plan, self.ground)
        self.walking = Walking(PARAMS, self.plan, self.references, self.ground)
        self.task = SwingFootTask(PARAMS, "left", load_robot())
        self.smooth = CommandFilter(PARAMS, load_robot()).update(Command(gait=Gait.WALKING), DT)
        self.dynamics.update(state)
        self.references.reset(self.dynamics)
        while self.plan.mode is not Mode.WALKING:
            self.plan.advance(Gait.WALKING, 2.0, DT, may_start=True, may_stop=False)
        self.walking.lift_off(self.dynamics)

    def go_on(self, state, seconds):
        """Returns the foothold, relative to the sole of the right foot, after so much of the step."""
        self.dynamics.update(state)
        for _ in range(round(seconds / DT)):
            self.walking.watch_landing(self.dynamics)
            landed = self.walking.loaded
            self.plan.advance(Gait.WALKING, 2.0, DT, may_start=True, may_stop=False, landed=landed)
            self.references.update(self.dynamics, self.smooth, DT)
            foothold = self.walking.update(Tick(self.dynamics, self.smooth, self.smooth.velocity, DT), self.task)
        return foothold - self.dynamics.frame("right_sole").position[:2]


@pytest.fixture
def lifted(standing_state):
    """The left foot 5 cm in the air: its knee bent."""
    q = standing_state.q.copy()
    q[[2, 3, 4]] += [-0.25, 0.5, -0.25]
    return dataclasses.replace(standing_state, q=q)


def test_a_foot_lands_once_it_is_down_late_in_the_step(standing_state, lifted):
    step = Step(standing_state)
    step.go_on(standing_state, 0.1)
    assert not step.walking.landed, "it has only just left the ground"
    step.go_on(lifted, 0.08)
    assert not step.walking.landed
    step.go_on(standing_state, 0.01)
    assert step.walking.landed and step.walking.loaded
    step.walking.lift_off(step.dynamics)
    assert not step.walking.landed


def test_with_foot_forces_a_foot_stands_by_its_height_but_carries_by_its_load(standing_state, lifted):
    def pressed(state, load):
        return dataclasses.replace(state, foot_force=np.array([[0.0, 0.0, load], [0.0, 0.0, 500.0]]))

    step = Step(pressed(standing_state, 0.0))
    step.go_on(pressed(lifted, 0.0), 0.18)
    step.go_on(pressed(standing_state, 0.0), 0.04)
    assert (step.walking.landed, step.walking.loaded) == (True, False)
    step.go_on(pressed(standing_state, 0.0), 0.06)
    assert step.plan.overdue > 0.0 and not step.walking.landed, "the ground is lower than it was thought to be"
    assert step.task.velocity[2] == pytest.approx(-PARAMS.search_speed, rel=0.5)
    step.go_on(pressed(standing_state, 30.0), DT)
    assert not step.walking.loaded, "that much is noise of an inferred force"
    step.go_on(pressed(standing_state, 0.3 * step.dynamics.mass * GRAVITY), DT)
    assert (step.walking.landed, step.walking.loaded) == (True, True)


def test_pushed_outwards_it_steps_further_and_sooner(standing_state, lifted):
    calm, pushed = Step(standing_state), Step(standing_state)
    moving = dataclasses.replace(lifted, velocity=np.array([0.0, 1.5, 0.0]))
    assert 0.15 < calm.go_on(lifted, 0.02)[1] < pushed.go_on(moving, 0.02)[1]
    assert pushed.plan.duration < calm.plan.duration == pytest.approx(0.25)
    assert calm.walking.out_of_reach == 0 and pushed.walking.out_of_reach == 10
    assert pushed.references.crouch.depth > calm.references.crouch.depth == 0.0


def test_a_long_step_stays_low(standing_state):
    """The knee's speed goes into the reach: 5 cm for the longest step, the commanded 15 cm up to 0.4 m."""
    heights, lengths = [], []
    for speed in (0.0, 3.0):
        state = dataclasses.replace(standing_state, velocity=np.array([speed, 0.0, 0.0]))
        step = Step(state)
        ground = step.dynamics.frame("left_sole").position[2]
        lengths.append(np.hypot(*step.go_on(state, 0.124)))
        heights.append(step.walking.trajectory.position[2] - ground)
    assert lengths[0] < PARAMS.long_step and heights[0] == pytest.approx(0.15, abs=0.005)
    assert lengths[1] > PARAMS.max_step[1]
    assert heights[1] == pytest.approx(0.05, abs=0.005)


def test_a_step_after_one_that_ended_late_lifts_its_foot_less(standing_state):
    """The clock has run on by 70 of 250 ms: the foot rises for 90 ms instead of 125 ms, and lands on time."""
    heights = []
    for late in (0.0, 0.07):
        step = Step(standing_state)
        step.smooth = step.smooth._replace(l=0.3)
        for _ in range(round(late / DT)):
            step.plan.advance(Gait.WALKING, 2.0, DT, may_start=True, may_stop=False)
        step.walking.lift_off(step.dynamics)
        ground = step.walking.trajectory.position[2]
        path = []
        for _ in range(round((0.25 - late) / DT) - 1):
            step.go_on(standing_state, DT)
            path.append(step.walking.trajectory.position[2] - ground)
        heights.append(max(path))
        assert path[-1] == pytest.approx(0.0, abs=0.003)
    lift = highest_lift(PARAMS, 0.0, 0.5 / 0.18, step.dynamics.robot)
    assert heights == pytest.approx([0.3, lift], abs=0.004)
    assert lift < 0.16
