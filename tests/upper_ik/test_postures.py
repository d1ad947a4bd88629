import numpy as np
import pytest

from hugwbc import rotations
from hugwbc.robot import load_robot
from hugwbc.upper_ik import ArmIK
from hugwbc.upper_ik.postures import SEEDS, posture_table


def test_the_table_holds_free_postures_and_where_they_put_the_hand():
    ik, table = ArmIK(), posture_table()
    for index in range(0, len(table.q), 100):
        q = np.concatenate((table.q[index], np.zeros(4)))
        assert ik.hands(q, 0.0)[0] == pytest.approx(table.hands[index], abs=1e-9)
        assert ik.clearance(q)[0] > 0.01
        assert np.all((q >= ik.lower) & (q <= ik.upper))


@pytest.mark.parametrize("arm", [0, 1])
def test_candidates_put_the_hand_near_the_point_on_a_turned_waist_too(arm):
    ik, waist = ArmIK(), 0.7
    point = rotations.rotation_z(waist) @ np.array([0.3, -0.3 if arm else 0.3, 0.2])
    candidates = posture_table().candidates(arm, point, waist, np.zeros(4), 3)
    for posture in candidates:
        q = np.zeros(8)
        q[4 * arm : 4 * arm + 4] = posture
        assert np.linalg.norm(ik.hands(q, waist)[arm] - point) < 0.15
    for first, second in ((0, 1), (0, 2), (1, 2)):
        assert np.abs(candidates[first] - candidates[second]).max() >= 0.8, "three of another kind each"


def test_of_postures_alike_the_nearest_to_the_arm_comes_first():
    table = posture_table()
    for index in range(0, len(table.q), 250):
        first = table.candidates(0, table.hands[index], 0.0, table.q[index], 1)[0]
        assert first == pytest.approx(table.q[index])


def test_known_postures_touch_nothing_and_are_mirror_images():
    ik, robot = ArmIK(), load_robot()
    for left, right in zip(*SEEDS, strict=True):
        q = np.concatenate((left, right))
        for arm in (slice(0, 4), slice(4, 8)):
            alone = np.zeros(8)
            alone[arm] = q[arm]
            assert ik.clearance(alone).min() > 0.01
        assert ik.hands(q, 0.0)[0] * [1.0, -1.0, 1.0] == pytest.approx(ik.hands(q, 0.0)[1], abs=1e-9)
        assert np.all((q >= robot.lower[robot.arms]) & (q <= robot.upper[robot.arms]))
