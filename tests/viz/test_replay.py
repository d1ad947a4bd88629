"""The replay page: what moves where, and for how long."""

import base64
import dataclasses
import re
from collections.abc import Callable

import numpy as np
import pytest
import umsgpack

from hugwbc import RobotState, load_robot, rotations
from hugwbc.kinematics import Kinematics
from hugwbc.sim.scenes import Box, Scene, Table
from hugwbc.viz.framing import Chapter
from hugwbc.viz.marks import STANCE, SWING
from hugwbc.viz.replay import CONTACT, chapter_bar, gait_bar, replay_html


def _commands(page: str) -> list[dict]:
    block = page[page.index("for (const text of [") :]
    block = block[: block.index("]) {")]
    return [umsgpack.unpackb(base64.b64decode(text)) for text in re.findall(r'"([A-Za-z0-9+/=]+)"', block)]


def _tracks(page: str) -> dict[str, dict[str, dict]]:
    (animation,) = [c for c in _commands(page) if c["type"] == "set_animation"]
    return {
        clip["path"].lstrip("/"): {track["name"]: track for track in clip["clip"]["tracks"]}
        for clip in animation["animations"]
    }


def test_replay_moves_the_links_as_pinocchio_says(make_run: Callable) -> None:
    first, second = make_run(seed=1), make_run(name="learned", seed=2)
    page = replay_html([first, second])
    tracks, kinematics = _tracks(page), Kinematics(load_robot())
    lanes = {c["path"]: c["matrix"][12:15] for c in _commands(page) if c["type"] == "set_transform"}
    assert [lanes[f"/meshcat/world/robot_{i}"] for i in (0, 1)] == [[0.0, -0.75, 0.0], [0.0, 0.75, 0.0]]
    for robot, run in (("robot_0", first), ("robot_1", second)):
        for frame, sample in ((0, 0), (10, 20), (24, 48)):  # 25 frames a second of 50 samples a second
            q = run.qpos[sample]
            kinematics.update(RobotState(q[7:], np.zeros(19), q[3:7], np.zeros(3), position=q[:3]))
            for link in ("pelvis", "left_ankle_link", "right_elbow_link", "torso_link"):
                track = tracks[f"meshcat/world/{robot}/links/{link}"]
                shown = track[".position"]["keys"][frame]
                assert shown["time"] == frame
                np.testing.assert_allclose(shown["value"], kinematics.position(link), atol=1e-5)
                x, y, z, w = track[".quaternion"]["keys"][frame]["value"]
                matrix = rotations.to_matrix(np.array([w, x, y, z]))
                np.testing.assert_allclose(matrix, kinematics.rotation(link), atol=1e-5)


def test_replay_shows_hand_targets_only_while_there_are_any(make_run: Callable) -> None:
    run = make_run()
    target = _tracks(replay_html([run]))["meshcat/world/robot_0/hands/target_left"]
    shown = [key["value"] for key in target[".visible"]["keys"]]
    assert shown == [False] * 13 + [True] * 12  # targets from sample 25 on, frame 12.5
    np.testing.assert_allclose(target[".position"]["keys"][20]["value"], run.hand_target_world[40, 0], atol=1e-5)
    tracks = _tracks(replay_html([make_run(hands=False)]))
    assert not any("/hands/" in path for path in tracks), "nothing to show"


def test_marks_move_show_and_hide_with_the_run(make_run: Callable) -> None:
    run = make_run(seconds=2.0)
    tracks = _tracks(replay_html([run]))
    arrow = tracks["meshcat/world/robot_0/forces/left"]
    shown = [key["value"] for key in arrow[".visible"]["keys"]]
    assert shown == ([False] * 13 + [True] * 12) * 2
    np.testing.assert_allclose(arrow[".position"]["keys"][20]["value"], run.pressure_centre[40, 0], atol=1e-5)
    # While it is hidden it waits where it was last.
    assert arrow[".position"]["keys"][30]["value"] == arrow[".position"]["keys"][24]["value"]
    # The left foot comes down at 0.5 and 1.5 s, the right one at 1 s: three footprints in this order, which stay.
    appear = [
        [key["value"] for key in tracks[f"meshcat/world/robot_0/steps/placed_{i}"][".visible"]["keys"]].index(True)
        for i in range(3)
    ]
    assert appear == [13, 25, 38]
    assert "meshcat/world/robot_0/steps/placed_3" not in tracks


def test_every_track_lasts_as_long_as_the_run(make_run: Callable) -> None:
    for path, tracks in _tracks(replay_html([make_run(seconds=2.0)])).items():
        for track in tracks.values():
            assert track["keys"][-1]["time"] == 49, f"{path} would start over before the others"


def test_replay_lasts_as_long_as_the_longest_run(make_run: Callable) -> None:
    tracks = _tracks(replay_html([make_run(seconds=2.0), make_run(seconds=1.0, fell=True)]))
    still = tracks["meshcat/world/robot_1/links/pelvis"][".position"]["keys"]
    assert len(still) == len(tracks["meshcat/world/robot_0/links/pelvis"][".position"]["keys"]) == 50
    assert still[-1]["value"] == still[25]["value"]


def test_the_strip_says_when_each_foot_stands_by_the_clock_and_in_fact(make_run):
    run = make_run(seconds=2.0)
    bar = gait_bar([run], 0.0, 1.98)
    boxes = re.findall(r'<rect x="([-\d.]+)" y="(\d+)" width="([\d.]+)" height="\d+" fill="(#\w+)"/>', bar)
    left = [(float(x), float(x) + float(w), c) for x, y, w, c in boxes if y == "0" and c in (STANCE, SWING)]
    # The walk starts with the left foot in swing, half a second at a time; stances lie over the swing.
    assert [(round(a, 2), round(b, 2), c) for a, b, c in left] == [
        (0.0, 1.98, SWING), (0.5, 1.0, STANCE), (1.5, 1.98, STANCE),
    ]  # fmt: skip
    on_ground = sum(float(w) for _, y, w, c in boxes if c == CONTACT and y == "3")
    assert on_ground == pytest.approx(np.count_nonzero(run.foot_contact[:, 0]) / 50, abs=0.03)


def test_objects_that_move_have_tracks_and_the_others_stay(make_run: Callable) -> None:
    run = make_run(seconds=1.0)
    scene = Scene((Table(name="desk", position=(2.0, 0.0)), Box(name="parcel", on="desk", size=(0.2, 0.2, 0.2))))
    poses = np.tile([[2.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], [2.0, 0.0, 0.9, 1.0, 0.0, 0.0, 0.0]], (len(run.time), 1, 1))
    poses[:, 1, 2] += np.linspace(0.0, 0.5, len(run.time))  # the box is lifted
    lifted = dataclasses.replace(run, scene=scene, object_pose=poses, hand_force=np.zeros((len(run.time), 2, 3)))
    page = replay_html([run, lifted])
    tracks = {name: track for name, track in _tracks(page).items() if "/objects/" in name}
    assert list(tracks) == ["meshcat/world/robot_1/objects/1"]
    assert list(tracks["meshcat/world/robot_1/objects/1"]) == [".position"]
    last = tracks["meshcat/world/robot_1/objects/1"][".position"]["keys"][-1]["value"]
    np.testing.assert_allclose(last, [2.0, 0.0, poses[48, 1, 2]], atol=1e-6)
    placed = {c["path"]: c["matrix"] for c in _commands(page) if c["type"] == "set_transform"}
    np.testing.assert_allclose(placed["/meshcat/world/robot_1/objects/0"][12:15], [2.0, 0.0, 0.0], atol=1e-6)
    assert not any("robot_0/objects" in path for path in placed)


def test_segments_have_their_names_on_the_time_axis(make_run: Callable) -> None:
    chapters = [Chapter(0.0, "stand"), Chapter(0.5, "a <b>"), Chapter(1.5, "walk"), Chapter(9.0, "never")]
    bar = chapter_bar(chapters, 0.0, 2.0)
    buttons = re.findall(r'data-time="([\d.]+)" title="([^"]*)" style="flex-grow:(\d+)">([^<]*)<', bar)
    assert buttons == [
        ("0.000", "stand", "500", "stand"),
        ("0.500", "a &lt;b&gt;", "1000", "a &lt;b&gt;"),
        ("1.500", "walk", "500", "walk"),
    ]
    assert chapter_bar([], 0.0, 2.0) == ""
    page = replay_html([make_run(seconds=2.0)], chapters=chapters)
    assert chapter_bar(chapters, 0.0, 1.98) in page and "stance by the gait's clock" in page
    assert not re.search(r"@[A-Z_]+@", page[: page.index("<script>")]), "all marks are replaced"
