import dataclasses

import numpy as np
import pytest

from hugwbc import Command, Gait, load_robot
from hugwbc.behaviours import Failure, wait
from hugwbc.evaluation.comparison import (
    compare,
    figure_table,
    headline,
    segment_spans,
    segment_table,
    summarise,
)
from hugwbc.evaluation.metrics import arrived, hand_travel
from hugwbc.runtime.controllers import ControllerSpec, HoldController
from hugwbc.runtime.safety_report import SafetyReport
from hugwbc.scripts.hand_paths import Hold
from hugwbc.scripts.script import SCRIPT_NAMES, HandMotion, Script, Segment, load_script, while_walking
from hugwbc.viz.framing import title_of

REACH = HandMotion(Hold((0.35, 0.3, 0.25)), Hold((0.35, -0.3, 0.25)))
SCRIPT = Script("test", (Segment("stand", 0.3, ramp=0.1), Segment("reach", 0.9, hands=REACH, ramp=0.5)))


WALKS = {"learned": (0.0, 0.3), "qp": (0.0,)}  # by controller, the walk put under each script [m/s]


def test_an_outcome_holds_the_figures_of_its_trace(synthetic_trace):
    trace = synthetic_trace(Command(v_x=0.5, gait=Gait.WALKING), bias={"v_x": 0.1, "w": -0.2}, duration=4.0)
    n = trace.time.size
    error = np.full((n, 2), np.nan)
    error[-100:] = (0.01, 0.03)
    target = np.where(np.isfinite(error)[..., None], np.zeros(3), np.nan)
    left = ("object 'parcel' left the world at 0.30 s",)
    hands = {"problems": left, "hand_error": error, "hand_target_world": target, "reachable": np.isfinite(error)}
    outcome = summarise(dataclasses.replace(trace, tick_ms=np.arange(101.0), ik_ms=np.full(5, 0.25), **hands))
    assert not outcome["fell"] and outcome["survived_s"] == 4.0 and outcome["steps"] == n
    assert outcome["problems"] == left
    assert outcome["errors"] == pytest.approx({"v_x": 0.1, "v_y": 0.0, "omega": 0.0, "h": 0.0, "p": 0.0, "w": 0.2})
    assert outcome["hand_error_m"]["mean"] == pytest.approx(0.02)
    assert outcome["tick_ms"] == {"p50": 50.0, "p99": 99.0}
    assert outcome["ik_ms"] == pytest.approx({"p50": 0.25, "p99": 0.25})
    # 2 Hz for 4 s: the left foot comes down at 0.5, 1.0, ... 3.5 s, the right one at 0.25, 0.75, ... 3.75 s
    assert outcome["footsteps"] == 7 + 8


@pytest.fixture(scope="module")
def held():
    """Traces of two controllers that hold still, in the same noise."""
    controllers = {name: HoldController(load_robot()) for name in ("one", "two")}
    return [run.trace for run in compare(controllers, SCRIPT)]


def test_every_controller_plays_the_whole_script_with_the_same_commands_and_targets(held):
    traces = held
    assert [trace.name for trace in traces] == ["one", "two"]
    for trace in traces:
        assert trace.time[-1] == pytest.approx(SCRIPT.duration - 0.02)
        np.testing.assert_array_equal(trace.command, [SCRIPT.command_at(t).array() for t in trace.time])
        wanted = np.isfinite(trace.hand_target_world).all(axis=(1, 2))
        np.testing.assert_array_equal(wanted, [SCRIPT.hands_at(t) is not None for t in trace.time])
    np.testing.assert_array_equal(traces[0].qpos, traces[1].qpos)


def test_how_a_behaviour_ended_is_told():
    def tire(view):
        yield from wait(view, 0.1)
        raise Failure("out of breath")

    (run,) = compare({"hold": HoldController(load_robot())}, tire)
    assert run.outcome["ending"] == "not done: out of breath"
    outcomes = {"hold": run.outcome}
    assert ("behaviour", "not done: out of breath") in figure_table(outcomes).rows
    assert headline(outcomes) == f"hold stayed up for {run.trace.survived_s:.1f} s (not done: out of breath)."


def test_noise_follows_the_seed(held):
    other = compare({"hold": HoldController(load_robot())}, SCRIPT, seed=2)[0].trace
    assert not np.array_equal(held[0].qpos[-1], other.qpos[-1]), "the IK sees the noise and moves the arms accordingly"


@pytest.mark.slow
@pytest.mark.parametrize("script", SCRIPT_NAMES)
@pytest.mark.parametrize(("controller", "v_x"), [(name, v) for name, speeds in WALKS.items() for v in speeds])
def test_every_shipped_script_is_finished_without_a_fall(controller, v_x, script):
    scene = load_script(script)
    if v_x:
        scene = while_walking(scene, v_x)
    trace = compare({controller: ControllerSpec(controller).build()}, scene)[0].trace
    outcome = summarise(trace)
    assert not outcome["fell"]
    given = np.isfinite(trace.hand_target_world).all(axis=2)
    if given.any():
        assert trace.reachable[given].mean() > 0.85
        # The way to the first target is included.
        assert outcome["hand_error_m"]["mean"] < (0.06 if controller == "qp" else 0.16)


WALK = Script("test", (Segment("stand", 4.0), Segment("walk", 6.0, Gait.WALKING, {"v_x": 0.5})))


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
    assert found["arrived_p95"] == pytest.approx(0.07)
    assert hand_travel(run, run.time < 1.0)["arrived"] is None
    run.hand_error[:, 1] = np.nan
    assert hand_travel(run)["travel_time"] == pytest.approx(2.0), "of the hand that has targets"


def test_a_row_for_each_segment(reaching):
    assert segment_spans(WALK) == [("stand", 0.0, 4.0), ("walk", 4.0, 10.0)]
    fallen = reaching("learned", fell=True, survived_s=3.0)
    cut = {name: getattr(fallen, name)[:150] for name in ("time", "command", "measured", "hand_error",
                                                         "hand_target_world", "qpos")}  # fmt: skip
    table = segment_table(WALK, [reaching(bias={"v_x": 0.2}), dataclasses.replace(fallen, **cut)])
    stand, walk = table.rows
    assert stand[0] == "stand (0 to 4 s)" and stand[1] == "forward speed 0.20 m/s"
    assert "fell at 3.0 s" in stand[5] and stand[4] == pytest.approx(2.0)
    assert walk[5] == "fell at 3.0 s" and walk[6:] == [None, None, None]
    blip = dataclasses.replace(WALK.segments[0], label="blip", duration=0.005, ramp=0.0)
    short = Script("short", (WALK.segments[0], blip, WALK.segments[1]))
    assert segment_table(short, [reaching(time=reaching().time + 0.01)]).rows[1][1:] == [None] * 4, "it has no sample"
    assert walk[2] == pytest.approx(1.0, abs=0.01) and walk[3] == pytest.approx(30.0)


def test_the_headline_says_the_smallest_and_the_largest_error_of_any_number_of_controllers(reaching):
    learned = reaching("learned", near=0.03, bias={"v_x": 0.1, "h": 0.012})
    fallen = dataclasses.replace(reaching("hold", bias={"v_x": 0.5}), fell=True, survived_s=3.0)
    figures = {r.name: summarise(r) for r in (learned, fallen, reaching("qp", bias={"v_x": 0.02, "h": 0.03}))}
    text = headline(figures)
    assert text.startswith("learned and qp stayed up for 10.0 s; hold fell after 3.0 s. Mean errors: ")
    assert "forward speed 0.02 (qp) to 0.5 m/s (hold, until its fall), " in text
    assert "height 0 (hold, until its fall) to 0.03 m (qp), hands once there " in text
    assert "turning" not in text, "a difference that nobody sees"
    assert headline({"qp": figures["qp"]}) == "qp stayed up for 10.0 s."
    knelt = dataclasses.replace(learned, safety=SafetyReport(lowered=9))
    assert headline({"qp": summarise(knelt)}) == "qp knelt down, since the state or a motor was lost."
    assert title_of(knelt) == "learned (knelt down)" and title_of(learned) == "learned"


def test_the_headline_says_that_a_hand_does_not_arrive(reaching):
    one = reaching("one", near=0.002)
    one.hand_error[100:, 1] = 0.1  # no error once there
    text = headline({run.name: summarise(run) for run in (one, reaching("both", near=0.02))})
    assert text.endswith("hands once there 0.2 (one) to 2 cm (both), on the way 3 (both) to 5.5 s (one).")


def test_the_headline_of_a_task_has_the_verdicts(reaching):
    figures = summarise(reaching())
    said = {"reason": "it fell over", "seconds": 9.0}
    done, not_done = ({"verdict": {"success": success, **said}} for success in (True, False))
    text = headline({"qp": figures | done, "learned": figures | not_done})
    assert text == "qp did the task in 9.0 s; learned did not (it fell over)."
