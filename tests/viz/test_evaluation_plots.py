"""Pictures of evaluations: where the marks are, and that they take the page's colours."""

import re
import xml.etree.ElementTree as ET

import numpy as np

from hugwbc.viz.evaluation_plots import curves, gait_diagram, polar
from hugwbc.viz.framing import LABEL_COLOURS, spans

SVG = "{http://www.w3.org/2000/svg}"


def _texts(svg: str) -> list[str]:
    return ["".join(node.itertext()).strip() for node in ET.fromstring(svg).iter(f"{SVG}text")]


def _is_picture(svg: str) -> None:
    root = ET.fromstring(svg)
    assert root.get("viewBox") and root.get("width") is None
    assert "currentColor" in svg and "#010203" not in svg


def test_polar_has_a_closed_curve_a_name_and_gaps() -> None:
    angles = np.arange(4) * np.pi / 2
    panel = polar("Forces", angles.tolist(), {"learned": [1.0, 2.0, 1.0, 2.0], "qp": [1.0, None, 1.0, 1.0]}, "N")
    _is_picture(panel.svg)
    assert {"0°", "90°", "180°", "270°"} <= set(_texts(panel.svg))
    assert all(colour in panel.svg for colour in LABEL_COLOURS[:2])


def test_gait_diagram_has_a_bar_for_every_stance_and_the_left_foot_above() -> None:
    time = np.arange(100) * 0.02
    contact = np.zeros((100, 2), dtype=bool)
    contact[25:75, 0] = contact[90:, 0] = True
    assert spans(time, contact[:, 1]) == []
    np.testing.assert_allclose(spans(time, contact[:, 0]), [(0.5, 1.5), (1.8, 1.98)])
    panel = gait_diagram("walking", time, contact, np.zeros((100, 2)), 0, 2.0)
    _is_picture(panel.svg)
    root = ET.fromstring(panel.svg)
    bars = [g for g in root.iter(f"{SVG}g") if "Collection" in (g.get("id") or "")]
    assert [len(list(bar.iter(f"{SVG}path"))) for bar in bars] == [2, 0]
    labels = {"".join(n.itertext()).strip(): n for n in root.iter(f"{SVG}text")}

    def height(name: str) -> float:
        place = re.search(r"translate\([-\d.]+ ([-\d.]+)\)", labels[name].get("transform") or "")
        return float(place.group(1)) if place else float(labels[name].get("y") or "nan")

    assert height("left") < height("right")


def test_curves_without_a_point_say_so() -> None:
    nothing = np.zeros(0)
    assert "nothing was measured" in curves("p", {"qp": (nothing, nothing)}, ("x", "y")).svg
    assert "nothing" not in curves("p", {"qp": (np.zeros(1), np.zeros(1))}, ("x", "y")).svg


def test_curves() -> None:
    series = {"a": (np.arange(3.0), np.arange(3.0)), "b": (np.arange(30.0), np.full(30, np.nan))}
    panel = curves("Reward", series, ("steps", "reward"))
    _is_picture(panel.svg)
    assert {"steps", "reward"} <= set(_texts(panel.svg))
