"""A check of a motion capture against the robot's own measurements: its IMU, and the odometry of the estimate."""

import collections
import itertools

import numpy as np

from hugwbc import rotations
from hugwbc.sim.scenes.objects import Picture
from hugwbc.state import RobotState

LONGEST_AGE = 0.2  # [s], of a picture that corrects the estimate
_AHEAD = 0.05  # [s], by which the time of a picture may be ahead of the robot's clock
_WINDOW = 2.0  # [s], over which motions are compared
_LONGEST, _LEAST = 0.3, 5  # [s] and number of pictures with nothing but contradictions that refuse a capture
_REPEATS = 20  # number of repetitions of a picture from which on the capture counts as frozen
_TILT = 0.26  # [rad] between the gravity that is seen and that of the IMU
# [m], [rad], and per way or turn: how far a motion that is seen may differ from the odometry's.
_WAY, _TURN, _DRIFT = 0.12, 0.2, 0.4
_STILL = 0.05  # [m], and in a quaternion: largest departure from the mean of a pose that does not move
_ALIKE = 0.05  # mean contradictions that differ by less count as equal; then the likelier explanation is told
_QUARTER = {axis: rotations.to_matrix(np.insert(np.eye(3)[i], 0, 1.0) / np.sqrt(2.0)) for i, axis in enumerate("xyz")}
_SAME, _MIRROR = np.eye(3), np.diag([1.0, -1.0, 1.0])
# What a capture may do wrong, likely things first: words, and the matrices that mend positions from the left, and
# orientations from the left and from the right.
_MENDING = {
    "": (_SAME, _SAME, _SAME),
    "its positions are in millimetres": (1e-3 * _SAME, _SAME, _SAME),
    "its world has y up": (_QUARTER["x"], _QUARTER["x"], _SAME),
    "its world is left-handed": (_MIRROR, _MIRROR, _MIRROR),
    "y of its positions has the wrong sign": (_MIRROR, _SAME, _SAME),
    "x of its positions has the wrong sign": (np.diag([-1.0, 1.0, 1.0]), _SAME, _SAME),
}
for _turns, _axis in itertools.product((1, 3, 2), "zyx"):
    _words = f"its rigid body is turned by {90 * _turns} degrees about the pelvis' {_axis}"
    _MENDING[_words] = _SAME, _SAME, np.linalg.matrix_power(_QUARTER[_axis].T, _turns)
_ORDERS = {"": [0, 1, 2, 3], "its quaternions are in the order x, y, z, w": [3, 0, 1, 2]}


def _misfit(seen: np.ndarray, turns: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Return by how many times the allowed difference each pose contradicts the robot's own, relative to the first.

    Args:
        seen: positions [m], shape (n, 3).
        turns: orientations as matrices, shape (n, 3, 3).
        own: positions and quaternions by odometry and IMU, shape (n, 7).
    """
    mine = rotations.to_matrix(own[:, 3:])
    lean = np.arccos(np.clip(np.einsum("ni,ni->n", turns[:, 2], mine[:, 2]), -1.0, 1.0))  # of gravity in the body
    yaw, own_yaw = (np.arctan2(matrices[:, 1, 0], matrices[:, 0, 0]) for matrices in (turns, mine))
    way = (own[:, :3] - own[0, :3]) @ rotations.rotation_z(float(yaw[0] - own_yaw[0])).T
    missed = np.linalg.norm(seen - seen[0] - way, axis=1) / (_WAY + _DRIFT * np.linalg.norm(way, axis=1))
    turn = rotations.wrap_angle(own_yaw - own_yaw[0])
    twisted = np.abs(rotations.wrap_angle(yaw - yaw[0] - turn)) / (_TURN + _DRIFT * np.abs(turn))
    return np.max((lean / _TILT, missed, twisted), axis=0)


class CaptureCheck:
    """A filter of pictures that passes those in which the robot is as its own sensors say.

    The heading and the origin of the motion capture's world are free. A capture that contradicts the robot for
    `_LONGEST` is refused until the next `reset`: whoever set it up must mend it.

    Attributes:
        refusal: why the capture is refused; empty while it is not.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self.refusal = ""
        # Time of a picture, the pose of the robot in it, and its own pose when it arrived, oldest first.
        self._pairs: collections.deque[tuple[float, np.ndarray, np.ndarray]] = collections.deque()
        self._good: Picture | None = None
        self._right = 0.0  # time of the last picture without a contradiction [s]
        self._wrong = self._repeated = 0  # number of pictures since then, and in a row with equal poses
        self._ahead: float | None = None  # time of the last picture that was ahead of the robot's clock [s]

    def admitted(self, picture: Picture | None, state: RobotState) -> Picture | None:
        """Return the newest picture that fits the robot's estimate before any correction; None before the first."""
        last = self._pairs[-1] if self._pairs else None
        if picture is None or state.position is None or self.refusal or (last and picture.time <= last[0]):
            return self._good
        if picture.time - state.time - state.age > _AHEAD:
            self._see_ahead(picture, state)
            return self._good
        self._right = picture.time if last is None else self._right
        repeats = last is not None and np.array_equal(picture.robot, last[1])
        self._repeated = self._repeated + 1 if repeats else 0
        self._pairs.append((picture.time, picture.robot, np.concatenate((state.position, state.orientation))))
        while self._pairs[0][0] < picture.time - _WINDOW:
            self._pairs.popleft()
        seen, own = (np.array((self._pairs[0][i], self._pairs[-1][i])) for i in (1, 2))
        late, frozen = state.time - picture.time > LONGEST_AGE, self._repeated >= _REPEATS
        if not (late or frozen) and _misfit(seen[:, :3], rotations.to_matrix(seen[:, 3:]), own)[1] <= 1.0:
            self._good, self._right, self._wrong = picture, picture.time, -1
        self._wrong += 1
        if self._wrong >= _LEAST and picture.time - self._right > _LONGEST:
            self._refuse(state.time, "its pictures come too late" if late else self._cause(frozen))
        return self._good

    def _see_ahead(self, picture: Picture, state: RobotState) -> None:
        """Count a picture from the future, which is left out: the next ones would seem older than it."""
        if picture.time == self._ahead:
            return
        if self._ahead is None and not self._pairs:
            self._right = state.time
        self._ahead, self._wrong = picture.time, self._wrong + 1
        if self._wrong >= _LEAST and state.time - self._right > _LONGEST:
            self._refuse(state.time, "its clock is ahead of the robot's")

    def _refuse(self, now: float, why: str) -> None:
        self.refusal = (
            f"motion capture refused at {now:.1f} s: it contradicts the robot's IMU and odometry, {why}; "
            "send the pelvis' position in metres and quaternion (w, x, y, z) in a world with z up"
        )

    def _cause(self, frozen: bool) -> str:
        """Return what is likely wrong with the capture, in words."""
        seen, own = (np.array([pair[i] for pair in self._pairs]) for i in (1, 2))
        moves = [bool(np.abs(poses - poses.mean(axis=0)).max() > _STILL) for poses in (seen, own)]
        if frozen or moves == [False, True]:
            return "its pose does not move with the robot: it is frozen, or another object's"
        causes = {}
        for (world, (mend, left, right)), (order, places) in itertools.product(_MENDING.items(), _ORDERS.items()):
            turns = left @ rotations.to_matrix(seen[:, 3:][:, places]) @ right
            words = "likely " + " and ".join(filter(None, (order, world)))
            causes[words] = float(_misfit(seen[:, :3] @ mend.T, turns, own).mean())
        best = min(causes.values())
        likely = next(words for words, misfit in causes.items() if misfit < best + _ALIKE)
        return likely if best < 1.0 else "check its axes, its units and its order of numbers"
