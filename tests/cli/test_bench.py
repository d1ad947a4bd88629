import json

from hugwbc.cli import main


def test_bench_reports_all_speeds(capsys):
    words = ["bench", "--count", "8", "--control-steps", "5", "--iterations", "1", "--seconds", "0.1", "--calls", "5"]
    assert main([*words, "--json"]) == 0
    printed = capsys.readouterr()
    figures = json.loads(printed.out)
    (training,) = figures["training"]
    assert training["device"] == "cpu" and training["count"] == 8
    assert training["learner"] > training["training"] > 0.0 and training["environment"] > 0.0 < training["bare"]
    activities = "standing", "walking", "jumping", "fetch_box"
    assert set(figures["episodes"]) == {f"{name}, {what}" for name in ("qp", "policy") for what in activities}
    for speed in figures["episodes"].values():
        assert speed["factor"] > 0.0 and speed["physics"] > 1.0 and speed["period_ms"]["p50"] > 0.0
    assert "times real time" in printed.err
    assert set(figures["qp"]) == {"standing", "walking", "jumping"}
    for speed in figures["qp"].values():
        assert speed["unsolved"] == 0.0 and speed["ticks"] == 25
    for times in (
        figures["policy_tick_ms"],
        figures["ik_tick_ms"],
        *(speed[clock] for speed in figures["qp"].values() for clock in ("tick_ms", "cpu_ms")),
    ):
        assert 0.0 < times["p50"] <= times["p99"]
    assert "unsolved QPs: standing 0.00%" in printed.err
    assert "one robot on cpu" in printed.err and "tick [ms]" in printed.err


def test_the_speed_of_training_is_measured_by_number_of_robots(capsys):
    words = ["bench", "--training", "--count", "4", "8", "--control-steps", "3", "--iterations", "1", "--json"]
    assert main([*words, "--device", "cpu"]) == 0
    printed = capsys.readouterr()
    assert [speed["count"] for speed in json.loads(printed.out)["training"]] == [4, 8]
    assert "bare physics" in printed.err and "tick [ms]" not in printed.err
