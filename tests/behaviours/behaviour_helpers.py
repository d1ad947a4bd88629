"""Views for behaviours without a simulation."""

import numpy as np

from hugwbc.robot import load_robot
from hugwbc.scripts.view import SeenObjects, View
from hugwbc.state import RobotState

ROBOT = load_robot()


def view(
    time: float = 0.0,
    *,
    position: tuple[float, float, float] = (0.0, 0.0, 0.98),
    yaw: float = 0.0,
    hands: object = ((0.3, 0.2, 1.0), (0.3, -0.2, 1.0)),
    **more: object,
) -> View:
    """Return a view of a robot at rest."""
    state = RobotState(
        q=ROBOT.nominal.copy(),
        dq=np.zeros(19),
        orientation=np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)]),
        angular_velocity=np.zeros(3),
        position=np.array(position),
        velocity=np.zeros(3),
        time=time,
    )
    return View(time=time, state=state, hands=np.array(hands, dtype=float), **more)  # type: ignore[arg-type]


def objects(**places: tuple[float, float, float]) -> SeenObjects:
    """Return objects at places, unturned."""
    poses = np.array([[*place, 1.0, 0.0, 0.0, 0.0] for place in places.values()])
    return SeenObjects(tuple(places), poses)
