"""The record of one episode of a task: the true states of robot and objects, from which a judge decides."""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np

from hugwbc import rotations
from hugwbc.errors import UnknownNameError
from hugwbc.robot import SIDES
from hugwbc.runtime.trace import RECORD_PERIOD
from hugwbc.sim import Scene, Simulation
from hugwbc.sim.scenes import Door, Thing

_LOOK = 5  # physics steps from one look at the contacts to the next, at least
_ROUNDING = 1e-9  # [s]
HANDS, _FEET = (tuple(f"{side}_{part}" for side in SIDES) for part in ("hand", "foot"))
TRUNK = ("pelvis", "trunk")
"""What a record calls the links of hands, base and trunk; others but the feet have their own names."""
# The thigh is the last link before the knee: an H1's hip ends with its pitch, a G1's with its yaw. Forearms that end in
# a hand without wrists are called hands.
_WORDS = {"hip_roll": "hip", "hip_pitch": "thigh", "hip_yaw": "thigh", "knee": "shank", "shoulder_roll": "shoulder"}
_WORDS |= {"shoulder_yaw": "upper arm", "elbow": "forearm"}
_UPRIGHT = 0.7  # vertical part of the normal of a contact on which a foot stands
_BRIEF = 0.05  # [s], a touch that needs no duration
_MOVED, _LEANS = 0.05, 0.2  # [m], [rad] from which on an object is not where it was


@dataclasses.dataclass(frozen=True)
class Ending:
    """How a behaviour ended.

    Attributes:
        succeeded: whether it says that it has done what it was meant to do.
        reason: why it gave up; where the time limit or a fall stopped it, what it was doing.
        time: when it ended [s]; None if the time limit or a fall stopped it.
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
        hand_force: force on each hand from outside in the world [N], shape (T, 2, 3); an arm may rest on its own body.
        hand_touches: whether each hand touches a body of the scene, shape (T, 2).
        poses: position [m] and quaternion of each body of the scene by its name, shape (T, 7) each.
        travel: way of each thing with a joint from its rest [m or rad] by its name, shape (T,) each.
        gait: values of `Gait`, as commanded, shape (T,); -1 where nothing tells.
        held: number of the object that the idealised gripper of each hand holds, its place in `Scene.body_names`;
            -1 for none. Shape (T, 2).
        touched: time of the first contact between a part of the robot and a body of the scene [s], by their names.
            Hands, base and trunk are called as in `HANDS` and `TRUNK`. What a foot stands on is left out.
        lasted: how long they touched in all [s], by the same names.
        depth: how deep a hand was in each body that it touched, at most [m].
        fell: whether the robot fell or knelt down (`Trace.down`), or the physics diverged.
        ending: how the behaviour ended.
        problems: what went wrong with the objects, such as one that left the world.
    """

    scene: Scene
    time: np.ndarray
    pelvis: np.ndarray
    hands: np.ndarray
    hand_force: np.ndarray
    hand_touches: np.ndarray
    poses: Mapping[str, np.ndarray]
    travel: Mapping[str, np.ndarray]
    gait: np.ndarray
    held: np.ndarray
    touched: Mapping[tuple[str, str], float]
    lasted: Mapping[tuple[str, str], float]
    depth: Mapping[str, float]
    fell: bool
    ending: Ending
    problems: tuple[str, ...] = ()

    def scaled(self, size: float) -> "TaskRecord":
        """Return the record of a robot and a scene with lengths times a factor."""
        if size == 1.0:
            return self
        place = np.r_[np.full(3, size), np.ones(4)]
        turning = {thing.name for thing in self.scene.objects if isinstance(thing, Door)}
        return dataclasses.replace(
            self,
            scene=self.scene.scaled(size),
            pelvis=place * self.pelvis,
            hands=size * self.hands,
            hand_force=size**3 * self.hand_force,
            poses={name: place * poses for name, poses in self.poses.items()},
            travel={name: way if name in turning else size * way for name, way in self.travel.items()},
            depth={name: size * depth for name, depth in self.depth.items()},
        )

    def thing(self, name: str) -> Thing:
        """Return an object of the scene as drawn."""
        for thing in self.scene.objects:
            if thing.name == name:
                return thing
        raise UnknownNameError("object of the scene", name, [thing.name for thing in self.scene.objects])

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


def bumps(record: "TaskRecord | TaskWatch") -> tuple[str, ...]:
    """Return what besides the hands touched the scene, such as "the left thigh touched 'box' at 7.2 s, for 1.3 s"."""
    found = []
    for (link, body), begin in record.touched.items():
        part, long = link.removesuffix("_link"), record.lasted.get((link, body), 0.0)
        for name, word in _WORDS.items():
            part = part.replace(name, word)
        if link not in HANDS:
            time = f"at {begin:.1f} s" + (f", for {long:.1f} s" if long >= _BRIEF else "")
            found.append(f"the {part.replace('_', ' ')} touched '{body}' {time}")
    return tuple(found)


def displaced(record: TaskRecord) -> tuple[str, ...]:
    """Return where objects ended that are not where they were, such as "'box' ended 0.43 m away, 0.85 m lower"."""
    found = []
    for name, poses in record.poses.items():
        way, tilt = poses[-1, :3] - poses[0, :3], record.tilt(name)
        leans = float(tilt[-1] - tilt[0])
        if not math.isfinite(leans) or (np.linalg.norm(way) < _MOVED and leans < _LEANS):
            continue
        words = [f"{np.hypot(*way[:2]):.2f} m away"]
        words += [f"{abs(way[2]):.2f} m {'higher' if way[2] > 0.0 else 'lower'}"] if abs(way[2]) >= _MOVED else []
        words += [f"tilted by {math.degrees(leans):.0f} degrees"] if leans >= _LEANS else []
        found.append(f"'{name}' ended {', '.join(words)}")
    return tuple(found)


class TaskWatch:
    """A watch over one episode, which notes what a judge needs, with any controller.

    `look` is called after each physics step, or each control period where short touches may be missed; `sample` at
    least every `RECORD_PERIOD`.

    Attributes:
        fell: whether the robot has fallen, or the physics diverged.
        touched, lasted: as in `TaskRecord`, until now.
    """

    def __init__(self, simulation: Simulation) -> None:
        """Find the bodies of robot and objects; the simulation has a scene."""
        assert simulation.scene is not None
        self._simulation, self._scene, model = simulation, simulation.scene, simulation.model
        names = self._scene.body_names
        self._objects = {model.body(name).id: name for name in names}
        robot = set(simulation.link_names) - set(names) - {"world"}
        parts = simulation.robot
        links = (*parts.hand_links, *parts.foot_links, parts.base, parts.trunk)
        called = dict(zip(links, (*HANDS, *_FEET, *TRUNK), strict=True))
        self._links = {model.body(name).id: called.get(name, name) for name in robot}
        self._is_object = np.zeros(model.nbody, dtype=bool)
        self._is_object[list(self._objects)] = True
        self._jointed = [name for name in names if simulation.objects[name].travel is not None]
        self.fell = False
        self.touched: dict[tuple[str, str], float] = {}
        self.lasted: dict[tuple[str, str], float] = {}
        self._looked = simulation.time
        self._touching: set[tuple[str, str]] = set()  # at the last look
        self._depth: dict[str, float] = {}
        self._samples: dict[str, list[np.ndarray]] = {}
        self._count = 0

    def look(self) -> None:
        """Note falls, which parts of the robot touch which objects, and how deep the hands are in them."""
        self.fell = self.fell or self._simulation.fallen
        now = self._simulation.time
        since = now - self._looked
        if 0.0 <= since < (_LOOK - 0.5) * self._simulation.timestep:
            return
        since, self._looked = max(since, 0.0), now  # below 0 after a reset
        contact, self._touching = self._simulation.data.contact, set()
        bodies = self._simulation.model.geom_bodyid[contact.geom]
        mixed = self._is_object[bodies].any(axis=1) & (contact.dist < 0.0)
        for index in np.flatnonzero(mixed):
            one, other = bodies[index].tolist()
            link = self._links.get(one) or self._links.get(other)
            name = self._objects.get(one) or self._objects.get(other)
            if link is None or name is None or (link in _FEET and abs(contact.frame[index][2]) > _UPRIGHT):
                continue
            self._touching.add((link, name))
            if link in HANDS:
                self._depth[name] = max(self._depth.get(name, 0.0), -float(contact.dist[index]))
        for pair in sorted(self._touching):
            self.touched.setdefault(pair, now)
            self.lasted[pair] = self.lasted.get(pair, 0.0) + since

    def sample(self, time: float, gait: int = -1) -> None:
        """Take a sample at a time since the start of the episode [s], if one is due; `gait` is what is commanded."""
        if time < self._count * RECORD_PERIOD - _ROUNDING:
            return
        self._count += 1
        simulation, names = self._simulation, self._scene.body_names
        force, gripper = simulation.state().hand_force, simulation.gripper
        held = [None if gripper is None else gripper.held(side) for side in SIDES]
        row = {
            "time": np.array(time),
            "pelvis": simulation.qpos[:7],
            "hands": np.stack([simulation.hand_position(side) for side in SIDES]),
            "hand_force": np.zeros((2, 3)) if force is None else force.copy(),
            "hand_touches": np.array([any(link == hand for link, _ in self._touching) for hand in HANDS]),
            "poses": simulation.objects.poses,
            "travel": np.array([simulation.objects[name].travel or 0.0 for name in self._jointed]),
            "gait": np.array(gait),
            "held": np.array([-1 if name is None else names.index(name) for name in held]),
        }
        for name, value in row.items():
            self._samples.setdefault(name, []).append(value)

    def record(self, ending: Ending) -> TaskRecord:
        """Return the record of the episode up to now, at least one sample, and how the behaviour ended."""
        samples = {name: np.array(values) for name, values in self._samples.items()}
        poses, travel = samples.pop("poses"), samples.pop("travel")
        return TaskRecord(
            scene=self._scene,
            **samples,
            poses={name: poses[:, i] for i, name in enumerate(self._scene.body_names)},
            travel={name: travel[:, i] for i, name in enumerate(self._jointed)},
            touched=dict(self.touched),
            lasted=dict(self.lasted),
            depth=dict(self._depth),
            fell=self.fell,
            ending=ending,
            problems=tuple(self._simulation.objects.problems),
        )
