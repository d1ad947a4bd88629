"""The program that looks at what a learner sees."""

import math
import pathlib
import sys

import numpy as np
import pytest
import torch

SNAPSHOT = pathlib.Path(__file__).parents[2] / "models" / "h1" / "policies" / "h1" / "snapshot.safetensors"


@pytest.fixture(scope="module")
def probe(load_tool):
    return load_tool("learner_probe")


def test_an_error_is_its_bias_its_repeating_part_and_the_rest(probe):
    generator = torch.Generator().manual_seed(0)
    phase = (torch.arange(5000) * 0.0413)[:, None] % 1.0
    noise = 0.05 * torch.randn((5000, 1, 3), generator=generator)
    error = 0.1 + 0.2 * torch.sin(2.0 * math.pi * phase)[..., None] + noise
    bias, stride, rest = probe._parts(error, phase)
    for part, expected in ((bias, 0.1), (stride, 0.2 / math.sqrt(2.0)), (rest, 0.05)):
        assert part.flatten().tolist() == pytest.approx([expected] * 3, abs=0.005)


def test_the_shipped_snapshot_walks_as_it_is_told(probe, capsys):
    probe.walks(probe.Subject(SNAPSHOT, 0.1, None), each=1, seconds=3.0)
    *cells, whole = capsys.readouterr().out.splitlines()[1:]
    assert len(cells) == sum(map(len, probe.WALKS.values())) and all(": " in line for line in cells)
    assert f"{len(cells)} upright" in whole
    bias = [float(number) for number in whole.split("/s,")[1].split("|")[0].split()]
    assert np.abs(bias).max() < 0.1


def test_the_gradient_is_looked_at_by_gait_and_along_two_directions(probe, capsys, monkeypatch):
    settings = ["--each", "0", "--robots", "16", "--steps", "6", "--batch", "32"]
    monkeypatch.setattr(sys, "argv", ["learner_probe.py", str(SNAPSHOT), *settings])
    probe.main()
    lines = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert lines == ["walking", "cosine", "all", "walking", "standing", "jumping", "hopping", "slope", "v_x", "omega"]
