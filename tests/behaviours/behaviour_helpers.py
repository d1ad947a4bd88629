"""Views for behaviours without a simulation."""

import numpy as np

from hugwbc.scripts.view import SeenObjects, View
from tests.conftest import make_state


def view(
    time: float = 0.0,
    *,
    position: tuple[float, float, float] = (0.0, 0.0, 0.98),
    yaw: float = 0.0,
    hands: object = ((0.3, 0.2, 1.0), (0.3, -0.2, 1.0)),
    **more: object,
) -> View:
    """Return a view of a robot at rest."""
    state = make_state(yaw=yaw, position=position, velocity=np.zeros(3), time=time)
    return View(time=time, state=state, hands=np.array(hands, dtype=float), **more)  # type: ignore[arg-type]


def objects(**places: tuple[float, float, float]) -> SeenObjects:
    """Return objects at places, unturned."""
    poses = np.array([[*place, 1.0, 0.0, 0.0, 0.0] for place in places.values()])
    return SeenObjects(tuple(places), poses)
