"""Drawings of the experiments' pictures."""

from collections.abc import Sequence

from hugwbc.evaluation.picture_data import Curves, GaitDiagram, HeatMaps, Picture, Polar
from hugwbc.viz import charts
from hugwbc.viz.framing import LABEL_COLOURS
from hugwbc.viz.plots import Panel


def draw(picture: Picture, controllers: Sequence[str]) -> Panel:
    """Draw a picture.

    Args:
        picture: what to draw.
        controllers: labels of the report's controllers, in the order of their colours.
    """
    match picture:
        case Curves(title, series, labels, dashed, bottom):
            return charts.curves(title, series, labels, dashed=dashed, bottom=bottom)
        case Polar(title, angles, series, unit):
            return charts.polar(title, angles, series, unit)
        case HeatMaps(title, names, maps, label):
            return charts.heat_maps(title, names, maps, label)
        case GaitDiagram(title, time, contact, clock, controller, length):
            colour = LABEL_COLOURS[list(controllers).index(controller) % len(LABEL_COLOURS)]
            return charts.gait_diagram(title, time, contact, clock, colour, length)


def colours_controllers(picture: Picture) -> bool:
    """Return whether a picture uses the controllers' colours, so that it needs their legend."""
    return not isinstance(picture, HeatMaps)
