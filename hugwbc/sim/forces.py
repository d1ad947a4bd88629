"""Planned forces on the robot: vector, link and time."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from hugwbc import rotations
from hugwbc.errors import UnknownNameError
from hugwbc.settings import NotNegative, Positive, settings

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
            qpos: positions of the robot, shape (26,); its yaw turns forces in the heading frame.
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
