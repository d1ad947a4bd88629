import re
import socket
import sys

import numpy as np
import pytest
from bvh_helpers import write_bvh

from hugwbc.cli import main, play
from hugwbc.gait import Gait
from hugwbc.robot import load_robot
from hugwbc.runtime import Constant
from hugwbc.scripts.motion import generate_motions
from hugwbc.scripts.script import Script
from hugwbc.sim import Arena


def test_play_stands_up_again_after_a_fall(capsys):
    assert main(["play", "--controller", "hold", "--viewer", "none", "--duration", "4"]) == 0
    text = capsys.readouterr().out
    assert text.count("standing up again") >= 2
    assert "hold: 4.0 s simulated" in text


@pytest.mark.parametrize(
    ("options", "gait"),
    [
        ({}, Gait.STANDING),
        ({"h": -0.1}, Gait.STANDING),
        ({"v_x": 0.5}, Gait.WALKING),
        ({"omega": -0.3}, Gait.WALKING),
        ({"gait": "jumping", "v_x": 0.5}, Gait.JUMPING),
    ],
)
def test_a_velocity_means_walking_unless_a_gait_is_given(options, gait):
    source, duration = play._source(play.PlayOptions(command=play.CommandOptions(**options), duration=3.0))
    assert isinstance(source, Constant)
    assert source.command.gait is gait and duration == 3.0
    for name in options.keys() - {"gait"}:
        assert getattr(source.command, name) == options[name]


def test_a_script_plays_for_its_duration_with_its_hands():
    source, duration = play._source(play.PlayOptions(script="loco_manipulation"))
    assert isinstance(source, Script) and duration == source.duration == 20.0


def test_hands_are_held_where_they_are_told_to():
    source, _ = play._source(
        play.PlayOptions(command=play.CommandOptions(left_hand=(0.3, 0.2, 0.1), right_hand=(0.3, -0.2, 0.1)))
    )
    hands = source.hands_at(1.0)
    assert hands is not None and hands.frame == "pelvis"
    assert hands.array().tolist() == [[0.3, 0.2, 0.1], [0.3, -0.2, 0.1]]


def test_a_scene_is_played_and_a_bad_one_is_refused(tmp_path, capsys):
    unwatched = ["play", "--controller", "hold", "--viewer", "none", "--scene"]
    assert main([*unwatched, "parcel", "--seed", "4", "--duration", "0.2"]) == 0
    assert "hold: 0.2 s simulated, 0 falls" in capsys.readouterr().out
    path = tmp_path / "mine.yaml"
    path.write_text("objects:\n  - {kind: door, name: exit}\n")
    assert main([*unwatched, str(path)]) == 2
    assert "mine.yaml:2:5: Scene.objects.0.hinge is missing" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--task", "push_the_cart"], "press_button"),
        (["--task", "push_cart", "--script", "walk"], "--task and --script are both given"),
        (["--task", "push_cart", "--v-x", "0"], "--task and --v-x are both given"),
    ],
)
def test_a_task_beside_something_else_is_refused(words, message, capsys):
    assert main(["play", "--viewer", "none", *words]) == 2
    assert message in capsys.readouterr().err


def test_a_task_without_its_ending_is_answered_with_the_file(standing_task, capsys, monkeypatch):
    monkeypatch.chdir(standing_task(name="move_box").parent)
    assert main(["play", "--viewer", "none", "--task", "move_box"]) == 2
    assert "give move_box.py" in capsys.readouterr().err


def test_a_task_is_played(capsys, standing_task):
    path = standing_task("Milestone('the robot did not fly', lambda record: float(record.pelvis[:, 2].max() > 3.0))")
    assert main(["play", "--task", str(path), "--controller", "hold", "--viewer", "none", "--sensing", "exact"]) == 1
    out = capsys.readouterr().out
    assert "stand with hold, seed 0: not done: the robot did not fly" in out and "score: 0.00" in out


@pytest.mark.parametrize(
    ("seconds", "code", "told"),
    [("0.1", 0, "done"), ("'long'", 1, "wait.seconds is 'long'; it should be a valid number")],
)
def test_a_behaviour_that_is_not_done_exits_with_1(tmp_path, capsys, seconds, code, told):
    path = tmp_path / "mine.py"
    path.write_text(
        f"from hugwbc.behaviours import wait\n\n\ndef rest(view):\n    return (yield from wait(view, {seconds}))\n"
    )
    assert main(["play", "--script", f"{path}:rest", "--controller", "hold", "--viewer", "none"]) == code
    assert told in capsys.readouterr().out


def test_a_motion_moves_the_arms_and_the_command_the_rest(tmp_path, capsys):
    (motion,) = generate_motions(load_robot(), seed=3, count=1, duration=1.0)
    motion.save(tmp_path / "wave.npz")
    source, duration = play._source(
        play.PlayOptions(motion=tmp_path / "wave.npz", command=play.CommandOptions(v_x=0.3))
    )
    assert duration == 1.0 and source.command_at(1.0).v_x == pytest.approx(0.3)
    hands = source.hands_at(0.5)
    assert hands is not None and hands.joints is not None
    np.testing.assert_allclose(hands.joints, motion.at(0.5)[0])
    (motion,) = generate_motions(load_robot("g1"), seed=3, count=1, duration=1.0)
    motion.save(tmp_path / "g1.npz")
    for swing, told in ((None, 0.12), (0.09, 0.09)):
        command = play.CommandOptions(v_x=0.3, l=swing)
        options = play.PlayOptions(motion=tmp_path / "g1.npz", command=command, arena=Arena(robot="g1"))
        assert play._source(options)[0].command_at(1.0).l == pytest.approx(told), "of a G1"
    for words in (["--motion", str(tmp_path / "none.npz")], ["--motion", str(tmp_path)]):
        assert main(["play", "--viewer", "none", *words]) == 2
        assert str(tmp_path) in capsys.readouterr().err
    assert main(["play", "--viewer", "none", "--motion", "wave.npz", "--script", "walk"]) == 2
    assert "motion" in capsys.readouterr().err


def test_a_whole_body_clip_is_danced_and_its_error_told(tmp_path, capsys, monkeypatch):
    path = write_bvh(tmp_path / "twist.bvh", lambda t: {"Spine": (0, 0, 70.0)})
    assert main(["play", "--viewer", "none", "--controller", "hold", "--motion", str(path), "--duration", "1.5"]) == 0
    out = capsys.readouterr().out
    assert "not used of twist.bvh: Hips, Spine, Head" in out
    assert re.search(r"^w +12\.70 deg +\d", out, re.MULTILINE), "70 degrees of the 57.3 that the range allows"
    assert re.search(r"^hands +\d+\.\d\d cm +\d", out, re.MULTILINE)
    assert main(["play", "--viewer", "none", "--motion", str(path), "--v-x", "0.3"]) == 2
    assert "--motion *.bvh and --v-x are both given" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "pybvh", None)
    assert main(["play", "--viewer", "none", "--motion", str(path)]) == 2
    assert "run `pip install 'hugwbc[motion]'`" in capsys.readouterr().err


def test_a_stream_is_followed_in_the_live_page_and_both_addresses_come_first(capsys, monkeypatch):
    monkeypatch.setattr("webbrowser.open", lambda address: True)
    assert main(["play", "--viewer", "live", "--listen", "0", "--controller", "hold", "--duration", "1.2"]) == 0
    first, second, third, *_, last = capsys.readouterr().out.splitlines()
    assert first.startswith("listening on UDP port")
    assert second.removeprefix("the page will be at ") in third and third.startswith("drive at http://")
    assert last.endswith("0 messages, longest gap 0 ms")
    assert main(["play", "--viewer", "live", "--listen", "0", "--v-x", "0.3"]) == 2
    assert "--viewer live and --v-x are both given" in capsys.readouterr().err


def test_mean_velocities_are_said_after_a_play_and_a_task(capsys, standing_task):
    assert main(["play", "--viewer", "none", "--v-x", "0.3", "--duration", "3"]) == 0
    said = re.search(r"walked of commanded: v_x (\d\.\d\d) of 0\.30 m/s, v_y", capsys.readouterr().out)
    assert said is not None and float(said[1]) == pytest.approx(0.3, abs=0.08)
    words = ["play", "--task", str(standing_task()), "--controller", "hold", "--viewer", "none"]
    assert main(words) == 1
    assert "omega 0.00 of 0.00 rad/s" in capsys.readouterr().out.replace("-0.00", "0.00")


def test_a_port_in_use_is_refused(capsys):
    with socket.create_server(("127.0.0.1", 0)) as other:
        assert main(["play", "--viewer", "live", "--controller", "hold", "--port", str(other.getsockname()[1])]) == 2
    assert "give another one, or 0" in capsys.readouterr().err


def test_the_live_page_is_for_a_person_and_meshcat_for_what_commands_the_robot(monkeypatch, capsys):
    walk = play.CommandOptions(v_x=0.3)
    assert play._viewer(play.PlayOptions()) == "live"
    assert play._viewer(play.PlayOptions(command=walk)) == play._viewer(play.PlayOptions(task="fetch_box")) == "meshcat"
    assert play._viewer(play.PlayOptions(viewer="none")) == "none"
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert play._viewer(play.PlayOptions()) == "meshcat"
    assert "pip install 'hugwbc[live]'" in capsys.readouterr().out


def test_without_a_browser_the_address_and_why_are_printed(monkeypatch, capsys):
    monkeypatch.setattr("webbrowser.open", lambda address: False)
    assert main(["play", "--controller", "hold", "--duration", "0.1"]) == 0
    printed = capsys.readouterr().out
    assert (port := re.search(r"drive at http://127\.0\.0\.1:(\d+)", printed))
    assert f"no browser; on yours: ssh -L {port[1]}:127.0.0.1:{port[1]} THIS_MACHINE, then open" in printed


def test_the_help_fits_one_screen_and_leaves_nothing_out(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    with pytest.raises(SystemExit):
        main(["play", "--help"])
    short = capsys.readouterr().out
    assert len(short.splitlines()) <= 42 and "arena    --robot --drives --sensing --ground" in short
    with pytest.raises(SystemExit):
        main(["play", "--help-all"])
    assert "Forward velocity [m/s]" in capsys.readouterr().out
