"""The record of one episode of a task: the true states of robot and objects, from which a judge decides."""

import dataclasses
from collections.abc import Mapping
from typing import Protocol

import numpy as np

from hugwbc import rotations
from hugwbc.errors import ConfigError
from hugwbc.robot import SIDES
from hugwbc.runtime.trace import RECORD_PERIOD
from hugwbc.sim import Scene, Simulation
from hugwbc.sim.scenes import Thing

_LOOK = 5  # physics steps from one look at the contacts to the next
_HANDS = tuple(f"{side}_elbow_link" for side in SIDES)


class Samples(Protocol):
    """The part of a `Trace` that a record needs, of a finished or running episode."""

    @property
    def time(self) -> np.ndarray:
        """Times of the samples [s], shape (T,)."""
        ...

    @property
    def qpos(self) -> np.ndarray:
        """Pelvis position [m], quaternion (w, x, y, z) and joint positions [rad], shape (T, 26)."""
        ...

    @property
    def hand_force(self) -> np.ndarray:
        """Force on each hand from outside in the world [N], shape (T, 2, 3)."""
        ...

    @property
    def hand_error(self) -> np.ndarray:
        """Distance of each hand from its target [m], shape (T, 2); NaN without one."""
        ...

    @property
    def object_pose(self) -> np.ndarray:
        """Position [m] and quaternion of every body of the scene, shape (T, bodies, 7)."""
        ...

    @property
    def fell(self) -> bool:
        """Whether the robot fell."""
        ...

    @property
    def problems(self) -> tuple[str, ...]:
        """What went wrong with the objects."""
        ...


@dataclasses.dataclass(frozen=True)
class Ending:
    """How a behaviour ended.

    Attributes:
        succeeded: whether it says that it has done what it was meant to do.
        reason: why it gave up; where the time limit stopped it, what it was doing.
        time: when it ended [s]; None if the time limit stopped it.
    """

    succeeded: bool
    reason: str = ""
    time: float | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class TaskRecord:
    """True states of an episode: T samples, one every `RECORD_PERIOD`.

    Attributes:
        scene: the objects around the robot, as drawn.
        time: times of the samples [s], shape (T,).
        pelvis: position [m] and quaternion (w, x, y, z), shape (T, 7).
        hands: positions of the left and the right hand in the world [m], shape (T, 2, 3).
        hand_force: force on each hand from outside in the world [N], shape (T, 2, 3).
        hand_error: distance of each hand from its target [m], shape (T, 2); NaN without one.
        poses: position [m] and quaternion of each body of the scene by its name, shape (T, 7) each.
        travel: way of each thing with a joint from its rest [m or rad] by its name, shape (T,) each.
        held: number of the object that the idealised gripper of each hand holds, its place in `Scene.body_names`;
            -1 for none. Shape (T, 2).
        touched: time of the first contact between a part of the robot and a body of the scene [s], by their names.
            The hands (with their forearms) are "left_elbow_link" and "right_elbow_link".
        depth: how deep a hand was in each body that it touched, at most [m].
        fell: whether the robot fell, or the physics diverged.
        ending: how the behaviour ended.
        problems: what went wrong with the objects, such as one that left the world.
    """

    scene: Scene
    time: np.ndarray
    pelvis: np.ndarray
    hands: np.ndarray
    hand_force: np.ndarray
    hand_error: np.ndarray
    poses: Mapping[str, np.ndarray]
    travel: Mapping[str, np.ndarray]
    held: np.ndarray
    touched: Mapping[tuple[str, str], float]
    depth: Mapping[str, float]
    fell: bool
    ending: Ending
    problems: tuple[str, ...] = ()

    def thing(self, name: str) -> Thing:
        """Return an object of the scene as drawn."""
        for thing in self.scene.objects:
            if thing.name == name:
                return thing
        raise ConfigError(f"there is no object '{name}' in the scene; there are {', '.join(self.scene.body_names)}")

    def tilt(self, name: str) -> np.ndarray:
        """Return the angle between an object's z axis and the vertical [rad], shape (T,)."""
        _, x, y, _ = self.poses[name][:, 3:].T
        return np.arccos(np.clip(1.0 - 2.0 * (x * x + y * y), -1.0, 1.0))

    def yaw(self, name: str) -> np.ndarray:
        """Return an object's heading [rad], shape (T,)."""
        return np.asarray(rotations.yaw_of(self.poses[name][:, 3:]))

    def speed(self, name: str) -> np.ndarray:
        """Return an object's speed, shape (T,) [m/s]; 0 in the first sample."""
        steps = np.linalg.norm(np.diff(self.poses[name][:, :3], axis=0), axis=1) / RECORD_PERIOD
        return np.concatenate(([0.0], steps))

    def touches(self, links: tuple[str, ...], body: str) -> bool:
        """Return whether a part of the robot touched a body of the scene."""
        return any((link, body) in self.touched for link in links)

    @property
    def gripped(self) -> tuple[str, ...]:
        """Names of the bodies that the idealised grippers held at some time."""
        names = self.scene.body_names
        return tuple(names[index] for index in sorted(set(self.held.ravel().tolist()) - {-1}))


class TaskWatch:
    """A watch over one episode, which notes what a `Trace` does not have: contacts, grips and joints of objects.

    `look` is called after each physics step, `sample` at each sample of the trace.
    """

    def __init__(self, simulation: Simulation) -> None:
        """Find the bodies.

        Args:
            simulation: robot and objects.
        """
        if simulation.scene is None:
            raise ConfigError("a task needs objects; give the simulation the task's scene")
        self._simulation, self._scene, model = simulation, simulation.scene, simulation.model
        names = self._scene.body_names
        self._objects = {model.body(name).id: name for name in names}
        robot = set(simulation.link_names) - set(names) - {"world"}
        self._links = {model.body(name).id: name for name in robot}
        self._is_object = np.zeros(model.nbody, dtype=bool)
        self._is_object[list(self._objects)] = True
        self._jointed = [name for name in names if simulation.objects[name].travel is not None]
        self._steps = 0
        self._touched: dict[tuple[str, str], float] = {}
        self._depth: dict[str, float] = {}
        self._hands: list[np.ndarray] = []
        self._travel: list[list[float]] = []
        self._held: list[list[int]] = []

    def look(self) -> None:
        """Note which parts of the robot touch which objects, and how deep the hands are in them."""
        self._steps += 1
        if self._steps % _LOOK:
            return
        contact = self._simulation.data.contact
        bodies = self._simulation.model.geom_bodyid[contact.geom]
        mixed = self._is_object[bodies].any(axis=1) & (contact.dist < 0.0)
        for index in np.flatnonzero(mixed):
            one, other = bodies[index].tolist()
            link = self._links.get(one) or self._links.get(other)
            name = self._objects.get(one) or self._objects.get(other)
            if link is None or name is None:
                continue
            self._touched.setdefault((link, name), self._simulation.time)
            if link in _HANDS:
                self._depth[name] = max(self._depth.get(name, 0.0), -float(contact.dist[index]))

    def sample(self) -> None:
        """Note hands, joints and grips of one sample."""
        simulation, names = self._simulation, self._scene.body_names
        self._hands.append(np.stack([simulation.hand_position(side) for side in SIDES]))
        self._travel.append([simulation.objects[name].travel or 0.0 for name in self._jointed])
        gripper = simulation.gripper
        held = [None if gripper is None else gripper.held(side) for side in SIDES]
        self._held.append([-1 if name is None else names.index(name) for name in held])

    def record(self, trace: Samples, ending: Ending) -> TaskRecord:
        """Return the record of the episode up to now.

        Args:
            trace: has as many samples as `sample` was called.
            ending: how the behaviour ended.
        """
        travel = np.array(self._travel).reshape(len(trace.time), len(self._jointed))
        return TaskRecord(
            scene=self._scene,
            time=trace.time,
            pelvis=trace.qpos[:, :7],
            hands=np.array(self._hands),
            hand_force=trace.hand_force,
            hand_error=trace.hand_error,
            poses={name: trace.object_pose[:, i] for i, name in enumerate(self._scene.body_names)},
            travel={name: travel[:, i] for i, name in enumerate(self._jointed)},
            held=np.array(self._held, dtype=int).reshape(len(trace.time), 2),
            touched=dict(self._touched),
            depth=dict(self._depth),
            fell=trace.fell,
            ending=ending,
            problems=trace.problems,
        )
