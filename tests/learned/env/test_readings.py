import torch

from hugwbc.learned.env.readings import Body


def test_the_robot_s_constants_and_groups_of_joints(robot) -> None:
    body = Body.of(robot, 0.02)
    assert body.dt == 0.02 and robot.joint_names[body.waist] == "torso_joint"
    knee = robot.index("left_knee_joint")
    torch.testing.assert_close(body.nominal[knee], torch.tensor(0.8))
    torch.testing.assert_close(torch.stack((body.lower[knee], body.upper[knee])), torch.tensor([-0.26, 2.05]))
    groups = {name: {robot.joint_names[i] for i in getattr(body, name)} for name in ("arms", "hips", "waist_and_legs")}
    assert groups["arms"] == set(robot.arm_names)
    assert groups["hips"] == {f"{side}_hip_{axis}_joint" for side in ("left", "right") for axis in ("yaw", "roll")}
    legs = {f"{side}_{joint}_joint" for side in ("left", "right") for joint in ("hip_pitch", "knee", "ankle")}
    assert groups["waist_and_legs"] == groups["hips"] | legs | {"torso_joint"}
