"""Where the objects of a scene are, truly and as a motion-capture system sees them."""

import collections
import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence

import mujoco
import numpy as np

from hugwbc import rotations
from hugwbc.errors import UnknownObjectError
from hugwbc.robot import Robot
from hugwbc.sim.scenes.thing import FARTHEST
from hugwbc.sim.sensors import SensorProfile
from hugwbc.sim.terrain import HeightField

CAPTURE_PERIOD = 0.01  # [s] between two pictures of the motion-capture system; assumed
LOWEST, HIGHEST = -1.0, 20.0  # [m], heights above the ground below it between which an object is in the world
_ONE_WAY = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
_ROUNDING = 1e-9  # [s], tolerance for rounding errors in sums of time steps


@dataclasses.dataclass(frozen=True, eq=False)
class ObjectState:
    """One object at one time, in the world frame. What has not been measured is None.

    Attributes:
        position: of the object's origin, which its class names [m], shape (3,).
        orientation: object to world, unit quaternion (w, x, y, z), shape (4,).
        velocity: of the origin [m/s], shape (3,).
        angular_velocity: [rad/s], shape (3,).
        travel: how far its joint is from rest: angle of a door [rad], way of a drawer or button [m]; None without one.
        hand_force: force of each hand on it by contact [N], shape (2, 3); zeros for a hand that does not touch it.
        time: time of the measurement [s].
        age: how long ago that was [s].
    """

    position: np.ndarray
    orientation: np.ndarray
    velocity: np.ndarray | None = None
    angular_velocity: np.ndarray | None = None
    travel: float | None = None
    hand_force: np.ndarray | None = None
    time: float = 0.0
    age: float = 0.0

    @property
    def tilt(self) -> float:
        """Angle between the object's z axis and the vertical [rad]."""
        return math.acos(min(1.0, max(-1.0, float(rotations.to_matrix(self.orientation)[2, 2]))))


@dataclasses.dataclass(frozen=True, eq=False)
class Picture:
    """One picture of the motion capture."""

    time: float  # when it was taken [s]
    age: float  # how long ago that was [s]
    # Position [m] and quaternion (w, x, y, z) of every object, in the order of `Objects.names`, shape (n, 7).
    poses: np.ndarray
    robot: np.ndarray  # the same of the robot's pelvis, shape (7,)


class Objects(Mapping[str, ObjectState]):
    """The objects around a robot by body name (`objects["parcel"]` is the true state); this base has none.

    Attributes:
        names: names of the bodies, in the order of `poses`.
        problems: what has gone wrong in this run, such as an object that left the world.
    """

    def __init__(self) -> None:
        self.names: tuple[str, ...] = ()
        self.problems: list[str] = []

    @property
    def poses(self) -> np.ndarray:
        """Position [m] and quaternion (w, x, y, z) of every body, shape (bodies, 7)."""
        return np.zeros((0, 7))

    def picture(self) -> Picture | None:
        """Return the newest picture of a motion-capture system; None without one."""
        return None

    def seen(self, name: str) -> ObjectState:
        """Return what a motion-capture system knows of an object."""
        raise UnknownObjectError("object", name, self.names)

    def __getitem__(self, name: str) -> ObjectState:
        raise UnknownObjectError("object", name, self.names)

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)


class SceneObjects(Objects):
    """The objects of one simulation."""

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        names: tuple[str, ...],
        robot: Robot,
        sensing: SensorProfile,
        seed: int,
        ground: HeightField | None,
    ) -> None:
        """Find the bodies; `ground` is None for a plane at height 0, the seed that of the pictures' noise."""
        super().__init__()
        self.names = names
        self._model, self._data, self._sensing, self._ground = model, data, sensing, ground
        self._bodies = np.array([model.body(name).id for name in names], dtype=int)
        self._hands = [model.body(link).id for link in robot.hand_links]
        self._pelvis = model.body(robot.base).id
        self._exact = not (sensing.object_position or sensing.object_attitude or sensing.object_latency)
        self._noise, self._noise_of_robot = (np.random.default_rng([seed, stream]) for stream in (1, 2))
        pictures = math.ceil(sensing.object_latency / CAPTURE_PERIOD) + 2
        self._pictures: collections.deque[tuple[float, np.ndarray, np.ndarray]] = collections.deque(maxlen=pictures)
        self.restart()

    def restart(self) -> None:
        """Begin a new run with the first picture of the motion capture."""
        self.problems.clear()
        self._left: set[str] = set()
        self._failed = False
        self._pictures.clear()
        self._next = 0.0
        self.watch()

    def watch(self) -> None:
        """Look at the objects after a physics step, once every `CAPTURE_PERIOD`."""
        now = self._data.time
        if now < self._next - _ROUNDING:
            return
        self._next += CAPTURE_PERIOD
        poses = self.poses
        if not self._exact:
            robot = self._blurred(self._robot_pose[None], self._noise_of_robot)[0]
            self._pictures.append((now, self._blurred(poses, self._noise), robot))
        height = poses[:, 2] - (0.0 if self._ground is None else self._ground.height_at(np.nan_to_num(poses[:, :2])))
        inside = (np.abs(poses[:, :2]) < 2.0 * FARTHEST).all(axis=1) & (height > LOWEST) & (height < HIGHEST)
        for index in np.flatnonzero(~inside):  # a NaN is not inside either
            name = self.names[index]
            if name not in self._left:
                self._left.add(name)
                self.problems.append(f"object '{name}' left the world at {now:.2f} s")

    def note_divergence(self, time: float, dof: int) -> None:
        """Note that the physics has failed at a time [s], which MuJoCo noticed at a degree of freedom."""
        if not self._failed:  # it may fail again in every step
            body = self._model.body(int(self._model.dof_bodyid[min(max(dof, 0), self._model.nv - 1)])).name
            self.problems.append(f"the physics diverged at {time:.2f} s, near '{body}'")
        self._failed = True
        self._pictures.clear()  # MuJoCo begins again at time 0
        self._next = 0.0
        self.watch()

    def _blurred(self, poses: np.ndarray, noise: np.random.Generator) -> np.ndarray:
        count = len(poses)
        position = noise.normal(0.0, 1.0, (count, 3)) * self._sensing.object_position
        turn = np.ones((count, 4))
        turn[:, 1:] = 0.5 * noise.normal(0.0, 1.0, (count, 3)) * self._sensing.object_attitude
        turned = rotations.multiply(turn / np.linalg.norm(turn, axis=1, keepdims=True), poses[:, 3:])
        return np.hstack((poses[:, :3] + position, turned))

    @property
    def poses(self) -> np.ndarray:  # noqa: D102
        return np.hstack((self._data.xpos[self._bodies], self._data.xquat[self._bodies]))

    @property
    def _robot_pose(self) -> np.ndarray:
        return np.concatenate((self._data.xpos[self._pelvis], self._data.xquat[self._pelvis]))

    def picture(self) -> Picture:
        """Return the newest picture that has arrived: with noise, and taken some time ago.

        With an exact profile it shows the present and true poses.
        """
        now = float(self._data.time)
        if self._exact:
            return Picture(now, 0.0, self.poses, self._robot_pose)
        ready = [picture for picture in self._pictures if picture[0] <= now - self._sensing.object_latency + _ROUNDING]
        time, poses, robot = ready[-1] if ready else self._pictures[0]
        return Picture(time, now - time, poses, robot)

    def seen(self, name: str) -> ObjectState:
        """Return an object's pose as a motion-capture system gives it: with noise, and some time ago.

        With an exact profile it is the true state.
        """
        if self._exact:
            return self[name]
        row, picture = self._row(name), self.picture()
        pose = picture.poses[row]
        return ObjectState(pose[:3].copy(), pose[3:].copy(), time=picture.time, age=picture.age)

    def __getitem__(self, name: str) -> ObjectState:
        body, data, model = int(self._bodies[self._row(name)]), self._data, self._model
        velocity = np.zeros(6)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, body, velocity, 0)
        travel = None
        joint = int(model.body_jntadr[body])
        if joint >= 0 and int(model.jnt_type[joint]) in _ONE_WAY:
            travel = float(data.qpos[model.jnt_qposadr[joint]])
        return ObjectState(
            position=data.xpos[body].copy(),
            orientation=data.xquat[body].copy(),
            velocity=velocity[3:],
            angular_velocity=velocity[:3],
            travel=travel,
            hand_force=contact_force(model, data, self._hands, body),
            time=float(data.time),
        )

    def _row(self, name: str) -> int:
        if name not in self.names:
            raise UnknownObjectError("object", name, self.names)
        return self.names.index(name)


def contact_force(
    model: mujoco.MjModel, data: mujoco.MjData, links: Sequence[int] | np.ndarray, body: int
) -> np.ndarray:
    """Return the force of each of some links on a body by contact, in the world [N], shape (n, 3)."""
    force, pairs = np.zeros((len(links), 3)), model.geom_bodyid[data.contact.geom]
    for index in np.flatnonzero(np.any(pairs == body, axis=1)):
        one, other = pairs[index]
        for row, link in enumerate(links):
            if link in (one, other):
                on_second = force_on_second(model, data, int(index))
                force[row] += on_second if other == body else -on_second
    return force


def force_on_second(model: mujoco.MjModel, data: mujoco.MjData, index: int) -> np.ndarray:
    """Return the force of a contact on its second geom in the world [N], shape (3,)."""
    wrench = np.zeros(6)
    mujoco.mj_contactForce(model, data, index, wrench)
    return data.contact.frame[index].reshape(3, 3).T @ wrench[:3]  # the rows are the axes of the contact's frame
