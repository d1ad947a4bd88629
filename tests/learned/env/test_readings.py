import dataclasses

import torch

from hugwbc.gait import Gait
from hugwbc.learned.env.humanoid_env import HumanoidEnv
from hugwbc.learned.env.readings import has_fallen, held_foot_down


def test_inclinations_and_a_low_pelvis_are_falls_and_less_or_a_touch_of_the_trunk_is_not(small_env):
    zero = torch.zeros(8)
    pitch, roll, height = zero.clone(), zero.clone(), zero.clone()
    pitch[:2] = torch.tensor([1.01, -0.99])
    roll[2:4] = torch.tensor([-0.81, 0.79])
    height[4:6] = torch.tensor([0.44, 0.46]) - 0.98
    force = torch.full_like(small_env.readings.link_force, 30.0)
    readings = dataclasses.replace(small_env.readings, pitch=pitch, roll=roll, height=height, link_force=force)
    assert has_fallen(readings, small_env.robot).tolist() == [True, False, True, False, True, False, False, False]


def test_the_held_foot_is_the_other_one_than_hops(small_env: HumanoidEnv) -> None:
    force = torch.zeros(8, 2, 3)
    force[:4, 0, 2] = 6.0  # the left foot of the first four is on the ground, above the threshold of 5 N
    force[4:, 1, 2] = 4.0
    gait = torch.tensor([Gait.HOPPING_LEFT, Gait.HOPPING_RIGHT, Gait.WALKING, Gait.STANDING] * 2)
    readings = dataclasses.replace(small_env.readings, foot_force=force)
    assert held_foot_down(readings, gait).tolist() == [False, True] + [False] * 6
