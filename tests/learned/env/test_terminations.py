import dataclasses

import torch

from hugwbc.gait import Gait
from hugwbc.learned.env.humanoid_env import HumanoidEnv
from hugwbc.learned.env.terminations import FeetRule, fallen, held_foot_down


def test_inclinations_and_a_low_pelvis_are_falls_and_less_or_a_touch_of_the_trunk_is_not(small_env):
    zero = torch.zeros(8)
    pitch, roll, height = zero.clone(), zero.clone(), zero.clone()
    pitch[:2] = torch.tensor([1.01, -0.99])
    roll[2:4] = torch.tensor([-0.81, 0.79])
    height[4:6] = torch.tensor([0.44, 0.46]) - 0.98
    force = torch.full_like(small_env.readings.link_force, 30.0)
    readings = dataclasses.replace(small_env.readings, pitch=pitch, roll=roll, height=height, link_force=force)
    assert fallen(readings, small_env.robot).tolist() == [True, False, True, False, True, False, False, False]


def test_the_held_foot_is_the_other_one_than_hops(small_env: HumanoidEnv) -> None:
    force = torch.zeros(8, 2, 3)
    force[:4, 0, 2] = 6.0  # the left foot of the first four is on the ground, above the threshold of 5 N
    force[4:, 1, 2] = 4.0
    gait = torch.tensor([Gait.HOPPING_LEFT, Gait.HOPPING_RIGHT, Gait.WALKING, Gait.STANDING] * 2)
    readings = dataclasses.replace(small_env.readings, foot_force=force)
    assert held_foot_down(readings, gait).tolist() == [False, True] + [False] * 6


def test_a_held_foot_may_brush_the_ground_and_has_time_after_a_command(small_env: HumanoidEnv) -> None:
    gait = torch.full((8,), int(Gait.HOPPING_LEFT))
    rule, robots = FeetRule(8, grace=0.39, dt=0.02), torch.arange(8)
    rule.restart(robots[:4], torch.zeros(4))
    rule.restart(robots[4:], torch.zeros(4), in_motion=True)
    broken = []
    for step in range(1, 31):
        force = torch.zeros(8, 2, 3)
        down = robots % 4 == 1  # all the time
        down |= (robots % 4 == 2) & (step % 4 != 0)  # for 0.06 s, again and again
        down |= (robots % 4 == 3) & (step < 15)  # until 0.3 s
        force[down, 1, 2] = 50.0
        readings = dataclasses.replace(small_env.readings, foot_force=force)
        broken.append(rule.broken(held_foot_down(readings, gait), torch.full((8,), step)))
    first = torch.where(torch.stack(broken).any(0), torch.stack(broken).int().argmax(0) + 1, 0)
    assert first.tolist() == [0, 20, 0, 0, 0, 4, 0, 4]
    again = FeetRule(8, grace=0.4, dt=0.02)
    again.load_state_dict(rule.state_dict())
    torch.testing.assert_close(again.due, rule.due)
    torch.testing.assert_close(again.down, rule.down)
