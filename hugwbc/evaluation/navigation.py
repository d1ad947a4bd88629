"""A walk from waypoint to waypoint: velocity commands from where the robot is, as an operator would give them."""

import dataclasses
import math

import numpy as np

from hugwbc import rotations
from hugwbc.commands import Command
from hugwbc.errors import ConfigError
from hugwbc.gait import Gait
from hugwbc.state import RobotState
from hugwbc.targets import HandTargets

GAIN = 1.0  # [1/s], velocity for a distance
LIMITS = {"v_x": (-0.4, 0.8), "v_y": (-0.3, 0.3), "omega": (-0.8, 0.8)}  # [m/s], [rad/s]


@dataclasses.dataclass(frozen=True)
class Waypoint:
    """Where the pelvis should be, in the world: x and y [m], yaw [rad]."""

    x: float
    y: float
    yaw: float


@dataclasses.dataclass(frozen=True)
class Tour:
    """Waypoints, each of which is aimed at for the same time.

    Attributes:
        waypoints: at least one.
        leg: time for each [s]; the last one holds.
        gait: of the walk.
    """

    waypoints: tuple[Waypoint, ...]
    leg: float
    gait: Gait = Gait.WALKING

    def __post_init__(self) -> None:
        if not self.waypoints or not 0.0 < self.leg < math.inf:
            raise ConfigError(
                f"a tour of {len(self.waypoints)} waypoints, {self.leg} s each; give 1 or more, a finite time above 0 s"
            )

    def waypoint_at(self, t: float) -> Waypoint:
        """The one that is aimed at at time t [s]."""
        return self.waypoints[min(max(int(t / self.leg + 1e-9), 0), len(self.waypoints) - 1)]


class Navigator:
    """The command source of a tour; it has to `follow` the robot's true state.

    The velocity is proportional to the distance, in the heading frame, and limited; so is the yaw rate to the angle.
    """

    def __init__(self, tour: Tour) -> None:
        """Start at the origin."""
        self._tour = tour
        self._xy, self._yaw = np.zeros(2), 0.0

    def follow(self, state: RobotState) -> None:
        """See where the robot is."""
        assert state.position is not None
        if state.is_finite:
            self._xy, self._yaw = state.position[:2].copy(), state.yaw

    def command_at(self, t: float) -> Command:
        """Towards the waypoint of time t [s], from where the robot was seen last."""
        goal = self._tour.waypoint_at(t)
        away = rotations.rotation_z(-self._yaw)[:2, :2] @ (np.array([goal.x, goal.y]) - self._xy)
        wanted = {"v_x": away[0], "v_y": away[1], "omega": rotations.wrap_angle(goal.yaw - self._yaw)}
        velocities = {name: float(np.clip(GAIN * value, *LIMITS[name])) for name, value in wanted.items()}
        return Command(**velocities, gait=self._tour.gait)

    def hands_at(self, t: float) -> HandTargets | None:
        """None: the arms are the controller's, or the conditions' intervention's."""
        return None
