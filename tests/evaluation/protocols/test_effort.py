import dataclasses

import pytest

from hugwbc import Command, Gait
from hugwbc.errors import ConfigError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.protocols.effort import EffortConfig, EffortProtocol
from hugwbc.robot import load_robot
from hugwbc.runtime.controllers import HoldController


class Recorder(HoldController):
    """Stands on stiff legs and remembers the commanded speeds and gaits."""

    commanded: set[tuple[float, Gait]]

    def act(self, state, command: Command, upper_body):
        self.commanded.add((command.v_x, command.gait))
        return super().act(state, command, upper_body)


def test_every_speed_of_the_gait_has_a_row():
    controller = Recorder()
    controller.commanded = set()
    config = EffortConfig(Gait.HOPPING_LEFT, True, duration=0.3, settle=0.1, conditions=Conditions(payload=2.0))
    result = EffortProtocol().run(lambda: controller, config)
    left, right = Gait.HOPPING_LEFT, Gait.HOPPING_RIGHT
    assert controller.commanded == {(0.0, left), (0.25, right), (0.5, left)} and result.gait == "hopping"
    assert [row.v_x for row in result.rows] == [0.0, 0.25, 0.5] and result.falls < result.episodes == 3
    assert result.mass == pytest.approx(load_robot().mass + 2.0, abs=0.01)
    for row in result.rows:
        assert row.power is not None and row.power > 0.0 and row.cost_of_transport is None
        assert 0.0 < row.torque_rms < row.torque_peak <= 1.0  # type: ignore[operator]
        assert 0.0 < row.tick_p50_ms <= row.tick_p99_ms and row.period_ms == pytest.approx(20.0)


def test_standing_has_power_alone():
    assert EffortConfig(Gait.STANDING).admitted == (0.0,) and EffortConfig(Gait.STANDING).episodes == 1
    assert EffortConfig(Gait.WALKING).admitted == (0.0, 0.25, 0.5, 1.0, 1.5)
    with pytest.raises(ConfigError, match="standing admits 0 to 0 m/s"):
        dataclasses.replace(EffortConfig(Gait.WALKING, speeds=(0.5,)), gait=Gait.STANDING)


class Limp(HoldController):
    """Has no joint torques: it collapses."""

    def act(self, state, command: Command, upper_body):
        output = super().act(state, command, upper_body)
        return dataclasses.replace(output, kp=0 * output.kp, kd=0 * output.kd)


def test_a_fall_is_no_cheap_way_to_travel():
    result = EffortProtocol().run(Limp, EffortConfig(Gait.WALKING, speeds=(0.5,), duration=3.0, settle=0.1))
    (row,) = result.rows
    assert row.fell and row.survived_s > 0.3 and row.tick_p50_ms is not None
    assert row.speed is row.power is row.cost_of_transport is row.torque_rms is row.torque_rate is None


def test_effort_in_readable_units():
    known = {"v_x": 0.5, "fell": False, "power": 200.0, "torque_rms": 0.25, "torque_peak": 1.0, "joint_speed_peak": 0.5}
    unknown = dict.fromkeys(("cost_of_transport", "torque_rate", "tick_p50_ms", "tick_p99_ms"))
    figures = EffortProtocol().figures("qp", {"gait": "walking", "rows": [{**known, **unknown}]})
    assert {f.table for f in figures} == {"Effort, walking, 0.5 m/s"}
    assert {(f.value, f.unit) for f in figures} == {
        (200.0, "W"), (25.0, "% of limit"), (100.0, "% of limit"), (50.0, "% of limit"), (0.0, "% of episodes")
    }  # fmt: skip


def test_efforts_are_described_by_speed(lines):
    protocol = EffortProtocol()
    text = protocol.describe(protocol.run(HoldController, EffortConfig(Gait.WALKING, duration=0.2, settle=0.1)))
    assert lines(text)["walking, hold"] == ["0 m/s", "0.25 m/s", "0.5 m/s", "1 m/s", "1.5 m/s"]
    assert lines(text)["cost of transport"] == ["-"] * 5 and lines(text)["fell"] == ["no"] * 5
