import numpy as np

from hugwbc.kinematics import Kinematics
from hugwbc.report.clouds import hand_clouds
from hugwbc.robot import load_robot
from tests.conftest import make_state


def test_clouds_grow_from_the_nominal_hands_with_the_level():
    kinematics = Kinematics(load_robot())
    kinematics.update(make_state())
    for hand, side in zip(hand_clouds(0.0, 5), ("left", "right"), strict=True):
        np.testing.assert_allclose(hand, np.tile(kinematics.position(f"{side}_hand"), (5, 1)), atol=1e-6)
    spreads = [np.mean([hand.std(axis=0).sum() for hand in hand_clouds(level, 60)]) for level in (0.25, 0.5, 1.0)]
    assert spreads[0] < spreads[1] < spreads[2]
    left, right = hand_clouds(0.25, 60)
    assert left[:, 1].mean() > 0.2 and right[:, 1].mean() < -0.2
