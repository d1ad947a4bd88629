"""Pinocchio kinematics and dynamics of a robot, and the measured quantities that score controllers.

Conventions: MuJoCo's free joint has the linear velocity in the world and the angular velocity in the body, quaternion
(w, x, y, z); Pinocchio has both velocities in the body, quaternion (x, y, z, w). `Kinematics.update` converts.
"""

import dataclasses
import functools

import numpy as np
import pinocchio as pin

from hugwbc import rotations
from hugwbc.robot import SIDES, Robot
from hugwbc.state import RobotState


@dataclasses.dataclass(frozen=True)
class Measured:
    """The commanded quantities as the robot executes them."""

    v_x: float  # pelvis velocity in the heading frame [m/s]
    v_y: float
    omega: float  # yaw rate about gravity [rad/s]
    h: float  # pelvis height above the ground below it, minus the nominal height [m]
    p: float  # pelvis pitch [rad]
    w: float  # waist angle [rad]
    clearance: tuple[float, float]  # height of the left and the right sole centre above the ground [m]


@functools.lru_cache(maxsize=64)  # robots of models that are not ours are new each time
def pinocchio_model(robot: Robot) -> pin.Model:
    """Return a free-floating robot with its drives' reflected inertia. Shared; do not modify it."""
    model = pin.buildModelFromUrdf(str(robot.urdf_path), pin.JointModelFreeFlyer())
    model.armature[joint_columns(model, robot)] = robot.armature
    for name, inertia in robot.inertias.items():
        model.inertias[model.getJointId(name)] = pin.Inertia(*inertia)
    place_frames(model, robot)
    return model


def place_frames(model: pin.Model, robot: Robot) -> None:
    """Put the frames of soles and hands of a model from the URDF where the robot has them."""
    heel, toe = robot.sole_x
    places = {"heel": heel, "sole": robot.sole_middle, "toe": toe}
    for side, foot, link, hand in zip(SIDES, robot.foot_links, robot.hand_links, robot.hands, strict=True):
        _put(model, f"{side}_hand", link, hand)
        for name, ahead in places.items():
            _put(model, f"{side}_{name}", foot, np.array([ahead, 0.0, robot.sole_z]))


def _put(model: pin.Model, name: str, link: str, at: np.ndarray) -> None:
    """Put a frame at a place in a link [m], shape (3,); the link may be fixed to another one that a joint moves."""
    place = model.frames[model.getFrameId(link, pin.FrameType.BODY)].placement.act(at)
    model.frames[model.getFrameId(name, pin.FrameType.BODY)].placement.translation = place


def joint_columns(model: pin.Model, robot: Robot) -> np.ndarray:
    """Return the index of each robot joint in the model's velocity, shape (n,); the two orders may differ."""
    return np.array([model.joints[model.getJointId(name)].idx_v for name in robot.joint_names])


def in_place(indices: np.ndarray) -> slice | np.ndarray:
    """Return consecutive indices as a slice, which reads and writes in place where an index array would copy."""
    first = int(indices[0])
    consecutive = np.array_equal(indices, np.arange(first, first + indices.size))
    return slice(first, first + indices.size) if consecutive else indices


class Kinematics:
    """Frames, centre of mass and measured commands at one state.

    `update` computes the frames once; the methods that return values read them. Frames are those of the URDF: every
    link, `left_sole`, `left_toe`, `left_heel`, `left_hand`, the same four on the right, and `imu`.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.model = pinocchio_model(self.robot).copy()
        self.data = self.model.createData()
        self.columns = joint_columns(self.model, self.robot)
        self._q_joints, self._v_joints = in_place(self.columns + 1), in_place(self.columns)
        self.q = pin.neutral(self.model)
        self.v = np.zeros(self.model.nv)
        self._zero = np.zeros(self.model.nv)
        self._untold: np.ndarray | None = None
        self._state: RobotState | None = None
        self._ids: dict[str, int] = {}

    def update(self, state: RobotState) -> None:
        """Place the robot and compute its frames; a missing position or velocity counts as 0."""
        self.place(state)
        self._compute()

    def add_inertia(self, untold: np.ndarray | None) -> None:
        """Let the joints have more inertia than the robot's table says [kg m^2], shape (n,); None for none."""
        if untold is not self._untold:
            self._untold = untold
            self.model.armature[self._v_joints] = self.robot.armature + (0.0 if untold is None else untold)

    def place(self, state: RobotState) -> None:
        """Set configuration and velocity, and compute nothing."""
        self._state = state
        self.place_joints(state.q, state.dq)
        self.place_pelvis(state.orientation, state.angular_velocity, state.position, state.velocity)

    def place_joints(self, q: np.ndarray, dq: np.ndarray) -> None:
        """Set positions [rad] and velocities [rad/s] of the joints, shapes (n,)."""
        self.q[self._q_joints], self.v[self._v_joints] = q, dq

    def place_pelvis(
        self,
        orientation: np.ndarray,
        angular_velocity: np.ndarray,
        position: np.ndarray | None,
        velocity: np.ndarray | None,
    ) -> None:
        """Set the motion of the pelvis as a `RobotState` has it; None counts as 0."""
        self.q[:3] = 0.0 if position is None else position
        self.q[3:6], self.q[6] = orientation[1:], orientation[0]
        self.v[:3] = 0.0 if velocity is None else rotations.rotate_inverse(orientation, velocity)
        self.v[3:6] = angular_velocity

    def _compute(self) -> None:
        """Compute placements, velocities, and accelerations at zero generalised acceleration, of all frames."""
        pin.forwardKinematics(self.model, self.data, self.q, self.v, self._zero)
        pin.updateFramePlacements(self.model, self.data)

    def frame_id(self, name: str) -> int:
        """Return Pinocchio's index of a frame."""
        index = self._ids.get(name)
        if index is None:
            # A joint may have the name of its link.
            index = self._ids[name] = self.model.getFrameId(name, pin.FrameType.BODY)
        return index

    def position(self, frame: str) -> np.ndarray:
        """Return the origin of a frame in the world [m], shape (3,)."""
        return self.data.oMf[self.frame_id(frame)].translation.copy()

    def rotation(self, frame: str) -> np.ndarray:
        """Return the axes of a frame in the world as columns, shape (3, 3)."""
        return self.data.oMf[self.frame_id(frame)].rotation.copy()

    def velocity(self, frame: str) -> np.ndarray:
        """Return the linear, then the angular velocity of a frame in world axes [m/s, rad/s], shape (6,)."""
        return pin.getFrameVelocity(self.model, self.data, self.frame_id(frame), pin.LOCAL_WORLD_ALIGNED).vector.copy()

    def centre_of_mass(self) -> np.ndarray:
        """Return the centre of mass in the world [m], shape (3,)."""
        return pin.centerOfMass(self.model, self.data, self.q).copy()

    def measured(self, ground_height: float = 0.0, sole_ground: tuple[float, float] | None = None) -> Measured:
        """Return the commanded quantities at the updated state, which needs a position and a velocity.

        Args:
            ground_height: height of the ground below the pelvis [m].
            sole_ground: height of the ground below the left and the right sole [m]; None for level ground.
        """
        state = self._state
        if state is None or state.position is None or state.velocity is None:
            raise ValueError("measured() needs a state with position and velocity; call update() with one first")
        v_x, v_y, omega = state.heading_velocity.tolist()
        below = (ground_height, ground_height) if sole_ground is None else sole_ground
        soles = [self.position(f"{side}_sole")[2] - height for side, height in zip(SIDES, below, strict=True)]
        return Measured(
            v_x=v_x,
            v_y=v_y,
            omega=omega,
            h=float(state.position[2] - ground_height - self.robot.nominal_height),
            p=float(rotations.pitch_of(state.orientation)),
            w=float(state.q[self.robot.waist]),
            clearance=(float(soles[0]), float(soles[1])),
        )
