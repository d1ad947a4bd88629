"""What the tests of the protocols' words and figures share."""

import pytest

from hugwbc.evaluation.conditions import Conditions


def _cells(text: str) -> dict[str, list[str]]:
    cells = [[cell for cell in line.split("  ") if cell.strip()] for line in text.splitlines()]
    return {line[0].strip(): [cell.strip() for cell in line[1:]] for line in cells if line}


@pytest.fixture
def lines():
    """A function that gives the words after each line's first cell, which ends where two spaces begin."""
    return _cells


@pytest.fixture
def standing():
    """The fields of any result of the standing QP."""
    return {
        **{"controller": "qp", "gait": "standing", "seed": 0, "duration": 10.0, "settle": 1.0},
        **{"conditions": Conditions(), "rows": ()},
    }


@pytest.fixture
def walking(standing):
    """The fields of any result of the walking QP."""
    return {**standing, "gait": "walking"}
