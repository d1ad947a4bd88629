"""Walks of a point that follows its commands, without physics."""

import numpy as np
import pytest
from behaviour_helpers import view

from hugwbc.behaviours import BehaviourSource, Status, walk_to
from hugwbc.behaviours.walk import POSITION_TOLERANCE
from hugwbc.gait import Gait

DT = 0.02


def _walk(jump: tuple[float, float]) -> tuple[np.ndarray, int]:
    """Walk without turning; each stop moves the robot by `jump` [m]. Return where it ends and the number of stops."""
    place, stops = np.zeros(2), 0
    now, walk = view(), BehaviourSource(lambda view: walk_to(view, (0.4, 0.2), 0.0))
    while True:
        before, action = now.last.command, walk.act(now)
        if walk.status is not Status.RUNNING:
            assert walk.status is Status.SUCCESS, walk.reason
            return place, stops
        command = action.command
        if before.gait is Gait.WALKING and command.gait is Gait.STANDING:
            place, stops = place + np.array(jump), stops + 1
        place = place + DT * np.array([command.v_x, command.v_y])
        now = view(now.time + DT, position=(*place.tolist(), 0.98), last=action)


@pytest.mark.parametrize("jump", [(0.08, 0.0), (-0.05, 0.06)])
def test_a_walk_aims_off_by_what_a_stop_has_moved_the_robot(jump: tuple[float, float]) -> None:
    place, stops = _walk(jump)
    assert np.hypot(*(place - (0.4, 0.2))) < 0.5 * POSITION_TOLERANCE
    assert stops == 2, "the first stop shows it, the second makes up for it"


def test_a_walk_whose_stops_move_nothing_stands_once() -> None:
    assert _walk((0.0, 0.0))[1] == 1
