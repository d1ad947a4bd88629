"""Observations of the task environments: robot and objects as one row of numbers."""

from collections.abc import Mapping

import numpy as np

from hugwbc import rotations
from hugwbc.behaviours.hands import points_in
from hugwbc.gait import Gait
from hugwbc.robot import Robot
from hugwbc.scripts.view import View
from hugwbc.sim.scenes import Choice, Uniform
from hugwbc.tasks import Shapes

LARGEST = 1e4  # bound of every number
_OBJECT = 9  # numbers of an object
_ROBOT_FIELDS = {
    "gravity": 3,
    "angular_velocity": 3,
    "velocity": 3,
    "position": 3,
    "heading": 2,
    "q": -1,  # one for each joint
    "dq": -1,
    "walk": 1,
    "command": 6,
    "hands": 6,
    "hand_targets": 6,
    "hands_used": 2,
    "hand_force": 6,
    "held": 2,
    "time": 1,
}


class ObservationLayout:
    """The order of the numbers, and how they are made of a `View`.

    Attributes:
        fields: where each part stands in the row, by its name. Objects are "object/NAME", the dimensions that a robot
            is told of them "shape/NAME".
        size: numbers of a row.
    """

    def __init__(self, robot: Robot, bodies: tuple[str, ...], shapes: Shapes) -> None:
        """Set the order, for the joints of a robot and the bodies of a scene with the shapes of any episode."""
        self._nominal, self._bodies = robot.nominal, bodies
        sizes = {name: len(numbers) for name, numbers in dimensions(shapes).items()}
        joints = len(robot.joint_names)
        parts = {name: joints if size < 0 else size for name, size in _ROBOT_FIELDS.items()}
        parts |= {f"object/{name}": _OBJECT for name in bodies}
        parts |= {f"shape/{name}": size for name, size in sizes.items() if size}
        ends = np.cumsum(list(parts.values())).tolist()
        self.fields = {name: slice(end - size, end) for (name, size), end in zip(parts.items(), ends, strict=True)}
        self.size = ends[-1]

    def row(self, view: View, shapes: Shapes, points: np.ndarray, gone: float) -> np.ndarray:
        """Return the observation within `LARGEST`, shape (size,), float32; what is unknown or NaN is 0.

        Args:
            view: what is known now.
            shapes: what is told of the objects in this episode.
            points: targets of the hands in the heading frame [m], shape (2, 3); NaN for a hand without one.
            gone: share of the time limit that is over.
        """
        state, axes = view.state, rotations.rotation_z(view.state.yaw)
        command = view.last.command
        parts: list[object] = [
            state.projected_gravity,
            state.angular_velocity,
            np.zeros(3) if state.velocity is None else state.velocity @ axes,
            view.position,
            (np.cos(state.yaw), np.sin(state.yaw)),
            state.q - self._nominal,
            state.dq,
            float(command.gait is not Gait.STANDING),
            (command.v_x, command.v_y, command.omega, command.h, command.p, command.w),
            points_in(view, view.hands, "heading"),
            points,
            np.isfinite(points).all(axis=1),
            np.zeros(6) if view.hand_force is None else view.hand_force @ axes,
            [name is not None for name in view.held],
            gone,
            *(_seen(view, name, axes) for name in self._bodies),
            *dimensions(shapes).values(),
        ]
        row = np.concatenate([np.ravel(np.asarray(part, dtype=float)) for part in parts])
        return np.clip(np.nan_to_num(row, nan=0.0, posinf=LARGEST, neginf=-LARGEST), -LARGEST, LARGEST).astype(
            np.float32
        )


def _seen(view: View, name: str, axes: np.ndarray) -> np.ndarray:
    """Return an object's place from the pelvis [m] and its x and z axes in the heading frame, shape (9,)."""
    if name not in view.objects:
        return np.zeros(_OBJECT)
    thing = view.objects[name]
    turn = axes.T @ rotations.to_matrix(thing.orientation)
    return np.concatenate(((thing.position - view.position) @ axes, turn[:, 0], turn[:, 2]))


def dimensions(shapes: Shapes) -> dict[str, list[float]]:
    """Return the numbers among the dimensions of each object, in order; words, such as the side of a hinge, are not."""
    return {name: [number for value in known.values() for number in _numbers(value)] for name, known in shapes.items()}


def _numbers(value: object) -> list[float]:
    if isinstance(value, Uniform | Choice):  # before an episode is drawn, one number whose value does not matter
        return [0.0]
    if isinstance(value, int | float) and not isinstance(value, bool):
        return [float(value)]
    if isinstance(value, Mapping):
        return [number for inner in value.values() for number in _numbers(inner)]
    return [number for inner in value for number in _numbers(inner)] if isinstance(value, tuple | list) else []
