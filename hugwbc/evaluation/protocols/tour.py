"""A tour with blows: 60 s over 12 waypoints, the arms moved from outside, one blow on a random link in every leg.

The protocol follows the public comparison of controllers for Unitree's G1 by rhoyn
(NVlabs/GR00T-WholeBodyControl issue 269), in which a blow is up to 600 N for 0.08 s. Here the force is scaled by the
robots' masses, so that it changes the velocity as much, and the arms follow the noise of the paper's intervention.
Robot and waypoints differ from that comparison: these figures compare controllers of the H1 with one another only.
"""

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from hugwbc import rotations
from hugwbc.errors import ConfigError
from hugwbc.evaluation.engine import EpisodePlan, Tour, Waypoint
from hugwbc.evaluation.figures import Figure
from hugwbc.evaluation.intervals import bootstrap_mean, wilson_percentage
from hugwbc.evaluation.protocols.episodes import CountedResult, CountedSettings, Run, mean
from hugwbc.evaluation.protocols.protocol import INTERVAL, PlannedProtocol, failure_lines, interval_text
from hugwbc.evaluation.tables import format_table
from hugwbc.gait import Gait
from hugwbc.robot import load_robot
from hugwbc.sim import Force

WAYPOINTS = 12
REACHED = 0.5  # [m] from a waypoint at the end of its leg
G1_MASS = 35.0  # [kg], the maker's figure
BLOW_TIME = 0.08  # [s]
AFTERMATH = 3.0  # [s] after a blow in which a fall is attributed to it; later falls come from the arms or the walk
STRUCK = (
    "pelvis", "torso_link", "left_shoulder_roll_link", "right_shoulder_roll_link", "left_elbow_link",
    "right_elbow_link", "left_hip_pitch_link", "right_hip_pitch_link", "left_knee_link", "right_knee_link",
)  # fmt: skip
# Length of a leg [m], change of the heading in it and bearing off the heading, both plus or minus [rad].
_LENGTH, _TURN, _BEARING = (0.8, 1.5), 1.0, 0.6


@dataclasses.dataclass(frozen=True)
class TourConfig(CountedSettings):
    """Settings of the tour protocol, in addition to `CountedSettings`.

    Attributes:
        episodes: number of tours, each with its own waypoints and blows.
        blow: force of the strongest blow on a G1, which is scaled to this robot's mass [N]; 0 for no blows.
        duration: length of a tour [s].
    """

    gait: Gait = Gait.WALKING
    episodes: int = 8
    _: dataclasses.KW_ONLY
    blow: float = 600.0
    duration: float = 60.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.gait is Gait.STANDING:
            raise ConfigError("a tour needs a gait that moves; choose another than standing")
        if not 0.0 <= self.blow < math.inf:
            raise ConfigError(f"the strongest blow is {self.blow} N; give a finite force, 0 N for none")


@dataclasses.dataclass(frozen=True)
class TourEpisode:
    """One tour.

    Attributes:
        reached: number of waypoints within 0.5 m at the end of their legs.
        position_error: mean distance to the waypoint at the end of each survived leg [m].
        yaw_error: mean absolute angle to the waypoint's yaw at the end of each survived leg [rad].
        blows: number of blows before the end of the tour.
        felled: whether the robot fell within `AFTERMATH` of a blow.
        fell: whether the robot fell.
        survived_s: time until the fall, or the whole tour [s].
        failures: number of exceptions of the controller that the safety filter caught.
    """

    reached: int
    position_error: float | None
    yaw_error: float | None
    blows: int
    felled: bool
    fell: bool
    survived_s: float
    failures: int


@dataclasses.dataclass(frozen=True, kw_only=True)
class TourResult(CountedResult[TourEpisode]):
    """Result of the tour protocol, in addition to `CountedResult`.

    Attributes:
        strongest_blow: force of the strongest blow on this robot [N].
        completed: fraction of the tours without a fall.
        blows: number of blows in all tours.
        blows_survived: fraction of the blows after which the robot did not fall within `AFTERMATH`.
        reached: fraction of the waypoints that were reached.
        position_error: mean over the tours [m].
        yaw_error: mean over the tours [rad].
        survived_s: mean over the tours [s].
    """

    strongest_blow: float
    completed: float
    blows: int
    blows_survived: float | None
    reached: float
    position_error: float | None
    yaw_error: float | None
    survived_s: float


def strongest_blow(config: TourConfig) -> float:
    """Return the force on this robot that changes its velocity as much as `config.blow` does that of a G1 [N]."""
    return config.blow * load_robot(config.conditions.chosen.robot).mass / G1_MASS


def tour_plan(config: TourConfig, number: int) -> EpisodePlan:
    """Draw waypoints and blows of one tour from the seed and its number."""
    rng = np.random.default_rng((config.seed, number))
    leg = config.duration / WAYPOINTS
    place, yaw = np.zeros(2), 0.0
    waypoints, blows = [], []
    for index in range(WAYPOINTS):
        bearing = yaw + rng.uniform(-_BEARING, _BEARING)
        place = place + rng.uniform(*_LENGTH) * np.array([math.cos(bearing), math.sin(bearing)])
        yaw = float(rotations.wrap_angle(yaw + rng.uniform(-_TURN, _TURN)))
        waypoints.append(Waypoint(float(place[0]), float(place[1]), yaw))
        # The blow comes at 0.2 to 0.7 of its leg, which leaves 1.5 s of a 60 s tour to recover before the waypoint.
        start, force, angle = leg * (index + rng.uniform(0.2, 0.7)), rng.uniform(), rng.uniform(-math.pi, math.pi)
        vector = strongest_blow(config) * force * np.array([math.cos(angle), math.sin(angle)])
        blows.append(Force((*vector.tolist(), 0.0), start, BLOW_TIME, str(rng.choice(STRUCK))))
    arms = "noise" if config.conditions.intervention == "none" else config.conditions.intervention
    return EpisodePlan(
        Tour(tuple(waypoints), leg, config.alternating[number % 2]),
        tuple(blows),
        dataclasses.replace(config.conditions, intervention=arms),
        draw=number,
    )


def blow_outcomes(blows: int, felled: bool) -> list[bool]:
    """Return for each blow of a tour whether the robot survived it; only the last one can have `felled` it."""
    return [*[True] * (blows - 1), not felled][:blows]


@dataclasses.dataclass(frozen=True)
class TourJudge:
    """Judge that compares the pose at the end of every leg with its waypoint."""

    def __call__(self, index: int, run: Run) -> TourEpisode:
        """Return the row of one tour."""
        tour, trace = run.plan.commands, run.trace
        assert isinstance(tour, Tour)
        errors = []
        struck = [f.start for f in run.plan.forces if any(f.vector) and f.start < trace.survived_s]
        for number, goal in enumerate(tour.waypoints, start=1):
            end = number * tour.leg
            if trace.survived_s < end - 1e-6:
                break
            qpos = trace.qpos[np.searchsorted(trace.time, end - 1e-6) - 1]
            turned = rotations.wrap_angle(goal.yaw - float(rotations.yaw_of(qpos[3:7])))
            errors.append((math.hypot(goal.x - qpos[0], goal.y - qpos[1]), abs(float(turned))))
        return TourEpisode(
            reached=sum(distance <= REACHED for distance, _ in errors),
            position_error=mean(distance for distance, _ in errors),
            yaw_error=mean(angle for _, angle in errors),
            blows=len(struck),
            felled=trace.fell and bool(struck) and trace.survived_s - max(struck) <= AFTERMATH,
            fell=trace.fell,
            survived_s=trace.survived_s,
            failures=trace.safety.failures,
        )


class TourProtocol(PlannedProtocol[TourConfig, TourEpisode, TourResult]):
    """Tours over waypoints with blows."""

    name = "tour"
    summary = "walk over 12 waypoints with the arms moved and a blow on each leg of the tour"
    settings = TourConfig
    result = TourResult
    report_title = "Tour with blows"
    report_text = (
        "60 s over 12 waypoints, the arms moved by noise, one blow of 0.08 s per leg on a random link; the strongest "
        "changes the velocity as much as 600 N do that of a G1: 1.4 m/s. A waypoint is reached within 0.5 m. A blow is "
        "survived if the robot does not fall within 3 s; the intervals of completion and of blows are score intervals."
    )

    def plans(self, settings: TourConfig) -> list[EpisodePlan]:
        """Return the drawn tours."""
        return [tour_plan(settings, number) for number in range(settings.episodes)]

    def judge(self, settings: TourConfig) -> TourJudge:
        """Return the judge of the waypoints."""
        return TourJudge()

    def summarise(self, settings: TourConfig, rows: Sequence[TourEpisode]) -> dict[str, Any]:
        """Return completion, blows survived, and errors at the waypoints."""
        return {
            "strongest_blow": strongest_blow(settings),
            "completed": sum(not row.fell for row in rows) / len(rows),
            "blows": sum(row.blows for row in rows),
            "blows_survived": mean(outcome for row in rows for outcome in blow_outcomes(row.blows, row.felled)),
            "reached": sum(row.reached for row in rows) / (WAYPOINTS * len(rows)),
            "position_error": mean(row.position_error for row in rows),
            "yaw_error": mean(row.yaw_error for row in rows),
            "survived_s": float(np.mean([row.survived_s for row in rows])),
        }

    def describe(self, result: TourResult) -> str:
        """Return completion, blows and errors at the waypoints."""
        blows = [up for row in result.rows for up in blow_outcomes(row.blows, row.felled)]
        reached = [100.0 * row.reached / WAYPOINTS for row in result.rows]
        rows = [
            ("tours completed [%]", *_share([not row.fell for row in result.rows])),
            (f"of {result.blows} blows survived [%]", *_share(blows)),
            ("waypoints reached [%]", f"{100.0 * result.reached:.0f}", _bounds(reached, 0)),
            ("position error [m]", result.position_error, _bounds((r.position_error for r in result.rows), 3)),
            ("yaw error [rad]", result.yaw_error, _bounds((r.yaw_error for r in result.rows), 3)),
            (
                "survived [s]",
                f"{result.survived_s:.1f} of {result.duration:g}",
                _bounds((r.survived_s for r in result.rows), 1),
            ),
        ]
        table = format_table((f"{result.gait}, {result.episodes} tours", result.controller, INTERVAL), rows)
        blow = f"blows of up to {result.strongest_blow:.0f} N for 0.08 s: those on a G1, scaled by mass"
        blow += "; intervals: of completion and of blows Wilson's, of the others by bootstrap"
        return "\n".join([table, "", blow, *failure_lines(result.rows)])

    def quick(self) -> list[TourConfig]:
        """Return one tour."""
        return [TourConfig(episodes=1)]

    def full(self) -> list[TourConfig]:
        """Return 64 tours."""
        return [TourConfig(episodes=64)]

    def figures(self, controller: str, result: Mapping[str, Any]) -> list[Figure]:
        """Return how far the tours went, and how near they came to their waypoints."""
        table, rows = f"Tour with blows, {result['gait']}", result["rows"]
        upright = wilson_percentage([not row["fell"] for row in rows])
        blows = wilson_percentage([up for row in rows for up in blow_outcomes(row["blows"], row["felled"])])
        reached = bootstrap_mean([100.0 * row["reached"] / WAYPOINTS for row in rows])
        survived = bootstrap_mean([row["survived_s"] for row in rows])
        return [
            Figure(table, "completed", "% of tours", controller, upright, higher_is_better=True),
            Figure(table, "blows survived", "% of blows", controller, blows, higher_is_better=True),
            Figure(table, "waypoints reached", "%", controller, reached, higher_is_better=True),
            Figure(table, "survived", "s", controller, survived, higher_is_better=True),
            Figure(table, "position error", "m", controller, bootstrap_mean([row["position_error"] for row in rows])),
            Figure(table, "yaw error", "rad", controller, bootstrap_mean([row["yaw_error"] for row in rows])),
        ]


def _share(happened: list[bool]) -> tuple[str | None, str | None]:
    """Return the percentage of cases in which something happened, and its score interval."""
    share = wilson_percentage(happened)
    return None if share.value is None else f"{share.value:.0f}", interval_text(share, 0)


def _bounds(samples: Iterable[float | None], decimals: int) -> str | None:
    return interval_text(bootstrap_mean(samples), decimals)
