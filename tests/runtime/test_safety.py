import dataclasses
import decimal
import fractions

import numpy as np
import pytest
import torch
from hypothesis import given, settings, strategies as st

from hugwbc import Command, Gait, JointCommand, RobotState, UpperBody, command_ranges, load_robot
from hugwbc.commands import COMMAND_NAMES
from hugwbc.controller import override_arms
from hugwbc.errors import ConfigError, HugwbcError
from hugwbc.learned.policy.contract import load_contract
from hugwbc.runtime.safety import Handover, SafetyFilter, gain_limits
from tests.conftest import make_state

ROBOT = load_robot()
DT = 0.02


class Recorder:
    """A controller that remembers what it was given and answers what it was told to."""

    name, period = "recorder", 0.02

    def __init__(self):
        self.answer = JointCommand.position(ROBOT, ROBOT.nominal)
        self.seen: list[tuple[RobotState, Command, UpperBody]] = []
        self.resets = 0

    def reset(self, state):
        self.resets += 1

    def act(self, state, command, upper_body):
        self.seen.append((state, command, upper_body))
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


def bad_state():
    return make_state(dq=np.full(19, np.nan))


@pytest.fixture
def filtered():
    recorder = Recorder()
    safe = SafetyFilter(recorder, robot=load_robot())
    safe.reset(make_state())
    return recorder, safe


def test_a_good_tick_passes_unchanged(filtered):
    recorder, safe = filtered
    command = Command(v_x=0.5, gait=Gait.WALKING)
    output = safe.act(make_state(), command, UpperBody.none())
    assert recorder.seen[-1][1] == command
    np.testing.assert_array_equal(output.q, ROBOT.nominal)
    report = safe.report()
    assert report.ticks == 1
    assert report.messages == () and report.commands_clamped == {} and report.held == 0


def test_out_of_range_commands_are_clamped_counted_and_never_passed_on(filtered):
    recorder, safe = filtered
    safe.act(make_state(), Command(v_x=9.0, h=float("nan"), gait=Gait.WALKING), UpperBody.none())
    safe.act(make_state(), Command(v_x=-9.0, gait=Gait.WALKING), UpperBody.none())
    assert [c.v_x for _, c, _ in recorder.seen] == [2.0, -0.6]
    assert recorder.seen[0][1].h == 0.0
    assert safe.report().commands_clamped == {"v_x": 2, "h": 1}
    assert "outside -0.6 to 2" in safe.report().messages[0]


def test_combinations_that_the_legs_do_not_allow_are_changed_counted_and_explained(filtered):
    recorder, safe = filtered
    asked = Command(v_x=1.5, f=1.5, l=0.3, h=-0.25, gait=Gait.WALKING)
    for _ in range(2):
        safe.act(make_state(), asked, UpperBody.none())
    assert recorder.seen[-1][1] == dataclasses.replace(asked, f=2.0, l=0.15)
    assert safe.command == asked, "errors are measured against what was asked"
    report = safe.report()
    assert report.commands_guarded == {"f": 2, "l": 2} and report.commands_clamped == {}
    assert any("f = 1.5 is not possible at 1.5 m/s" in message for message in report.messages)


@settings(max_examples=200)
@given(
    values=st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=8, max_size=8),
    gait=st.sampled_from(list(Gait)),
)
def test_any_eight_numbers_reach_the_controller_in_range(values, gait):
    recorder = Recorder()
    safe = SafetyFilter(recorder, robot=load_robot())
    safe.act(make_state(), Command(**dict(zip(COMMAND_NAMES, values, strict=True)), gait=gait), UpperBody.none())
    passed = recorder.seen[-1][1]
    for name, limits in command_ranges(gait).items():
        assert limits.finishing[0] <= getattr(passed, name) <= limits.finishing[1]


def test_a_bad_state_holds_the_last_command_then_damps_then_recovers(filtered):
    recorder, safe = filtered
    recorder.answer = JointCommand.position(ROBOT, ROBOT.nominal + 0.05)
    first = safe.act(make_state(), Command(), UpperBody.none())
    held = [safe.act(bad_state(), Command(), UpperBody.none()) for _ in range(5)]
    damped = safe.act(bad_state(), Command(), UpperBody.none())
    for output in held:
        np.testing.assert_array_equal(output.q, first.q)
        np.testing.assert_array_equal(output.kp, ROBOT.kp)
    np.testing.assert_array_equal(damped.kp, 0.0)
    np.testing.assert_array_equal(damped.kd, ROBOT.kd)
    assert damped.is_finite
    assert len(recorder.seen) == 1, "the controller never sees a state that is not finite"
    resets = recorder.resets
    recovered = safe.act(make_state(), Command(), UpperBody.none())
    assert recorder.resets == resets + 1
    np.testing.assert_array_equal(recovered.kp, ROBOT.kp)
    report = safe.report()
    assert (report.bad_states, report.held, report.damped) == (6, 5, 1)


def test_an_imu_that_died_is_a_bad_state(filtered):
    recorder, safe = filtered
    dead = make_state(orientation=np.zeros(4))
    safe.act(dead, Command(), UpperBody.none())
    assert recorder.seen == [] and safe.report().bad_states == 1
    slightly_off = make_state(orientation=np.array([1.01, 0.0, 0.0, 0.0]))
    safe.act(slightly_off, Command(), UpperBody.none())
    assert len(recorder.seen) == 1


def test_an_exception_or_a_nan_of_the_controller_is_contained(filtered):
    recorder, safe = filtered
    recorder.answer = RuntimeError("no solution")
    assert safe.act(make_state(), Command(), UpperBody.none()).is_finite
    recorder.answer = JointCommand.position(ROBOT, np.full(19, np.nan))
    assert safe.act(make_state(), Command(), UpperBody.none()).is_finite
    for too_few in (np.zeros(18), np.zeros((19, 1))):
        recorder.answer = dataclasses.replace(JointCommand.position(ROBOT, ROBOT.nominal), kd=too_few)
        assert safe.act(make_state(), Command(), UpperBody.none()).kd.shape == (19,)
    recorder.answer = None
    assert safe.act(make_state(), Command(), UpperBody.none()).is_finite
    report = safe.report()
    assert report.failures == 2 and report.bad_outputs == 3
    assert "RuntimeError: no solution" in report.messages[0]


def test_targets_and_torques_stay_within_limits(filtered):
    recorder, safe = filtered
    huge = np.full(19, 100.0)
    recorder.answer = dataclasses.replace(JointCommand.position(ROBOT, huge), tau=-1e4 * np.ones(19))
    output = safe.act(make_state(), Command(), UpperBody.none())
    knee = ROBOT.index("left_knee_joint")
    # limit 2.05 rad; 280 N*m at 300 N*m/rad is another 0.9333 rad
    assert output.q[knee] == pytest.approx(2.05 + 280 / 300)
    assert output.tau[knee] == -280.0
    report = safe.report()
    assert (report.positions_limited, report.torques_limited) == (1, 1)


def test_external_arm_targets_are_checked(filtered):
    recorder, safe = filtered
    safe.act(make_state(), Command(), UpperBody.targets(np.full(8, 0.1)))
    bad = UpperBody(np.full(8, np.nan), np.zeros(8), np.ones(8, dtype=bool))
    safe.act(make_state(), Command(), bad)
    np.testing.assert_array_equal(recorder.seen[-1][2].q, 0.1)
    safe.act(make_state(), Command(), UpperBody(np.zeros(7), np.zeros(8), np.ones(8, dtype=bool)))
    np.testing.assert_array_equal(recorder.seen[-1][2].q, 0.1)
    safe.act(make_state(), Command(), UpperBody.targets(np.full(8, 9.0)))
    np.testing.assert_array_equal(recorder.seen[-1][2].q, ROBOT.upper[ROBOT.arms])
    report = safe.report()
    assert (report.upper_body_rejected, report.upper_body_limited) == (2, 1)


def test_velocity_targets_are_limited_to_the_joints_speeds(filtered):
    recorder, safe = filtered
    fast = ROBOT.velocity_limit * np.where(np.arange(19) % 2, -1.5, 0.5)
    recorder.answer = dataclasses.replace(JointCommand.position(ROBOT, ROBOT.nominal), dq=fast)
    output = safe.act(make_state(), Command(), UpperBody.none())
    np.testing.assert_allclose(output.dq, np.clip(fast, -ROBOT.velocity_limit, ROBOT.velocity_limit))
    assert safe.report().speeds_limited == 1
    assert any("speeds limited, first at" in message for message in safe.report().messages)
    recorder.answer = dataclasses.replace(recorder.answer, dq=ROBOT.velocity_limit)
    safe.act(make_state(), Command(), UpperBody.none())
    assert safe.report().speeds_limited == 1


def test_overruns_are_counted():
    times = iter([0.0, 0.03, 1.0, 1.01])
    safe = SafetyFilter(Recorder(), clock=lambda: next(times), robot=load_robot())
    safe.act(make_state(), Command(), UpperBody.none())
    safe.act(make_state(), Command(), UpperBody.none())
    assert safe.report().overruns == 1
    assert safe.last_tick_s == pytest.approx(0.01)


def test_the_arm_command_does_not_jump_and_the_rest_is_untouched():
    handover = Handover(ROBOT.arms)
    swing = 0.3 * np.sin(np.arange(100) * 0.1)
    external = UpperBody.targets(np.full(8, 0.5))
    streams = []
    for tick in range(100):
        q = ROBOT.nominal + swing[tick]
        q[ROBOT.arms] = 0.5 if tick < 40 else q[ROBOT.arms]
        command = JointCommand.position(ROBOT, q)
        smooth = handover(command, external if tick < 40 else UpperBody.none(), DT)
        assert smooth.q[ROBOT.legs] == pytest.approx(command.q[ROBOT.legs])
        if tick < 40 or tick >= 40 + 25:
            assert smooth.q == pytest.approx(q)
        streams.append(smooth.q[ROBOT.arms])
    steps = np.abs(np.diff(streams, axis=0)).max(axis=1)
    assert np.abs(0.5 - (ROBOT.nominal[ROBOT.arms] + swing[40])).max() > 0.3, "it would have jumped"
    assert steps.max() < 0.1


def test_neither_takeover_nor_hand_back_changes_the_torque_at_once():
    """The servo has other gains and another torque than the controller, and fades in and out."""
    own = JointCommand.position(ROBOT, ROBOT.nominal)
    nominal, tau, kp, kd = ROBOT.nominal[ROBOT.arms], np.full(8, 5.0), np.full(8, 140.0), np.full(8, 8.0)
    targets = dataclasses.replace(UpperBody.targets(nominal), tau=tau, kp=kp, kd=kd)
    handover, measured, speed = Handover(ROBOT.arms), ROBOT.nominal - 0.1, np.full(19, 0.5)
    torques = []
    for tick in range(120):
        arms = targets if 40 <= tick < 80 else UpperBody.none()
        command = handover(override_arms(own, arms, ROBOT), arms, DT)
        torques.append((command.tau + command.kp * (command.q - measured) + command.kd * (command.dq - speed))[11])
    before, taken = 20.0 * 0.1 - 0.5 * 0.5, 5.0 + 140.0 * 0.1 - 8.0 * 0.5
    assert [torques[t] for t in (39, 40, 79, 80, 119)] == pytest.approx([before, before, taken, taken, before])
    assert np.abs(np.diff(torques)).max() < 1.5


def unchanged(handover, command, upper_body, dt):
    return command


def test_the_handover_acts_on_the_filtered_command_and_its_sum_is_limited_again():
    """Takeovers, releases, arms beyond the limits, broken states and outputs: as a blend behind the filter would be."""
    rng = np.random.default_rng(0)
    recorders = Recorder(), Recorder()
    safe, plain = (SafetyFilter(recorder, clock=lambda: 0.0, robot=load_robot()) for recorder in recorders)
    plain._handover.__class__ = type("NoHandover", (Handover,), {"__call__": unchanged})
    behind = Handover(ROBOT.arms)
    arms, faded = UpperBody.none(), 0
    for tick in range(2000):
        if tick % 20 == 0:
            arms = UpperBody.none() if rng.random() < 0.6 else UpperBody.targets(rng.uniform(-3.0, 3.0, 8))
        q = ROBOT.nominal + rng.normal(0.0, 2.0, 19)
        answer = override_arms(JointCommand.position(ROBOT, q), arms, ROBOT)
        fault = rng.random()
        if fault < 0.05:
            answer = RuntimeError("no solution")
        recorders[0].answer = recorders[1].answer = answer
        state = bad_state() if 0.05 < fault < 0.1 or tick % 500 > 480 else make_state()
        found = safe.act(state, Command(), arms)
        filtered = plain.act(state, Command(), arms)
        expected = behind(filtered, arms, plain.period)
        if expected is not filtered:
            faded, expected = faded + 1, plain.limited(expected)
        for field in dataclasses.fields(JointCommand):
            name, vector = field.name, getattr(expected, field.name)
            np.testing.assert_array_equal(getattr(found, name), vector)
    assert safe.report() == plain.report()
    assert faded > 100 and safe.report().held > 0 and safe.report().damped > 0


@pytest.mark.parametrize("name", ["kp", "kd"])
@pytest.mark.parametrize("factor", [-1.0, -1e-3, 1e6])
def test_gains_that_drive_joints_away_or_chatter_are_clamped_and_counted(filtered, name, factor):
    recorder, safe = filtered
    recorder.answer = dataclasses.replace(recorder.answer, **{name: factor * getattr(ROBOT, name)})
    output = safe.act(make_state(), Command(), UpperBody.none())
    highest = gain_limits(ROBOT)[("kp", "kd").index(name)]
    np.testing.assert_array_equal(getattr(output, name), np.zeros(19) if factor < 0.0 else highest)
    report = safe.report()
    assert report.gains_limited == 1 and "gains limited, first at" in report.messages[0]


@pytest.mark.parametrize("name", ["unitree-h1", "leggedlab-h1"])
def test_other_projects_gains_are_within_the_limits(name):
    contract = load_contract(name)
    stiffest, most_damped = (limit[ROBOT.indices(contract.joints)] for limit in gain_limits(ROBOT))
    assert (np.array(contract.kp) <= 0.6 * stiffest).all() and (np.array(contract.kd) <= 0.6 * most_damped).all()


@pytest.mark.parametrize("soft", [0.0, 5.0])
def test_gains_that_change_while_the_arms_are_handed_over_stay_between_those_before_and_now(soft):
    """Stiff hands that become soft a tenth of a second after the takeover."""
    own, handover = JointCommand.position(ROBOT, ROBOT.nominal), Handover(ROBOT.arms)
    handover(own, UpperBody.none(), DT)
    for tick in range(30):
        kp = np.full(8, 140.0 if tick < 5 else soft)
        arms = dataclasses.replace(UpperBody.targets(ROBOT.nominal[ROBOT.arms]), kp=kp, kd=np.full(8, 3.0))
        faded = handover(override_arms(own, arms, ROBOT), arms, DT)
        assert min(20.0, kp[0]) <= faded.kp[ROBOT.arms].min() and faded.kp.max() <= 300.0
    np.testing.assert_array_equal(faded.kp[ROBOT.arms], soft)


GRADIENT = torch.full((19,), 0.5, requires_grad=True)
ODD = {
    "none": None,
    "text": "ahead",
    "bytes": b"0.3",
    "flag": True,
    "huge": 10**400,
    "complex": 1j,
    "object": object(),
    "too many": np.zeros(20),
    "too few": [0.0] * 7,
    "turned": np.zeros((19, 1)),
    "texts": ["0.1"] * 19,
    "ragged": [[1.0], [2.0, 3.0]],
    "gradient": GRADIENT,
    "tensor": torch.tensor(0.25),
    "half": np.float16(0.25),
    "zero-dimensional": np.array(0.25),
    "fraction": fractions.Fraction(1, 4),
    "decimal": decimal.Decimal("0.25"),
}


@pytest.mark.parametrize("odd", ODD)
@pytest.mark.parametrize("kind", [RobotState, Command, UpperBody, JointCommand])
def test_one_odd_field_anywhere_never_raises_in_the_filter_and_never_gets_out(filtered, kind, odd):
    recorder, safe = filtered
    sound = {
        RobotState: make_state(position=np.zeros(3)),
        Command: Command(gait=Gait.WALKING),
        UpperBody: UpperBody.targets(np.zeros(8)),
        JointCommand: recorder.answer,
    }
    for field in dataclasses.fields(kind):
        try:
            given = sound | {kind: dataclasses.replace(sound[kind], **{field.name: ODD[odd]})}
        except HugwbcError as error:
            assert kind is Command and ("give a number" in str(error) or "gait" in str(error))
            continue
        recorder.answer = given[JointCommand]
        output = safe.act(given[RobotState], given[Command], given[UpperBody])
        assert output.is_finite and {getattr(output, f.name).shape for f in dataclasses.fields(output)} == {(19,)}
    safe.reset(make_state())
    for wrong in ((ODD[odd], Command(), UpperBody.none()), (make_state(), ODD[odd], UpperBody.none()),
                  (make_state(), Command(), ODD[odd])):  # fmt: skip
        assert safe.act(*wrong).is_finite
    recorder.answer = ODD[odd]
    assert safe.act(make_state(), Command(), UpperBody.none()).is_finite
    assert safe.report().failures >= 1 and safe.report().source_failures == 1


def test_a_controller_that_raises_in_its_reset_is_held_and_reset_again(filtered):
    recorder, safe = filtered
    recorder.reset = lambda state: 1 / 0
    safe.reset(make_state())
    assert safe.act(make_state(), Command(), UpperBody.none()).is_finite
    assert safe.report().failures == 2 and "ZeroDivisionError" in safe.report().messages[0]
    del recorder.reset
    recorder.answer = JointCommand.position(ROBOT, ROBOT.nominal + 0.01)
    np.testing.assert_array_equal(safe.act(make_state(), Command(), UpperBody.none()).q, ROBOT.nominal + 0.01)


@pytest.mark.parametrize("period", [0.0, float("nan"), "0.02", None])
def test_a_controller_without_a_period_is_refused(period):
    recorder = Recorder()
    recorder.period = period
    with pytest.raises(ConfigError, match="give the time between two calls of act"):
        SafetyFilter(recorder, robot=load_robot())
