"""Our whole-body QP against placo's."""

import numpy as np


def test_placo_finds_the_same_torques(load_tool, tmp_path, monkeypatch, capsys):
    other_qps = load_tool("other_qps")
    monkeypatch.setattr(other_qps, "STATES", 25)
    other_qps.states(tmp_path / "states.npz")
    data = np.load(tmp_path / "states.npz")
    away = np.abs(data["placo_tau"] - data["ours_tau"]).max(1)
    assert np.abs(data["ours_tau"]).max() > 30.0 and np.median(away) < 0.05 and away.max() < 2.0
    assert "placo" in capsys.readouterr().out
