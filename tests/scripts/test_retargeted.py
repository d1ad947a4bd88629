import numpy as np
import pytest

from hugwbc.errors import MotionFileError, UnknownNameError
from hugwbc.robot import load_robot
from hugwbc.scripts.retargeted import load_retargeted

ARMS = load_robot().arm_names
FRAMES = np.linspace(0.0, 0.5, 6)


def test_other_field_and_joint_names_in_any_order(tmp_path):
    names = [name.removesuffix("_joint").upper() for name in ARMS[::-1]]
    dof = FRAMES[:, None] * np.arange(1.0, 9.0) / 10.0
    np.savez(
        tmp_path / "a.npz", mocap_framerate=120, dof_names=np.array(names), dof_pos=dof, root_trans=np.zeros((6, 3))
    )
    found = load_retargeted(tmp_path / "a.npz")
    assert (found.motion.name, found.motion.fps, found.missing, found.dropped_frames) == ("a", 120.0, (), 0)
    np.testing.assert_allclose(found.motion.positions, dof[:, ::-1])
    assert found.clamped == 0.0


def test_a_mapping_missing_joints_and_unequal_lengths(tmp_path):
    np.savez(tmp_path / "b.npz", fps=30.0, L_Elbow=FRAMES, right_elbow_joint=FRAMES[:4], left_knee_joint=FRAMES)
    found = load_retargeted(tmp_path / "b.npz", {"l_elbow": "left_elbow_joint"})
    assert found.dropped_frames == 2
    assert found.unused == ("left_knee_joint",)
    assert set(found.missing) == set(ARMS) - {"left_elbow_joint", "right_elbow_joint"}
    robot = load_robot()
    positions = dict(zip(ARMS, found.motion.positions.T, strict=True))
    np.testing.assert_allclose(positions["left_elbow_joint"], FRAMES[:4])
    np.testing.assert_allclose(positions["left_shoulder_roll_joint"], robot.nominal[robot.arms][1])


def test_a_mapping_to_what_is_no_joint_is_refused(tmp_path):
    np.savez(tmp_path / "d.npz", fps=30.0, L_Elbow=FRAMES)
    with pytest.raises(UnknownNameError, match="Did you mean 'left_elbow_joint'"):
        load_retargeted(tmp_path / "d.npz", {"l_elbow": "left_elbow"})


def test_angles_beyond_the_limits_are_clamped_and_counted(tmp_path):
    np.savez(tmp_path / "c.npz", fps=30.0, joint_names=np.array(ARMS), positions=np.full((2, 8), 3.0))
    found = load_retargeted(tmp_path / "c.npz")
    robot = load_robot()
    np.testing.assert_allclose(found.motion.positions[0], np.minimum(3.0, robot.upper[robot.arms]))
    assert found.clamped == pytest.approx(np.mean(robot.upper[robot.arms] < 3.0))


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"fps": 30.0, "left_elbow": np.array([0.0, 90.0])}, "angle of 90: these are degrees"),
        ({"left_elbow": FRAMES}, "no frame rate"),
        ({"fps": -1.0, "left_elbow": FRAMES}, "no frame rate"),
        ({"fps": 30.0, "knee": FRAMES}, "none of the joints"),
        ({"fps": 30.0, "left_elbow": FRAMES[:1]}, "at least 2"),
        ({"fps": 30.0, "left_elbow": np.array([0.0, np.nan])}, "not finite"),
        ({"fps": 30.0, "joint_names": np.array(["a", "b"]), "positions": np.zeros((4, 3))}, "frames x joints"),
        ({"fps": 30.0, "joint_names": np.array(["a", "a"]), "positions": np.zeros((4, 2))}, "joints a more than once"),
        ({"fps": 30.0, "left_elbow": np.array([None, 1], dtype=object)}, "without pickled objects"),
    ],
)
def test_what_cannot_be_used_is_refused(tmp_path, fields, message):
    np.savez(tmp_path / "d.npz", **fields)
    with pytest.raises(MotionFileError, match=message):
        load_retargeted(tmp_path / "d.npz")
