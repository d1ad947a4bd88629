import numpy as np
import pytest

from hugwbc.evaluation.engine import CellResult
from hugwbc.report.figures import FALLS
from hugwbc.report.sections import FIGURES, SECTIONS, all_figures, relative_maps


def row(**fields):
    return {"fell": False, **fields}


SINGLE = {
    "gait": "walking",
    "paper": {"E_h": 0.064, "E_w": 0.075},
    "rows": [row(error_name="E_h", error=0.1), row(error_name="E_h", error=0.3), row(error_name="E_vy", error=None)],
}


def _by_quantity(figures, controller):
    return {f.quantity: f for f in figures if f.controller == controller}


def test_single_commands_beside_the_paper_and_what_it_prints_for_others():
    figures = all_figures([CellResult("single-command", "qp", SINGLE)])
    mine = _by_quantity(figures, "qp")
    assert mine["E_h"].value == pytest.approx(0.2) and mine["E_h"].paper == 0.064 and mine["E_h"].unit == "m"
    assert mine["E_w"].value is None and mine["E_vy"].value is None
    assert mine[FALLS].value == 0.0
    hover = _by_quantity(figures, "HOVER")
    assert hover["E_h"].published == 0.27 and hover["E_h"].estimate is None and hover["E_h"].table == mine["E_h"].table
    assert "E_f" not in hover


def test_ramp_and_contacts():
    rows = [row(command="p", error=0.1), row(command="w", error=0.3)]
    ramp = FIGURES["ramp"](CellResult("ramp", "qp", {"gait": "standing", "paper": {"E_p": 0.07}, "rows": rows}))
    assert [(f.quantity, f.value, f.paper) for f in ramp] == [
        ("E_p", 0.1, 0.07),
        ("E_w", 0.3, None),
        (FALLS, 0.0, None),
    ]
    contacts = {"gait": "jumping", "rows": [row(agreement=0.25), row(agreement=None)]}
    (figure,) = FIGURES["contacts"](CellResult("contacts", "qp", contacts))
    assert (figure.quantity, figure.value, figure.higher_is_better) == ("jumping", 25.0, True)


def test_maps_are_relative_to_the_error_alone_and_turned_for_the_second_command():
    errors = {"h": ((1.0, 2.0), (3.0, None)), "p": ((10.0, 20.0), (30.0, None))}
    result = {
        "gait": "standing",
        "single": {"h": 0.5, "p": 10.0},
        "maps": [{"first": "h", "second": "p", "errors": errors}],
        "orthogonality": [{"tracked": name, "share": share} for name, share in (("h", 0.5), ("h", 1.0), ("p", 0.0))],
        "rows": [row(), row()],
    }
    maps = relative_maps(result)
    np.testing.assert_array_equal(maps["h", "p"], [[2.0, 4.0], [6.0, np.nan]])
    np.testing.assert_array_equal(maps["p", "h"], [[1.0, 3.0], [2.0, np.nan]])
    figures = FIGURES["heatmap"](CellResult("heatmap", "qp", result))
    assert [(f.quantity, f.value) for f in figures] == [("error of h", 75.0), ("error of p", 0.0), (FALLS, 0.0)]


def test_tolerated_forces_have_the_bracket_of_their_search():
    result = {"tolerated": {"second": {"45": 100.0}}, "refused": {"second": {"45": 105.0}}, "rollouts": 16}
    (figure,) = FIGURES["disturbance"](CellResult("disturbance", "qp", result))
    assert (figure.table, figure.quantity, figure.unit) == ("Tolerated force, for one second", "45°", "N")
    assert figure.estimate is not None and figure.higher_is_better
    assert (figure.value, figure.estimate.low, figure.estimate.high) == (100.0, 100.0, 105.0)


def test_tours():
    rows = [
        row(reached=12, survived_s=60.0, position_error=0.2, yaw_error=0.1, blows=12, felled=False),
        {
            "reached": 3,
            "survived_s": 20.0,
            "position_error": 0.4,
            "yaw_error": None,
            "fell": True,
            "blows": 4,
            "felled": True,
        },
    ]
    figures = FIGURES["tour"](CellResult("tour", "qp", {"gait": "walking", "rows": rows}))
    assert [f.value for f in figures] == pytest.approx([50.0, 100.0 * 15 / 16, 62.5, 40.0, 0.3, 0.1])
    assert [f.higher_is_better for f in figures] == [True, True, True, True, False, False]


def test_robustness_is_relative_to_the_unchanged_robot():
    levels = [("nominal", 0.0, 1.0), ("payload", 5.0, 1.5), ("friction", 0.2, None)]
    rows = [row(factor=factor, level=level) for factor, level, _ in levels]
    rows.append(row(factor="payload", level=5.0, fell=True))
    result = {
        "gait": "walking",
        "levels": [{"factor": factor, "level": level, "ratio": ratio} for factor, level, ratio in levels],
        "rows": rows,
    }
    figures = FIGURES["robustness"](CellResult("robustness", "qp", result))
    assert [(f.quantity, f.value) for f in figures] == [
        ("payload 5 kg", 1.5), ("friction 0.2", None), ("nominal", 0.0), ("payload 5 kg", 50.0), ("friction 0.2", 0.0)
    ]  # fmt: skip
    assert figures[0].table != figures[2].table


def test_effort_in_readable_units():
    known = {"v_x": 0.5, "fell": False, "power": 200.0, "torque_rms": 0.25, "torque_peak": 1.0, "joint_speed_peak": 0.5}
    unknown = dict.fromkeys(("cost_of_transport", "torque_rate", "tick_p50_ms", "tick_p99_ms"))
    figures = FIGURES["effort"](CellResult("effort", "qp", {"gait": "walking", "rows": [row(**known, **unknown)]}))
    assert {f.table for f in figures} == {"Effort, walking, 0.5 m/s"}
    assert {(f.value, f.unit) for f in figures} == {
        (200.0, "W"), (25.0, "% of limit"), (100.0, "% of limit"), (50.0, "% of limit"), (0.0, "% of episodes")
    }  # fmt: skip


def test_every_section_has_figures():
    assert {name for section in SECTIONS for name in section.protocols} == set(FIGURES)
