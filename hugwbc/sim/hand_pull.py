"""A steady force at the hands of a simulated robot, with a slow ramp."""

import numpy as np

from hugwbc import rotations
from hugwbc.kinematics import Kinematics
from hugwbc.robot import SIDES
from hugwbc.sim.engine import Engine
from hugwbc.state import RobotState


class HandPull:
    """Pulls at the hand frames of both hands, half of the force at each.

    The direction is fixed in the robot's heading when the force sets in.

    Attributes:
        force: force on each hand in the world now [N], shape (2, 3).
    """

    def __init__(self, simulation: Engine, vector: np.ndarray, start: float, rise: float) -> None:
        """Set up for a robot.

        Args:
            simulation: the robot.
            vector: the whole force in the heading frame [N], shape (3,).
            start: when it begins to rise [s].
            rise: time in which it rises to its full size [s].
        """
        self._vector, self._start, self._rise = np.asarray(vector, dtype=float), start, max(rise, 1e-6)
        self._simulation, self._kinematics = simulation, Kinematics(simulation.robot)
        names = simulation.robot.hand_links
        self._rows = [simulation.link_names.index(name) for name in names]
        model = self._kinematics.model
        # From the link's centre of mass, at which the engine applies forces, to the hand, in the link's frame.
        self._arms = [
            simulation.robot.hand - model.inertias[model.frames[model.getFrameId(n)].parentJoint].lever for n in names
        ]
        self._links = names
        self._yaw: float | None = None
        self.force = np.zeros((len(SIDES), 3))

    def update(self, state: RobotState) -> None:
        """Set the forces of the next physics step from the true state."""
        elapsed = state.time - self._start
        if elapsed < 0.0:
            return
        if self._yaw is None:
            self._yaw = state.yaw
        each = 0.5 * min(elapsed / self._rise, 1.0) * rotations.rotation_z(self._yaw) @ self._vector
        self._kinematics.update(state)
        for hand, (row, link, arm) in enumerate(zip(self._rows, self._links, self._arms, strict=True)):
            self.force[hand] = each
            wrench = self._simulation.external_force[row]
            wrench[:3], wrench[3:] = each, np.cross(self._kinematics.rotation(link) @ arm, each)
