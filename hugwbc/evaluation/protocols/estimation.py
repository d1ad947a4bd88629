"""How well is the state estimated from an H1's own sensors? Velocity, tilt, contacts, drift, and consistency.

Every episode is a walk at a random velocity, of which the estimator knows nothing but the readings and what the
controller plans. Its errors are taken at every physics step, at the time of the reading. An estimator is consistent if
its errors are as large as it believes: the normalised estimation error squared (NEES) of roll, pitch and velocity is 1
for each degree of freedom on average (Bar-Shalom, Li, Kirubarajan, *Estimation with Applications to Tracking and
Navigation*, 2001, section 5.4).
"""

import dataclasses
import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from hugwbc.commands import Command, default_command
from hugwbc.errors import ConfigError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import CONFIDENCE, Estimate, bootstrap_mean
from hugwbc.evaluation.protocols.episodes import CountedResult, CountedSettings, Run, SettledJudge
from hugwbc.evaluation.protocols.protocol import (
    INTERVAL,
    INTERVAL_NOTE,
    PlannedProtocol,
    count_text,
    failure_lines,
    interval_text,
)
from hugwbc.evaluation.tables import format_table
from hugwbc.gait import Gait
from hugwbc.runtime.estimate_watch import DEGREES, EstimateRecord
from hugwbc.runtime.trace import SHORTEST_SWING

RANDOM = {"v_x": (-0.3, 1.0), "v_y": (-0.2, 0.2), "omega": (-0.5, 0.5)}  # [m/s], [rad/s]
DRIFT_WAY = 20.0  # [m], to which drifts are scaled
_SHORTEST_WAY = 1.0  # [m]; from less, no drift is scaled
_WAY_STEP = 0.5  # [s]; a path is measured in steps of this time, which leaves out the sway of a walk
_SLOW = 0.1  # [s]; the change of a contact is looked for within this time
# Figure by field: name and unit in tables, factor from SI units, whether it is an RMS or a mean.
_FIGURES = {
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


@dataclasses.dataclass(frozen=True)
class EstimationConfig(CountedSettings):
    """Settings of the estimation protocol, in addition to `CountedSettings`.

    Attributes:
        episodes: number of walks.
        speed: forward velocity of all walks, straight ahead [m/s]; None draws velocities and turns at random.
    """

    episodes: int = 50
    _: dataclasses.KW_ONLY
    speed: float | None = None
    duration: float = 8.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.conditions.chosen.estimates:
            raise ConfigError("these sensors tell the whole state; give --sensing robot")
        if self.speed is not None:
            dataclasses.replace(default_command(self.gait), v_x=self.speed).validate()


@dataclasses.dataclass(frozen=True)
class EstimationEpisode:
    """One walk, after its settling time; None where there is nothing to measure.

    Attributes:
        command: commanded velocities by name.
        v_x, v_y, v_z: RMS error of the pelvis's velocity in the heading frame [m/s].
        roll, pitch: RMS error [rad].
        nees: mean normalised estimation error squared of tilt and velocity, for each degree of freedom.
        false_contact: share of the time in the air in which a foot is said to stand.
        missed_contact: share of the time on the ground in which it is said to be in the air.
        touch_down_delay: mean time from touch-downs until they are inferred, negative if that is earlier [s].
        lift_off_delay: the same of lift-offs [s].
        drift: change of the horizontal error of the position, for a way of 20 m [m].
        height_drift: change of the error of the height, for a way of 20 m, without its sign [m].
        yaw_drift: change of the error of the heading, for a way of 20 m, without its sign [rad].
        way: length of the path [m].
        fell: whether the robot fell.
        failures: number of exceptions of the controller that the safety filter caught.
    """

    command: dict[str, float]
    v_x: float | None
    v_y: float | None
    v_z: float | None
    roll: float | None
    pitch: float | None
    nees: float | None
    false_contact: float | None
    missed_contact: float | None
    touch_down_delay: float | None
    lift_off_delay: float | None
    drift: float | None
    height_drift: float | None
    yaw_drift: float | None
    way: float
    fell: bool
    failures: int


@dataclasses.dataclass(frozen=True, kw_only=True)
class EstimationResult(CountedResult[EstimationEpisode]):
    """Result of the estimation protocol, in addition to `CountedResult`.

    Attributes:
        figures: RMS errors and means over the episodes, in the units of the rows, with their intervals.
        nees: mean over the episodes, with its interval.
        nees_bounds: where a consistent estimator's mean lies with 95 % confidence, if the errors within a walk are one
            sample only.
    """

    figures: dict[str, Estimate]
    nees: Estimate
    nees_bounds: tuple[float, float]


def chi_square_bounds(degrees: int) -> tuple[float, float]:
    """Return where a mean square of `degrees` standard normal numbers lies with 95 % confidence.

    Quantiles by the cube-root approximation of Wilson and Hilferty (1931), right to 0.1 % from 50 degrees on.
    """
    z = statistics.NormalDist().inv_cdf((1.0 + CONFIDENCE) / 2)
    part = 2.0 / (9.0 * degrees)
    low, high = ((1.0 - part + sign * z * math.sqrt(part)) ** 3 for sign in (-1.0, 1.0))
    return low, high


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


class EstimationJudge(SettledJudge):
    """Judge that compares the estimates of a walk with the truth."""

    def __call__(self, index: int, run: Run) -> EstimationEpisode:
        """Return the row of one episode."""
        assert run.estimates is not None  # every plan of the protocol asks for them
        record = run.estimates.after(self.settle)
        return EstimationEpisode(
            command={name: getattr(run.command, name) for name in RANDOM},
            **(_errors(record) if record.time.size else dict.fromkeys(_ERROR_FIELDS)),
            way=_way(record),
            fell=run.trace.fell,
            failures=run.trace.safety.failures,
        )


_ERROR_FIELDS = ("nees", *_FIGURES)


def _errors(record: EstimateRecord) -> dict[str, Any]:
    rms = np.sqrt(np.mean(np.hstack([record.velocity, record.tilt]) ** 2, axis=0)).tolist()
    true, inferred, time = record.touching, record.inferred, record.time
    both = [(inferred[:, foot], true[:, foot]) for foot in range(2)]
    downs, lifts = ([d for i, t in both for d in delays(i, t, time, down=down)] for down in (True, False))
    sampled = record.nees[np.isfinite(record.nees)]
    way = _way(record)
    scale = DRIFT_WAY / way if way >= _SHORTEST_WAY else None
    moved = record.position[-1] - record.position[0]
    turned = float(np.unwrap(record.yaw)[-1] - record.yaw[0])
    return {
        **dict(zip(("v_x", "v_y", "v_z", "roll", "pitch"), rms, strict=True)),
        "nees": float(sampled.mean()) / DEGREES if sampled.size else None,
        "false_contact": _share(inferred & ~true, ~true),
        "missed_contact": _share(true & ~inferred, true),
        "touch_down_delay": _mean(downs),
        "lift_off_delay": _mean(lifts),
        "drift": None if scale is None else scale * float(np.hypot(moved[0], moved[1])),
        "height_drift": None if scale is None else scale * abs(float(moved[2])),
        "yaw_drift": None if scale is None else scale * abs(turned),
    }


def _share(event: np.ndarray, of: np.ndarray) -> float | None:
    return float(event.sum() / of.sum()) if of.any() else None


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


def _way(record: EstimateRecord) -> float:
    """Return the length of the true path [m]."""
    if record.time.size < 2:
        return 0.0
    stride = max(1, round(_WAY_STEP / float(record.time[1] - record.time[0])))
    return float(np.linalg.norm(np.diff(record.true_position[::stride, :2], axis=0), axis=1).sum())


class EstimationProtocol(PlannedProtocol[EstimationConfig, EstimationEpisode, EstimationResult]):
    """The state estimator against the truth."""

    name = "estimation"
    summary = "the state estimator against the truth: velocity, tilt, contacts, drift, and its own covariance"
    settings = EstimationConfig
    result = EstimationResult
    report_title = "State estimation"
    report_text = (
        "What the controllers read: a state estimated from IMU, encoders and joint torques. Walks at random "
        "velocities; RMS errors in the heading frame over walks. NEES: the errors, squared, relative to what the "
        "estimator believes; 1 if it is consistent. Drifts are scaled to a way of 20 m."
    )

    def plans(self, settings: EstimationConfig) -> list[EpisodePlan]:
        """Return walks at random velocities, or all at one speed."""
        commands = [walk_command(settings, number) for number in range(settings.episodes)]
        return [EpisodePlan(command, estimated=True) for command in commands]

    def judge(self, settings: EstimationConfig) -> EstimationJudge:
        """Return the judge of the estimates."""
        return EstimationJudge(settings.settle)

    def summarise(self, settings: EstimationConfig, rows: Sequence[EstimationEpisode]) -> dict[str, Any]:
        """Return RMS errors, means, and the consistency."""
        nees = bootstrap_mean(row.nees for row in rows)
        return {
            "figures": {name: figure_of(name, (getattr(row, name) for row in rows)) for name in _FIGURES},
            "nees": nees,
            "nees_bounds": chi_square_bounds(DEGREES * max(nees.samples, 1)),
        }

    def describe(self, result: EstimationResult) -> str:
        """Return errors, contacts, drifts and consistency."""
        rows: list[tuple[object, ...]] = []
        for name, (label, unit, factor, _) in _FIGURES.items():
            shown = _scaled(result.figures[name], factor)
            rows.append((f"{label} [{unit}]", shown.value, interval_text(shown, 3)))
        low, high = result.nees_bounds
        rows.append(("NEES for each degree of freedom", result.nees.value, interval_text(result.nees, 2)))
        table = format_table((f"{result.gait}, RMS error or mean", result.controller, INTERVAL), rows)
        consistent = f"NEES of a consistent estimator, one sample for each walk: {low:.2f} to {high:.2f}"
        falls = f"falls: {count_text(result.falls, result.episodes)}"
        return "\n".join([table, "", consistent, falls, INTERVAL_NOTE, *failure_lines(result.rows)])

    def quick(self) -> list[EstimationConfig]:
        """Return two short walks."""
        return [EstimationConfig(episodes=2, duration=5.0, conditions=Conditions())]

    def full(self) -> list[EstimationConfig]:
        """Return 50 walks at random, and 8 of 20 m straight ahead."""
        arena = Conditions()
        return [
            EstimationConfig(conditions=arena),
            EstimationConfig(episodes=8, speed=0.5, duration=41.0, conditions=arena),
        ]

    def figures(self, controller: str, result: Mapping[str, Any]) -> list[Figure]:
        """Return errors, contacts, drifts and consistency."""
        table, rows = f"State estimation, {result['gait']}, {result['duration']:g} s", result["rows"]
        figures = []
        for name, (label, unit, factor, _) in _FIGURES.items():
            estimate = _scaled(figure_of(name, (row[name] for row in rows)), factor)
            figures.append(Figure(table, label, unit, controller, estimate))
        figures.append(Figure(table, "NEES", "", controller, bootstrap_mean(row["nees"] for row in rows)))
        return [*figures, falls_figure(table, controller, rows)]


def walk_command(settings: EstimationConfig, number: int) -> Command:
    """Return the command of one walk, drawn from the seed and its number where no speed is given."""
    command = default_command(settings.alternating[number % 2])
    if settings.speed is not None:
        return dataclasses.replace(command, v_x=settings.speed)
    if settings.gait is Gait.STANDING:
        return command
    rng = np.random.default_rng((settings.seed, number))
    return dataclasses.replace(command, **{name: float(rng.uniform(*bounds)) for name, bounds in RANDOM.items()})


def figure_of(name: str, values: Iterable[float | None]) -> Estimate:
    """Return one of the figures over all episodes: a mean, or the RMS of RMS errors, with its interval."""
    if not _FIGURES[name][3]:
        return bootstrap_mean(values)
    squares = bootstrap_mean(None if value is None else value**2 for value in values)
    value, low, high = (None if v is None else math.sqrt(v) for v in (squares.value, squares.low, squares.high))
    return Estimate(value, low, high, squares.samples)


def _scaled(estimate: Estimate, factor: float) -> Estimate:
    value, low, high = (None if v is None else factor * v for v in (estimate.value, estimate.low, estimate.high))
    return Estimate(value, low, high, estimate.samples)
