"""Figures of segments: hands on the way apart from hands that have arrived, final poses, and the sentence."""

import dataclasses

import numpy as np
import pytest

from hugwbc import Command, Gait, rotations
from hugwbc.evaluation.comparison import summarise
from hugwbc.evaluation.metrics import arrived, hand_travel
from hugwbc.evaluation.segment_figures import headline, pose_table, segment_spans, segment_table
from hugwbc.scripts.script import Script, Segment

SCRIPT = Script("test", (Segment("stand", 4.0), Segment("walk", 6.0, Gait.WALKING, {"v_x": 0.5})))


@pytest.fixture
def reaching(synthetic_trace):
    """A run of 10 s with targets from 2 s on: hands are 7 cm off after 1 s, 1 cm after 2 s; others from 6 s on."""

    def make(name="qp", near=0.01, **fields):
        trace = synthetic_trace(Command(v_x=0.5, gait=Gait.WALKING), name=name, **fields)
        error = np.full((500, 2), near)
        error[:100] = np.nan
        error[100:150] = error[300:350] = 0.3
        error[150:200] += 0.06  # it leaves its target again, which is no new journey
        target = np.where(np.isfinite(error)[..., None], 0.3, np.nan) + np.zeros((500, 2, 3))
        target[300:] += 0.2
        return dataclasses.replace(trace, hand_error=error, hand_target_world=target)

    return make


def test_a_hand_has_arrived_once_it_was_there_until_its_target_jumps(reaching):
    run = reaching()
    run.hand_error[150] = 0.01
    there = arrived(run)
    assert there[:, 0].tolist() == [150 <= i < 300 or i >= 350 for i in range(500)]
    found = hand_travel(run)
    assert found["travelling"] == pytest.approx(0.3) and found["travel_time"] == pytest.approx(2.0)
    assert found["arrived"] == pytest.approx((250 * 0.01 + 50 * 0.07 - 0.06) / 300, abs=1e-3)
    assert hand_travel(run, run.time < 1.0)["arrived"] is None


def test_a_row_for_each_segment(reaching):
    assert segment_spans(SCRIPT) == [("stand", 0.0, 4.0), ("walk", 4.0, 10.0)]
    fallen = reaching("learned", fell=True, survived_s=3.0)
    cut = {name: getattr(fallen, name)[:150] for name in ("time", "command", "measured", "hand_error",
                                                         "hand_target_world", "qpos")}  # fmt: skip
    table = segment_table(SCRIPT, [reaching(bias={"v_x": 0.2}), dataclasses.replace(fallen, **cut)])
    stand, walk = table.rows
    assert stand[0] == "stand (0 to 4 s)" and stand[1] == "forward speed 0.20 m/s"
    assert "fell at 3.0 s" in stand[5] and stand[4] == pytest.approx(2.0)
    assert walk[5] == "fell at 3.0 s" and walk[6:] == [None, None, None]
    assert walk[2] == pytest.approx(1.0, abs=0.01) and walk[3] == pytest.approx(30.0)


def test_final_poses_in_the_world(reaching):
    runs = [reaching(), reaching("learned")]
    for run, (x, y, yaw) in zip(runs, ((2.0, 0.0, 0.5), (2.0, 0.3, 0.4)), strict=True):
        run.qpos[-1, :2] = x, y
        run.qpos[-1, 3:7] = rotations.from_yaw_pitch_roll(yaw, 0.0, 0.0)
    first, second = pose_table(runs).rows
    assert first == ["qp", "up for 10.0 s", 2.0, 0.0, 28.6, None, None]
    assert second[:5] == ["learned", "up for 10.0 s", 2.0, 0.3, 22.9]
    assert second[5] == pytest.approx(0.3) and second[6] == pytest.approx(-5.7)


def test_the_headline_says_the_smallest_and_the_largest_error_of_any_number_of_controllers(reaching):
    learned = reaching("learned", near=0.03, bias={"v_x": 0.1, "h": 0.012})
    fallen = dataclasses.replace(reaching("hold", bias={"v_x": 0.5}), fell=True, survived_s=3.0)
    figures = {r.name: summarise(r) for r in (learned, fallen, reaching("qp", bias={"v_x": 0.02, "h": 0.03}))}
    text = headline(figures)
    assert text.startswith("learned and qp stayed up for 10.0 s; hold fell after 3.0 s. Mean errors: ")
    assert "forward speed 0.02 (qp) to 0.5 m/s (hold), height 0 (hold) to 0.03 m (qp), hands once there " in text
    assert "turning" not in text, "a difference that nobody sees"
    assert headline({"qp": figures["qp"]}) == "qp stayed up for 10.0 s."


def test_the_headline_of_a_task_has_the_verdicts(reaching):
    figures = summarise(reaching())
    done, not_done = ({"verdict": {"success": success, "reason": "it fell over"}} for success in (True, False))
    text = headline({"qp": figures | done, "learned": figures | not_done})
    assert text == "qp did the task in 10.0 s; learned did not (it fell over)."
