"""The state of the robot that sensors, an estimator or the simulation give to a controller."""

import dataclasses
import functools
import math

import numpy as np

from hugwbc import rotations
from hugwbc.numeric import JOINTS, Shape, keep_floats

GRAVITY = 9.81  # [m/s^2]
_LARGEST_SQUARE = 1e12  # sum of the squares of a usable state's numbers: larger ones are no readings


@dataclasses.dataclass(frozen=True, eq=False)
class RobotState:
    """One reading of the robot; joint vectors follow `Robot.joint_names`, quaternions are (w, x, y, z).

    What other libraries call numbers is converted; what is none, or has another shape, becomes NaN (`is_usable`).

    Attributes:
        q, dq: joint positions [rad] and velocities [rad/s], shape (n,).
        orientation: pelvis to world, unit quaternion, shape (4,).
        angular_velocity: of the pelvis, in the pelvis frame [rad/s], shape (3,).
        position: pelvis origin in the world [m], shape (3,), or None without an estimator.
        velocity: of the pelvis origin, in the world frame [m/s], shape (3,), or None without an estimator.
        foot_force: ground reaction on the left and right foot, in the world frame [N], shape (2, 3), or None.
        hand_force: force on the left and right hand (the forearm with it) from outside, in the world frame [N],
            shape (2, 3), or None where it is neither measured nor estimated.
        imu_gyro: angular velocity of the IMU, in its own frame [rad/s], shape (3,), or None.
        imu_accelerometer: specific force at the IMU (acceleration minus gravity), in its own frame, averaged since the
            last reading [m/s^2], shape (3,), or None.
        torque: joint torques as the motors measure them, averaged since the last reading [N*m], shape (n,), or None.
        untold_inertia: inertia of the joints that an estimator has learnt and the robot's table lacks [kg m^2],
            shape (n,), or None.
        time: time of the reading [s].
        age: how long ago the reading was taken [s].
        coasted: sensors whose reading was refused and replaced (`hugwbc.runtime.reading_guard`).
        lost: why the state is no longer known well enough to balance; empty as long as it is.
    """

    q: np.ndarray
    dq: np.ndarray
    orientation: np.ndarray
    angular_velocity: np.ndarray
    position: np.ndarray | None = None
    velocity: np.ndarray | None = None
    foot_force: np.ndarray | None = None
    hand_force: np.ndarray | None = None
    imu_gyro: np.ndarray | None = None
    imu_accelerometer: np.ndarray | None = None
    torque: np.ndarray | None = None
    untold_inertia: np.ndarray | None = None
    time: float = 0.0
    age: float = 0.0
    coasted: tuple[str, ...] = ()
    lost: str = ""

    def __post_init__(self) -> None:
        keep_floats(self, _NUMBERS, _OPTIONAL)
        if type(self.coasted) is not tuple or type(self.lost) is not str:
            object.__setattr__(self, "coasted", ())
            object.__setattr__(self, "lost", "" if self.lost is None else str(self.lost))

    @property
    def projected_gravity(self) -> np.ndarray:
        """Unit vector of gravity in the pelvis frame, shape (3,)."""
        return rotations.rotate_inverse(self.orientation, np.array([0.0, 0.0, -1.0]))

    @functools.cached_property
    def yaw(self) -> float:
        """Heading of the pelvis [rad]."""
        return float(rotations.yaw_of(self.orientation))

    @property
    def heading_velocity(self) -> np.ndarray:
        """v_x, v_y of the pelvis in its heading [m/s] and its yaw rate omega [rad/s], shape (3,); needs a velocity."""
        assert self.velocity is not None
        velocity = rotations.rotation_z(-self.yaw) @ self.velocity
        return np.array([*velocity[:2], rotations.rotate(self.orientation, self.angular_velocity)[2]])

    @functools.cached_property
    def is_finite(self) -> bool:
        """Whether all numbers in the fields that are present are finite."""
        return math.isfinite(self.time + self.age + self._square())

    def _square(self) -> float:
        """Return the sum of the squares of all numbers but the times: it does not cancel as a sum might."""
        fields = vars(self)
        given = [value for name in _VECTORS if (value := fields[name]) is not None]
        together = np.concatenate([value if value.ndim == 1 else value.ravel() for value in given])
        return float(together.dot(together))

    @functools.cached_property
    def is_usable(self) -> bool:
        """Whether the state is finite, not absurdly large, and its orientation a unit quaternion to 5 %.

        A broken IMU may send zeros.
        """
        size = self._square() + abs(self.time + self.age)  # a comparison with NaN is false
        return size < _LARGEST_SQUARE and abs(float(self.orientation.dot(self.orientation)) - 1.0) < 0.1


_NUMBERS: dict[str, Shape] = {
    **dict.fromkeys(("q", "dq", "torque", "untold_inertia"), JOINTS),
    "orientation": (4,),
    **dict.fromkeys(("angular_velocity", "position", "velocity", "imu_gyro", "imu_accelerometer"), (3,)),
    **dict.fromkeys(("foot_force", "hand_force"), (2, 3)),
    **dict.fromkeys(("time", "age"), ()),
}
_OPTIONAL = tuple(field.name for field in dataclasses.fields(RobotState) if field.default is None)
_VECTORS = tuple(name for name, shape in _NUMBERS.items() if shape)


def pelvis_from_imu(
    orientation: np.ndarray, gyro: np.ndarray, waist: float, waist_rate: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return pelvis orientation, (4,), and angular velocity, (3,), from an IMU on base or trunk.

    Args:
        orientation: IMU to world, shape (4,).
        gyro: angular velocity of the IMU in its own frame [rad/s], shape (3,).
        waist: angle by which the joints turn the IMU (`Robot.imu_turn`) [rad].
        waist_rate: and its rate [rad/s].
    """
    if not math.isfinite(waist):
        return np.full(4, np.nan), np.full(3, np.nan)
    # The product with (c, 0, 0, s), a turn back about z.
    c, s = math.cos(0.5 * waist), -math.sin(0.5 * waist)
    w, x, y, z = orientation.tolist()
    turn_x, turn_y, turn_z = gyro.tolist()
    cosine, sine = math.cos(waist), math.sin(waist)
    rate = cosine * turn_x - sine * turn_y, sine * turn_x + cosine * turn_y, turn_z - waist_rate
    return np.array([w * c - z * s, c * x + y * s, c * y - x * s, w * s + c * z]), np.array(rate)
