"""The bounds beyond which no grid point is tried, against the robot's own kinematics."""

import numpy as np

from hugwbc import rotations
from hugwbc.commands import command_ranges
from hugwbc.gait import Gait
from hugwbc.robot import load_robot
from hugwbc.upper_ik import ArmIK
from hugwbc.upper_ik.workspace import arm_length, arm_reach, shoulder_shift


def test_no_posture_brings_a_hand_beyond_the_arms_reach():
    ik, rng = ArmIK(load_robot()), np.random.default_rng(0)
    shoulders = ik.robot.shoulder * np.array([[1.0, 1.0, 1.0], [1.0, -1.0, 1.0]])
    far = [np.linalg.norm(ik.hands(rng.uniform(ik.lower, ik.upper), 0.0) - shoulders, axis=1) for _ in range(5000)]
    assert arm_length(ik.robot) < np.max(far) < arm_reach(ik.robot)


def test_no_pitch_and_waist_bring_a_shoulder_further():
    shoulder = load_robot().shoulder
    ranges = {name: np.linspace(*command_ranges(Gait.STANDING)[name].finishing, 21) for name in ("p", "w")}
    shifts = [
        np.linalg.norm(rotations.to_matrix(rotations.from_yaw_pitch_roll(0.0, p, 0.0)) @ turned - shoulder)
        for p in ranges["p"]
        for turned in (rotations.rotation_z(w) @ shoulder for w in ranges["w"])
    ]
    assert 0.3 < np.max(shifts) < shoulder_shift(load_robot())
