import dataclasses
import math

import pytest
import torch

from hugwbc.commands import COMMAND_NAMES
from hugwbc.gait import Gait
from hugwbc.learned.config import CommandConfig, EnvConfig, TerrainConfig
from hugwbc.learned.env.humanoid_env import HumanoidEnv
from hugwbc.learned.env.readings import Readings
from hugwbc.learned.policy import load_policy
from hugwbc.learned.policy.networks import Actor
from hugwbc.learned.rl.evaluator import FALL_COST, Evaluator, _Steps


def still_actor() -> Actor:
    actor = Actor(63, 18, 19)
    for parameter in actor.policy[-1].parameters():
        torch.nn.init.zeros_(parameter)
    return actor


@pytest.fixture(scope="module")
def evaluator() -> Evaluator:
    return Evaluator(EnvConfig(), count=12, seconds=2.0, threads=1, timestep=0.005)


def test_equal_policies_get_equal_figures(evaluator: Evaluator) -> None:
    actor = load_policy("h1").actor
    first = evaluator.run(actor)
    other = evaluator.run(still_actor())
    assert evaluator.run(actor) == first
    assert list(first) == evaluator.names
    assert first["evaluation/score"] < other["evaluation/score"]


def test_the_shipped_policy_stays_up_after_nearly_all_random_starts() -> None:
    contract = load_policy().contract
    config = EnvConfig(squat_gain=contract.squat_gain, swing_gain=contract.swing_gain)
    figures = Evaluator(config, count=96, seconds=2.0, threads=1, timestep=0.005).run(load_policy("h1").actor)
    assert figures["evaluation/falls"] <= 0.08


def test_it_takes_over_the_gains_and_keeps_the_control_period() -> None:
    config = EnvConfig(substeps=3, squat_gain=0.4, swing_gain=1.0)
    evaluator = Evaluator(config, count=2, seconds=0.1, threads=1, timestep=0.002)
    evaluator.adopt(dataclasses.replace(config, squat_gain=1.2, swing_gain=0.5))
    now = evaluator._env.config
    assert (now.squat_gain, now.swing_gain) == (1.2, 0.5) and now.period == pytest.approx(config.period)
    assert now.timestep <= 0.002


def test_score_by_hand(evaluator: Evaluator) -> None:
    # Two of three gaits have samples; the third's robots fell before any could be taken.
    gait = torch.tensor([0, 0, 1, 2])
    sums = torch.zeros(4, 6)
    sums[0, 0], sums[1, 0] = 3.0, 1.0  # v_x of the standing robots: 4 / 20 = 0.2, twice its scale
    sums[2] = torch.tensor([0.1, 0.1, 0.1, 0.05, 0.05, 0.05]) * 10  # walking: every error is its scale
    figures = evaluator._figures(gait, sums, torch.tensor([10.0, 10.0, 10.0, 0.0]), 0.25, {})
    assert figures["evaluation/standing/v_x"] == pytest.approx(0.2)
    assert math.isnan(figures["evaluation/jumping/h"])
    assert figures["evaluation/score"] == pytest.approx(FALL_COST * 0.25 + (2.0 / 6.0 + 1.0) / 2.0)


def test_errors_are_those_of_a_robot_that_stands_as_told() -> None:
    standing = CommandConfig(standing_fraction=1.0, walking_fraction=0.0, default_fraction=1.0)
    figures = Evaluator(EnvConfig(command=standing), count=4, seconds=2.0, threads=1, timestep=0.005).run(
        load_policy("h1").actor
    )
    assert figures["evaluation/falls"] == 0.0
    assert 0.0 < figures["evaluation/standing/v_x"] < 0.1
    assert figures["evaluation/standing/h"] < 0.1


def test_a_policy_for_rough_ground_is_judged_on_all_levels() -> None:
    terrain = TerrainConfig(roughness=0.02, levels=4)
    ground = Evaluator(EnvConfig(terrain=terrain), count=8, seconds=0.1, threads=1, timestep=0.005)._env.ground
    assert ground is not None and torch.bincount(ground.level).tolist() == [2] * 4


def readings_of(env: HumanoidEnv, height: float, speed: float) -> Readings:
    """Both soles of all robots at a height [m], on the ground at 0, moving upwards at a speed [m/s]."""
    zero = torch.zeros_like(env.readings.foot_velocity)
    velocity, force = zero.clone(), zero.clone()
    velocity[..., 2] = speed
    force[..., 2] = 300.0 * (height == 0.0)
    clearance = torch.full_like(env.readings.clearance, height)
    return dataclasses.replace(env.readings, foot_velocity=velocity, foot_force=force, clearance=clearance)


def test_steps_by_hand(evaluator: Evaluator) -> None:
    """A jump at 2.5 Hz, 0.12 m high, that comes down at 1.5 m/s; told 2 Hz and 0.15 m."""
    env, count = evaluator._env, 12
    gait = torch.full((count,), int(Gait.JUMPING))
    gait[:4] = int(Gait.HOPPING_LEFT)
    gait[4:6] = int(Gait.STANDING)
    command = torch.zeros(count, 8)
    command[:, COMMAND_NAMES.index("f")], command[:, COMMAND_NAMES.index("l")] = 2.0, 0.15
    steps, upright = _Steps(command, gait, 0.02), torch.ones(count, dtype=torch.bool)
    upright[11] = False  # it has fallen and no longer counts
    cycle = [(0.0, 0.0)] * 10 + [(0.05, 1.0), (0.1, 1.0), (0.12, 0.0), (0.1, -1.0)] + [(0.05, -1.5)] * 6
    for height, speed in [*cycle * 3, (0.0, 0.0)]:
        steps.add(readings_of(env, height, speed), upright)
    jumping = gait == int(Gait.JUMPING)
    jumping[11] = False
    figures = steps.errors(jumping)
    assert figures["f"] == pytest.approx(0.5, abs=1e-4) and "held_foot" not in figures
    assert figures["l"] == pytest.approx(0.03, abs=1e-4) and figures["impact"] == pytest.approx(1.5)
    hopping = steps.errors(gait == int(Gait.HOPPING_LEFT))
    assert hopping["f"] == pytest.approx(0.5, abs=1e-4)
    assert hopping["held_foot"] == pytest.approx(31 / 61)  # it touches the ground as often as the other
    assert steps.errors(gait == int(Gait.STANDING)) == {}
    fallen = steps.errors(~upright)
    assert fallen["f"] == 2.0 and fallen["l"] == pytest.approx(0.15)  # without a stride both are wrong altogether


def walk(evaluator: Evaluator, landings: list[float], seconds: float) -> dict[str, float]:
    """Return the errors of walks, told 2 Hz and 0.15 m, whose soles come down from 0.12 m at some times [s]."""
    env, count = evaluator._env, 12
    command = torch.zeros(count, 8)
    command[:, COMMAND_NAMES.index("f")], command[:, COMMAND_NAMES.index("l")] = 2.0, 0.15
    steps = _Steps(command, torch.full((count,), int(Gait.WALKING)), 0.02)
    downs = {round(time / 0.02) for time in landings}
    for step in range(1, round(seconds / 0.02) + 1):
        flies = any(step + ahead in downs for ahead in range(1, 6))
        steps.add(readings_of(env, 0.12 if flies else 0.0, 0.0), torch.ones(count, dtype=torch.bool))
    return steps.errors(torch.ones(count, dtype=torch.bool))


def test_cycles_that_a_foot_misses_count_as_in_the_arena(evaluator: Evaluator) -> None:
    # 6.6 periods after the last step: five cycles without a touch-down, besides the one with 2 Hz.
    shuffles = walk(evaluator, [0.2, 0.7], 4.0)
    assert shuffles["f"] == pytest.approx(5 * 2.0 / 6, abs=1e-4)
    assert shuffles["l"] == pytest.approx((2 * 0.03 + 5 * 0.15) / 7, abs=1e-4)
    # Steps of 1 Hz are slow and miss nothing.
    slow = walk(evaluator, [0.9, 1.9, 2.9, 3.9], 4.0)
    assert slow["f"] == pytest.approx(1.0, abs=1e-4) and slow["l"] == pytest.approx(0.03, abs=1e-4)
    still = walk(evaluator, [], 4.0)
    assert still["f"] == 2.0 and still["l"] == pytest.approx(0.15)
