"""The strip of gait phases."""

import re

import numpy as np
import pytest

from hugwbc.viz.gait_bar import CONTACT, gait_bar
from hugwbc.viz.overlays import STANCE, SWING


def test_the_strip_says_when_each_foot_stands_by_the_clock_and_in_fact(make_run):
    run = make_run(seconds=2.0)
    bar = gait_bar([run], 0.0, 1.98)
    boxes = re.findall(r'<rect x="([-\d.]+)" y="(\d+)" width="([\d.]+)" height="\d+" fill="(#\w+)"/>', bar)
    left = [(float(x), float(x) + float(w), c) for x, y, w, c in boxes if y == "0" and c in (STANCE, SWING)]
    # The walk starts with the left foot in swing, half a second at a time.
    assert [(round(a, 2), round(b, 2), c) for a, b, c in left] == [
        (0.0, 0.5, SWING), (0.5, 1.0, STANCE), (1.0, 1.5, SWING), (1.5, 1.98, STANCE),
    ]  # fmt: skip
    on_ground = sum(float(w) for _, y, w, c in boxes if c == CONTACT and y == "3")
    assert on_ground == pytest.approx(np.count_nonzero(run.foot_contact[:, 0]) / 50, abs=0.03)


def test_names_are_escaped(make_run):
    assert "<title>a &lt;b&gt;</title>" in gait_bar([make_run(name="a <b>")], 0.0, 1.0)
