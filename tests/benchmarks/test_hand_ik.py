import numpy as np
import pytest

from hugwbc.benchmarks import hand_ik as ik_benchmark
from hugwbc.benchmarks.hand_ik import compare_solvers, sample_targets
from hugwbc.robot import load_robot


def test_half_of_the_targets_are_out_of_reach():
    targets = sample_targets(40, seed=3)
    assert np.array_equal(targets, sample_targets(40, seed=3))
    away = np.linalg.norm(targets - load_robot().shoulder * np.array([[1, 1, 1], [1, -1, 1]]), axis=2)
    assert np.all(away[::2] < 0.65), "the arm is 0.613 m long, its shoulder's axes miss each other by 2 cm"
    assert np.all(away[1::2] > 0.66)


def test_every_solver_visits_the_same_targets_and_ours_keeps_the_limits(monkeypatch):
    pytest.importorskip("mink")
    pytest.importorskip("pink")
    monkeypatch.setattr(ik_benchmark, "TICKS", 60)
    figures = compare_solvers(4)
    assert set(figures) == {"hugwbc", "hugwbc through the body", "mink", "pink"}
    for solver in figures.values():
        assert solver.exceptions == 0
        assert 0.0 <= solver.residual_m < 0.4 and 0.0 <= solver.reached <= 1.0
        assert solver.tick_ms["p50"] > 0.0
    ours = figures["hugwbc"]
    assert ours.limit_violations == 0
    assert ours.jitter < 0.01 * min(figures["mink"].jitter, figures["pink"].jitter)


def test_ours_ends_nearer_to_its_targets_than_the_others_within_reach_and_beyond():
    pytest.importorskip("mink")
    pytest.importorskip("pink")
    targets = sample_targets(16, seed=1)
    ours, mink, pink = (
        ik_benchmark._measure(make(), targets) for make in (ik_benchmark._ours, ik_benchmark._mink, ik_benchmark._pink)
    )
    assert ours.reached > 0.9 and ours.residual_m < 0.01
    assert ours.residual_m <= min(mink.residual_m, pink.residual_m)
    assert ours.excess_m <= min(mink.excess_m, pink.excess_m)
    assert ours.limit_violations == ours.exceptions == 0


def test_what_goes_wrong_is_counted(monkeypatch, robot):
    monkeypatch.setattr(ik_benchmark, "TICKS", 10)
    calls = iter(range(1000))

    def jumps_and_raises(_):
        if next(calls) % 2:
            raise RuntimeError
        return robot.upper[robot.arms] + 0.1

    figures = ik_benchmark._measure(jumps_and_raises, sample_targets(2, seed=0))
    assert figures.exceptions == 10
    assert figures.limit_violations == 20
