"""How far an estimator is from the truth: its errors, its own covariance, its contacts, at every physics step."""

import collections
import dataclasses

import numpy as np

from hugwbc import rotations
from hugwbc.runtime.estimation import StateEstimator
from hugwbc.runtime.trace import CONTACT_FORCE
from hugwbc.state import RobotState

DEGREES = 5  # of freedom of the normalised error: roll, pitch, and the velocity
_EVERY = 5  # samples between two normalised errors, whose covariance takes time to invert
_ROUNDING = 1e-6  # [s]


@dataclasses.dataclass(frozen=True, eq=False)
class EstimateRecord:
    """Errors of an estimator in one run: S samples, one for each reading, at the time at which it was taken.

    Attributes:
        time: of the readings [s], shape (S,).
        tilt: error of roll and pitch, about the axes of the true heading frame [rad], shape (S, 2).
        velocity: error of the pelvis's velocity in the heading frame [m/s], shape (S, 3). The heading itself is not
            observable, so its drift does not count.
        nees: error of tilt and velocity, squared and weighted by the inverse of the estimator's own covariance; it is
            `DEGREES` on average for an estimator that knows how exact it is. Shape (S,), NaN between its samples.
        position: error of the pelvis's position in the world [m], shape (S, 3).
        yaw: error of the heading [rad], shape (S,).
        inferred: whether the estimator says that the left and the right foot stand, shape (S, 2), bool.
        touching: whether they do, shape (S, 2), bool.
        true_position: of the pelvis in the world [m], shape (S, 3).
    """

    time: np.ndarray
    tilt: np.ndarray
    velocity: np.ndarray
    nees: np.ndarray
    position: np.ndarray
    yaw: np.ndarray
    inferred: np.ndarray
    touching: np.ndarray
    true_position: np.ndarray

    def after(self, time: float) -> "EstimateRecord":
        """Return the part from a time [s] on."""
        kept = self.time >= time - _ROUNDING
        return EstimateRecord(**{f.name: getattr(self, f.name)[kept] for f in dataclasses.fields(self)})


class EstimateWatch:
    """A watch over an estimator in a control loop, called after every physics step (`rollout`'s `on_step`)."""

    def __init__(self, estimator: StateEstimator) -> None:
        """Begin without samples."""
        self._estimator = estimator
        self._truths: collections.deque[RobotState] = collections.deque()  # those that no reading has shown yet
        self._rows: list[tuple[object, ...]] = []

    def __call__(self, truth: RobotState, estimate: RobotState) -> None:
        """Take the true state of the present and the estimate, which is of the time of an earlier reading."""
        self._truths.append(truth)
        while self._truths and self._truths[0].time < estimate.time - _ROUNDING:
            self._truths.popleft()
        if not self._truths or self._truths[0].time > estimate.time + _ROUNDING or estimate.position is None:
            return
        true = self._truths.popleft()  # the same estimate is shown again until the next one
        assert true.position is not None and true.velocity is not None and true.foot_force is not None
        assert estimate.velocity is not None
        level = rotations.rotation_z(-true.yaw)
        turn = rotations.to_matrix(estimate.orientation) @ rotations.to_matrix(true.orientation).T
        angle = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        error = np.concatenate((angle, estimate.velocity - true.velocity))
        heading = _heading_errors(level, true.velocity)
        reduced = heading @ error
        nees = np.nan
        if len(self._rows) % _EVERY == 0:
            covariance = heading @ self._estimator.covariance() @ heading.T
            nees = float(reduced @ np.linalg.solve(covariance, reduced))
        row = (estimate.time, reduced[:2], reduced[2:], nees, estimate.position - true.position, angle[2])
        contacts = (self._estimator.contact.copy(), true.foot_force[:, 2] > CONTACT_FORCE)
        self._rows.append((*row, *contacts, true.position))

    def record(self) -> EstimateRecord:
        """Return all samples so far."""
        shapes = ((), (2,), (3,), (), (3,), (), (2,), (2,), (3,))
        columns = zip(*self._rows, strict=True) if self._rows else ([],) * len(shapes)
        arrays = [np.array(column).reshape(-1, *shape) for column, shape in zip(columns, shapes, strict=True)]
        arrays[6], arrays[7] = arrays[6].astype(bool), arrays[7].astype(bool)
        return EstimateRecord(*arrays)


def _heading_errors(level: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return what makes errors in the heading frame of errors of orientation and velocity in the world, shape (5, 6).

    The velocity in the heading frame is Rz(-yaw) v; an error of yaw turns it by -(z x v) for each radian.
    """
    matrix = np.zeros((DEGREES, 6))
    matrix[:2, :3] = level[:2]
    matrix[2:, 3:] = level
    matrix[2:, 2] = -level @ np.array([-velocity[1], velocity[0], 0.0])
    return matrix
