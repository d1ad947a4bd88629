import json

import pytest

from hugwbc.cli import main


def test_bench_reports_all_speeds(capsys):
    words = [
        "bench",
        "--count",
        "8",
        "--control-steps",
        "5",
        "--iterations",
        "1",
        "--seconds",
        "0.1",
        "--calls",
        "5",
        "--json",
    ]
    words += ["--ik-targets", "2", "--spacing", "1.0"]
    assert main(words) == 0
    printed = capsys.readouterr()
    figures = json.loads(printed.out)
    environment = figures["environment"]
    assert environment["count"] == 8 and environment["control_steps"] == 5
    assert environment["steps_per_s"] > 0.0 and environment["bare_steps_per_s"] > 0.0
    assert environment["ratio"] > 0.0
    training = figures["training"]
    assert training["steps_per_s"] > 0.0 and 0.0 < training["collect_fraction"] < 1.0
    assert training["ratio"] == pytest.approx(training["steps_per_s"] / environment["bare_steps_per_s"])
    for name in ("qp_tick_ms", "policy_tick_ms", "ik_tick_ms"):
        assert 0.0 < figures[name]["p50"] <= figures[name]["p99"]
    ours = figures["ik"]["hugwbc"]
    assert ours["limit_violations"] == ours["exceptions"] == 0
    assert 0.0 <= figures["workspace"]["arms"] <= figures["workspace"]["whole_body"] < 1.0
    assert "reachable part of a 2 m cube (27 points)" in printed.err
    assert "8 robots" in printed.err and "tick [ms]" in printed.err
