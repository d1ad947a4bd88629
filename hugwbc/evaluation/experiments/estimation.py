"""How well is the state estimated from a robot's own sensors? Velocity, tilt, contacts, drift, and consistency.

Every episode is a walk at a random velocity, of which the estimator knows nothing but the readings and what the
controller plans. Each estimate is compared with the true state at the time of its newest reading. An estimator is
consistent if its errors are as large as it believes: the normalised estimation error squared (NEES) of roll, pitch and
velocity is 1 for each degree of freedom on average (Bar-Shalom, Li, Kirubarajan, *Estimation with Applications to
Tracking and Navigation*, 2001, section 5.4).
"""

import collections
import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import polars as pl

from hugwbc import rotations
from hugwbc.controller import Controller
from hugwbc.errors import ConfigError
from hugwbc.evaluation.episode import CountedSettings, Row, ending, simulate
from hugwbc.evaluation.experiment import Experiment, Section
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import bootstrap_mean, bootstrap_rms, paired_ratio, scaled, single
from hugwbc.evaluation.plans import Plan
from hugwbc.gait import Gait
from hugwbc.runtime.estimation import StateEstimator
from hugwbc.runtime.trace import CONTACT_FORCE, SHORTEST_SWING
from hugwbc.settings import Count, Positive, settings
from hugwbc.state import RobotState

RANDOM = {"v_x": (-0.3, 1.0), "v_y": (-0.2, 0.2), "omega": (-0.5, 0.5)}  # [m/s], [rad/s]
DRIFT_WAY = 20.0  # [m], to which drifts are scaled
_SHORTEST_WAY = 0.5  # [m], mean path; from a shorter one, such as that of stands, no drift is scaled
_WAY_STEP = 0.5  # [s]; a path is measured in steps of this time, which leaves out the sway of a walk
_SLOW = 0.1  # [s]; the change of a contact is looked for within this time
DEGREES = 5  # of freedom of the normalised error: roll, pitch, and the velocity
_EVERY = 5  # samples between two normalised errors, whose covariance takes time to invert
_ROUNDING = 1e-6  # [s]
_DRIFTS = ("drift", "height_drift", "yaw_drift")
# Figure by field: name and unit in tables, factor from SI units, whether it is an RMS or a mean. A drift is the sum of
# all walks' drifts over the sum of their paths, scaled to `DRIFT_WAY`.
COLUMNS = {
    "v_x": ("velocity forward", "m/s", 1.0, True),
    "v_y": ("velocity sideways", "m/s", 1.0, True),
    "v_z": ("velocity upwards", "m/s", 1.0, True),
    "roll": ("roll", "deg", 180.0 / math.pi, True),
    "pitch": ("pitch", "deg", 180.0 / math.pi, True),
    "false_contact": ("false contacts, of the time in the air", "%", 100.0, False),
    "missed_contact": ("missed contacts, of the time on the ground", "%", 100.0, False),
    "touch_down_delay": ("delay of a touch-down", "ms", 1e3, False),
    "lift_off_delay": ("delay of a lift-off", "ms", 1e3, False),
    "drift": ("drift over 20 m", "m", 1.0, False),
    "height_drift": ("drift of the height over 20 m", "m", 1.0, False),
    "yaw_drift": ("drift of the heading over 20 m", "deg", 180.0 / math.pi, False),
}


@settings(kw_only=True)
class EstimationSettings(CountedSettings):
    """Settings of estimation."""

    episodes: Count = 50  # number of walks
    duration: Positive = 8.0  # duration of an episode [s]

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.conditions.chosen.estimates:
            raise ConfigError("exact sensors give the whole state; give --sensing robot")


def plan(settings: EstimationSettings) -> list[Plan]:
    """Return walks at random velocities, each drawn from the seed and its number; or stands."""
    plans = []
    for number in range(settings.episodes):
        rng = np.random.default_rng((settings.seed, number))
        velocity = {name: float(rng.uniform(*bounds)) for name, bounds in RANDOM.items()}
        drawn = {} if settings.gait == Gait.STANDING.label else velocity
        plans.append(Plan(number, dataclasses.replace(settings.default_command(number), **drawn)))
    return plans


def episode(controller: Controller, settings: EstimationSettings, plan: Plan) -> Row:
    """Return `COLUMNS` of one walk after its settling time, consistency and path.

    - `nees`: mean normalised estimation error squared of tilt and velocity, for each degree of freedom.
    - `way`: length of the path [m].
    """
    estimator = settings.conditions.estimator()
    assert estimator is not None  # the settings refuse exact sensors
    errors = EstimateErrors(estimator)
    trace = simulate(controller, settings, plan, estimator=estimator, on_step=errors)
    record = errors.record(settings.settle)
    return {
        **{f"commanded_{name}": getattr(plan.command, name) for name in RANDOM},
        **(_errors(record) if record else dict.fromkeys(("nees", *COLUMNS))),
        "way": _way(record) if record else 0.0,
        **ending(trace),
    }


Record = dict[str, np.ndarray]
"""Errors of an estimator: S samples, one for each reading, at the time at which it was taken.

- `time`: of the readings [s], shape (S,).
- `tilt`: error of roll and pitch, about the axes of the true heading frame [rad], shape (S, 2).
- `velocity`: error of the pelvis's velocity in the heading frame [m/s], shape (S, 3). The heading itself is not
  observable, so its drift does not count.
- `nees`: error of tilt and velocity, squared and weighted by the inverse of the estimator's own covariance; it is
  `DEGREES` on average for an estimator that knows how exact it is. Shape (S,), NaN between its samples.
- `position`: error of the pelvis's position in the world [m], shape (S, 3); `yaw`: of the heading [rad], shape (S,).
- `inferred`, `touching`: whether the estimator says that the left and the right foot stand, and whether they do, shape
  (S, 2), bool.
- `true_position`: of the pelvis in the world [m], shape (S, 3).
"""


class EstimateErrors:
    """The errors of each estimate in a control loop; called after every physics step (`rollout`'s `on_step`)."""

    def __init__(self, estimator: StateEstimator) -> None:
        """Begin without samples."""
        self._estimator = estimator
        self._truths: collections.deque[RobotState] = collections.deque()  # those newer than the last estimate
        self._rows: list[dict[str, Any]] = []

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
        self._rows.append(
            {
                "time": estimate.time,
                "tilt": reduced[:2],
                "velocity": reduced[2:],
                "nees": nees,
                "position": estimate.position - true.position,
                "yaw": angle[2],
                "inferred": self._estimator.contact.copy(),
                "touching": true.foot_force[:, 2] > CONTACT_FORCE,
                "true_position": true.position,
            }
        )

    def record(self, begin: float) -> Record:
        """Return the samples from a time [s] on; empty without any."""
        rows = [row for row in self._rows if row["time"] >= begin - _ROUNDING]
        return {name: np.array([row[name] for row in rows]) for name in rows[0]} if rows else {}


def _heading_errors(level: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return the matrix from errors of orientation and velocity in the world to `DEGREES` ones in the heading frame.

    Its shape is (5, 6). The velocity in the heading frame is Rz(-yaw) v; an error of yaw turns it by -(z x v) for each
    radian.
    """
    matrix = np.zeros((DEGREES, 6))
    matrix[:2, :3] = level[:2]
    matrix[2:, 3:] = level
    matrix[2:, 2] = -level @ np.array([-velocity[1], velocity[0], 0.0])
    return matrix


def delays(inferred: np.ndarray, true: np.ndarray, time: np.ndarray, *, down: bool) -> list[float]:
    """Return when touch-downs or lift-offs are inferred, relative to the true ones [s].

    A foot that leaves the ground for less than `SHORTEST_SWING` has bounced and not stepped. Changes that are not
    inferred within 0.1 s are left out; they count as false or missed contacts.

    Args:
        inferred: whether the foot is said to stand, shape (S,), bool.
        true: whether it does, shape (S,), bool.
        time: of the samples [s], shape (S,).
        down: touch-downs, or lift-offs.
    """
    true = without_bounces(true, time)
    found = []
    changes = time[1:][np.diff(inferred.astype(int)) == (1 if down else -1)]
    for moment in time[1:][np.diff(true.astype(int)) == (1 if down else -1)]:
        near = changes[np.abs(changes - moment) <= _SLOW]
        if near.size:
            found.append(float(near[np.argmin(np.abs(near - moment))] - moment))
    return found


def without_bounces(true: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return contacts in which a foot that bounces stays on the ground, shape (S,), bool."""
    filled, edges = true.copy(), np.diff(true.astype(int))
    for left in np.flatnonzero(edges == -1) + 1:
        landed = np.flatnonzero(true[left:])
        if landed.size and time[left + landed[0]] - time[left] < SHORTEST_SWING:
            filled[left : left + landed[0]] = True
    return filled


def _errors(record: Record) -> dict[str, Any]:
    rms = np.sqrt(np.mean(np.hstack([record["velocity"], record["tilt"]]) ** 2, axis=0)).tolist()
    true, inferred, time = record["touching"], record["inferred"], record["time"]
    both = [(inferred[:, foot], true[:, foot]) for foot in range(2)]
    downs, lifts = ([d for i, t in both for d in delays(i, t, time, down=down)] for down in (True, False))
    sampled = record["nees"][np.isfinite(record["nees"])]
    moved = record["position"][-1] - record["position"][0]
    turned = float(np.unwrap(record["yaw"])[-1] - record["yaw"][0])
    return {
        **dict(zip(("v_x", "v_y", "v_z", "roll", "pitch"), rms, strict=True)),
        "nees": float(sampled.mean()) / DEGREES if sampled.size else None,
        "false_contact": _share(inferred & ~true, ~true),
        "missed_contact": _share(true & ~inferred, true),
        "touch_down_delay": _mean_of(downs),
        "lift_off_delay": _mean_of(lifts),
        "drift": float(np.hypot(moved[0], moved[1])),
        "height_drift": abs(float(moved[2])),
        "yaw_drift": abs(turned),
    }


def _share(event: np.ndarray, of: np.ndarray) -> float | None:
    return float(event.sum() / of.sum()) if of.any() else None


def _mean_of(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


def _way(record: Record) -> float:
    """Return the length of the true path [m]."""
    if record["time"].size < 2:
        return 0.0
    stride, path = max(1, round(_WAY_STEP / float(record["time"][1] - record["time"][0]))), record["true_position"]
    points = np.concatenate((path[:-1:stride], path[-1:]))[:, :2]  # to the end, as the errors are
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def figures(settings: EstimationSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return errors, contacts, drifts and consistency: RMS errors or means over the walks."""
    table, found = f"State estimation, {settings.gait}, {settings.duration:g} s", []
    walks = rows.filter(pl.col("drift").is_not_null())
    far = bool(len(walks)) and float(walks["way"].to_numpy().mean()) >= _SHORTEST_WAY
    for name, (label, unit, factor, squared) in COLUMNS.items():
        if name not in _DRIFTS:
            estimate = bootstrap_rms(rows[name]) if squared else bootstrap_mean(rows[name])
        elif far:
            estimate = scaled(paired_ratio(walks[name].to_list(), walks["way"].to_list()), DRIFT_WAY)
        else:
            estimate = single(None)
        found.append(Figure(table, label, unit, scaled(estimate, factor)))
    found.append(Figure(table, "NEES; 1 if it is consistent", "", bootstrap_mean(rows["nees"]), higher_is_better=None))
    return [*found, falls_figure(table, rows["fell"])]


EXPERIMENT = Experiment(
    "estimation",
    "the state estimator against the truth: velocity, tilt, contacts, drift, and its own covariance",
    EstimationSettings,
    plan,
    episode,
    figures,
    section=Section(
        "State estimation",
        "What the controllers read: a state estimated from IMU, encoders and joint torques. Walks at random "
        "velocities; RMS errors in the heading frame over walks. NEES: the errors, squared, relative to what the "
        "estimator believes; 1 if it is consistent. Drifts are those of all walks over their ways, for 20 m.",
        lambda: [EstimationSettings(episodes=2, duration=5.0)],
        lambda: [EstimationSettings()],
    ),
)
