"""The response to single commands: values, conditions, and the figures of known answers."""

import polars as pl
import pytest

from hugwbc.evaluation.experiments.response import ResponseSettings, figures, values


def test_values_span_the_range_and_hold_the_default_and_slow_velocities() -> None:
    found = values(ResponseSettings(), "v_x")
    assert {-0.2, -0.1, 0.0, 0.1, 0.2, -0.6, 2.0} <= set(found) and found == sorted(found)
    assert 0.15 in values(ResponseSettings(), "l")


def test_gain_bias_and_dead_zone_are_those_of_the_answers() -> None:
    commanded = [-0.4, -0.2, -0.1, 0.0, 0.1, 0.2, 0.4]
    executed = [-0.3, -0.15, 0.01, 0.02, 0.03, 0.17, 0.35]
    rows = [
        {"command": "v_x", "value": value, "executed": answer, "fell": False}
        for value, answer in zip(commanded, executed, strict=True)
    ]
    rows.append({"command": "v_x", "value": 2.0, "executed": None, "fell": True})
    found = {figure.quantity: figure.value for figure in figures(ResponseSettings(), pl.DataFrame(rows))}
    assert found["v_x: gain"] == pytest.approx(0.326 / 0.42), "sum of products over sum of squares"
    assert found["v_x: bias"] == pytest.approx(0.02) and found["v_x: dead zone"] == pytest.approx(0.1)
    assert found["falls"] == pytest.approx(12.5)
