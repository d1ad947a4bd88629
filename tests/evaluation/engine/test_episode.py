"""Episodes by plan: each with its own seed and conditions, whatever runs beside it, and its controller made once."""

import dataclasses
import functools
import threading

import numpy as np
import pytest

from hugwbc import Command, Gait
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.engine.episode import Job, controller_of, joins_batch, run_job
from hugwbc.evaluation.engine.plans import EpisodePlan
from hugwbc.runtime.controllers import HoldController, learned_controller

STAND = EpisodePlan(Command())
NOISY = Conditions(noise=True)


class _Factory:
    """Counts what it makes; equal to others of the same name, as a copy from another process is."""

    made = 0

    def __init__(self, name):
        self.name = name

    def __eq__(self, other):
        return isinstance(other, _Factory) and self.name == other.name

    def __hash__(self):
        return hash(self.name)

    def build(self):
        _Factory.made += 1
        return HoldController()


@dataclasses.dataclass(frozen=True)
class _Facts:
    index: int
    command: Command
    qpos: np.ndarray
    arm_error: float


def _judge(index, run):
    return _Facts(index, run.command, run.trace.qpos, run.arm_error)


def _run(episodes, *, seed=0, conditions=None):
    job = Job(HoldController, _judge, seed, 0.1, 0.0, conditions or Conditions(), tuple(episodes))
    rows = run_job(job)
    assert all(index == row.index for index, row in rows)
    return dict(rows)


def test_an_episode_is_the_same_whoever_runs_beside_it_and_another_with_another_seed():
    arms = Conditions(intervention="noise")
    rows = _run([(3, STAND), (4, STAND)], conditions=arms)
    third, fourth = (_run([(index, STAND)], conditions=arms)[index] for index in (3, 4))
    assert np.array_equal(rows[3].qpos, third.qpos) and np.array_equal(rows[4].qpos, fourth.qpos)
    other = _run([(3, STAND)], seed=1, conditions=arms)[3]
    assert not np.array_equal(third.qpos, fourth.qpos) and not np.array_equal(third.qpos, other.qpos)
    drawn = _run([(9, dataclasses.replace(STAND, draw=3))], conditions=arms)[9]
    assert np.array_equal(drawn.qpos, third.qpos), "a plan with a draw has that in place of its index"


def test_the_arms_error_is_known_where_something_moves_them():
    assert np.isnan(_run([(0, STAND)])[0].arm_error)
    assert 0.0 < _run([(0, STAND)], conditions=Conditions(intervention="noise"))[0].arm_error < 1.0


def test_a_plans_own_conditions_go_before_the_jobs():
    own = dataclasses.replace(STAND, conditions=Conditions(payload=30.0))
    rows = _run([(0, STAND), (1, own)])
    assert not np.array_equal(rows[0].qpos, rows[1].qpos)


def test_a_controller_is_made_once_for_equal_factories_in_each_thread():
    _Factory.made = 0
    first = controller_of(_Factory("a").build)
    assert controller_of(_Factory("a").build) is first, "a bound method of an equal object is the same factory"
    assert controller_of(_Factory("b").build) is not first and _Factory.made == 2
    others = []
    thread = threading.Thread(target=lambda: others.append(controller_of(_Factory("b").build)))
    thread.start()
    thread.join()
    assert _Factory.made == 3 and others[0] is not controller_of(_Factory("b").build)
    assert controller_of(functools.partial(HoldController)) is not controller_of(HoldController)


@pytest.mark.parametrize(("conditions", "timed", "joins"), [
    (Conditions(), False, True),
    (Conditions(), True, False),
    (NOISY, False, False),
    (Conditions(terrain_roughness=0.02), False, False),
])  # fmt: skip
def test_what_shares_a_batch(conditions, timed, joins):
    plan = EpisodePlan(Command(gait=Gait.WALKING), timed=timed)
    assert joins_batch(learned_controller(), conditions, plan) is joins
    assert joins_batch(learned_controller(), NOISY, dataclasses.replace(plan, conditions=conditions)) is joins
    assert not joins_batch(HoldController(), conditions, plan), "no policy"
