"""Forces on the robot: planned ones by vector, link and time, and a steady pull at the hands with a slow ramp."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from hugwbc import rotations
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.kinematics import Kinematics
from hugwbc.robot import SIDES
from hugwbc.settings import NotNegative, Positive, settings
from hugwbc.sim.engine import Engine
from hugwbc.state import RobotState

_ROUNDING = 1e-9  # [s], tolerance for rounding errors in sums of time steps


@settings
class Force:
    """A force that acts at the centre of mass of a link and is constant while it acts.

    Attributes:
        vector: the force [N].
        start: time at which it sets in [s].
        duration: how long it acts [s]; None if it never ends.
        link: name of the link; None for the trunk.
        frame: "world", or "heading": turned by the robot's yaw when the force sets in, then constant in the world.
    """

    vector: tuple[float, float, float]
    start: NotNegative = 0.0
    duration: Positive | None = None
    link: str | None = None
    frame: Literal["world", "heading"] = "world"

    def acts_at(self, t: float) -> bool:
        """Return whether it acts in the physics step that begins at time t [s]."""
        begun = t >= self.start - _ROUNDING
        return begun and (self.duration is None or t < self.start + self.duration - _ROUNDING)


class Disturber:
    """Applies forces to one robot; forces that act on the same link at the same time add up."""

    def __init__(self, link_names: Sequence[str], trunk: str, forces: Sequence[Force]) -> None:
        """Find the links.

        Args:
            link_names: names of the rows of the array that `update` writes; the first is the world.
            trunk: name of the trunk's link.
            forces: the planned forces.
        """
        if not isinstance(forces, Sequence) or not all(isinstance(force, Force) for force in forces):
            raise ConfigError(f"forces is {forces}; give a sequence of Force, such as [Force((100.0, 0.0, 0.0))]")
        links = {name: row for row, name in enumerate(link_names) if row > 0}
        for force in forces:
            if (force.link or trunk) not in links:
                raise UnknownNameError("link", force.link, links)
        self._forces = tuple(forces)
        self._rows = [links[force.link or trunk] for force in forces]
        self._acting: dict[int, np.ndarray] = {}

    def update(self, t: float, qpos: np.ndarray, external_force: np.ndarray) -> None:
        """Set the forces for the physics step that begins at time t; only the links of its forces are written.

        Args:
            t: time [s].
            qpos: positions of the robot, shape (7 + n,); its yaw turns forces in the heading frame.
            external_force: forces and torques on the links in the world [N, N*m], shape (links, 6); written in place.
        """
        acting = {i for i, force in enumerate(self._forces) if force.acts_at(t)}
        if acting == self._acting.keys():
            return
        self._acting = {i: self._acting[i] if i in self._acting else self._in_world(i, qpos) for i in acting}
        for row in set(self._rows):
            on_link = [vector for i, vector in self._acting.items() if self._rows[i] == row]
            external_force[row, :3] = np.sum(on_link, axis=0) if on_link else 0.0

    def _in_world(self, index: int, qpos: np.ndarray) -> np.ndarray:
        force = self._forces[index]
        vector = np.array(force.vector)
        return vector if force.frame == "world" else rotations.rotation_z(float(rotations.yaw_of(qpos[3:7]))) @ vector


class HandPull:
    """Pulls at the hand frames of both hands, half of the force at each.

    Its vector is turned by the robot's yaw when the force sets in, and from then on fixed in the world.
    """

    def __init__(self, simulation: Engine, vector: np.ndarray, start: float, rise: float) -> None:
        """Pull with a force in the heading frame [N], shape (3,), from `start` [s] on, in full after `rise` [s]."""
        self._vector, self._start, self._rise = np.asarray(vector, dtype=float), start, max(rise, 1e-6)
        self._simulation, self._kinematics = simulation, Kinematics(simulation.robot)
        names = simulation.robot.hand_links
        self._rows = [simulation.link_names.index(name) for name in names]
        model = self._kinematics.model
        # From the link's centre of mass, at which the engine applies forces, to the hand, in the link's frame.
        self._arms = [
            hand - model.inertias[model.frames[self._kinematics.frame_id(name)].parentJoint].lever
            for hand, name in zip(simulation.robot.hands, names, strict=True)
        ]
        self._links = names
        self._yaw: float | None = None
        self.force = np.zeros((len(SIDES), 3))  # force on each hand in the world now [N], shape (2, 3)

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
