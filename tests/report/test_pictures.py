import numpy as np
import pytest

from hugwbc.evaluation.picture_data import Curves, GaitDiagram, HeatMaps, Polar
from hugwbc.report.pictures import colours_controllers, draw
from hugwbc.viz.framing import LABEL_COLOURS

NUMBERS = np.array([0.0, 1.0])
CONTACT = np.array([[True, False], [False, True]])
PICTURES = [
    Curves("T", {"a": (NUMBERS, NUMBERS), "b": (NUMBERS[:0], NUMBERS[:0])}, ("x", "y"), dashed=(NUMBERS, NUMBERS)),
    Polar("T", [0.0, 1.0, 2.0], {"a": [1.0, None, 2.0], "b": [1.0, 1.0, 1.0]}, "N"),
    HeatMaps("T", ["h", "p"], {("h", "p"): np.ones((2, 2)), ("p", "h"): np.full((2, 2), np.nan)}, "times"),
    GaitDiagram("T", NUMBERS, CONTACT, np.zeros((2, 2)), "b", 2.0),
]


@pytest.mark.parametrize("picture", PICTURES, ids=lambda picture: type(picture).__name__)
def test_every_kind_of_picture_is_drawn(picture):
    panel = draw(picture, ["a", "b"])
    assert panel.title.startswith("T") and "<svg" in panel.svg


def test_bars_have_the_colour_of_their_controller_and_maps_need_no_legend():
    svg = draw(PICTURES[3], ["a", "b"]).svg.lower()
    assert LABEL_COLOURS[1].lower() in svg and LABEL_COLOURS[0].lower() not in svg
    assert [colours_controllers(picture) for picture in PICTURES] == [True, True, False, True]
