"""A tour with punches: 60 s over 12 waypoints, the arms moved from outside, one blow a leg on a random link.

After the public comparison of controllers for Unitree's G1 by rhoyn (NVlabs/GR00T-WholeBodyControl issue 269): there a
blow is up to 600 N for 0.08 s. Here it is scaled by the robots' masses, so that it changes the velocity as much; the
arms have the noise of the paper's intervention. Another robot, and other waypoints: the figures compare controllers of
the H1 with one another, not with that list.
"""

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from hugwbc import rotations
from hugwbc.errors import ConfigError
from hugwbc.evaluation.engine import EpisodePlan, Tour, Waypoint
from hugwbc.evaluation.protocols.episodes import (
    ControllerFactory,
    CountedResult,
    CountedSettings,
    Run,
    mean,
    run_episodes,
)
from hugwbc.gait import Gait
from hugwbc.sim import Force
from hugwbc.sim.scene import robot_mass

WAYPOINTS = 12
REACHED = 0.5  # [m] from a waypoint at the end of its leg
G1_MASS = 35.0  # [kg], the maker's figure
BLOW_TIME = 0.08  # [s]
AFTERMATH = 3.0  # [s] in which a fall is put down to a blow; a later one to the arms or the walk
STRUCK = (
    "pelvis", "torso_link", "left_shoulder_roll_link", "right_shoulder_roll_link", "left_elbow_link",
    "right_elbow_link", "left_hip_pitch_link", "right_hip_pitch_link", "left_knee_link", "right_knee_link",
)  # fmt: skip
_LENGTH, _TURN, _BEARING = (0.8, 1.5), 1.0, 0.6  # of a leg [m]; of the heading and off it, plus or minus [rad]


@dataclasses.dataclass(frozen=True)
class TourConfig(CountedSettings):
    """Settings of the protocol, beside those of any of one gait.

    Attributes:
        episodes: tours, each with its own waypoints and blows.
        blow: the strongest, on a G1 [N]; 0 for none.
        duration: of a tour [s].
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
        reached: waypoints within 0.5 m at the end of their legs.
        position_error: mean distance to the waypoint at the end of the legs that the robot survived [m].
        yaw_error: mean angle to its yaw there [rad].
        blows: that it was dealt before its end.
        felled: whether it fell within `AFTERMATH` of a blow.
        fell: whether the robot fell.
        survived_s: [s].
        failures: exceptions of the controller that the safety filter caught.
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
    """Outcome of the protocol, beside what any has.

    Attributes:
        strongest_blow: on this robot, scaled by the masses [N].
        completed: share of the tours without a fall.
        blows: dealt in all.
        blows_survived: share of the blows after which the robot did not fall within `AFTERMATH`.
        reached: share of the waypoints.
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
    """The strongest blow on this robot: as much change of velocity as `config.blow` is for a G1 [N]."""
    return config.blow * robot_mass() / G1_MASS


def tour_plan(config: TourConfig, number: int) -> EpisodePlan:
    """Waypoints and blows of one tour, drawn from the seed and its number."""
    rng = np.random.default_rng((config.seed, number))
    leg = config.duration / WAYPOINTS
    place, yaw = np.zeros(2), 0.0
    waypoints, blows = [], []
    for index in range(WAYPOINTS):
        bearing = yaw + rng.uniform(-_BEARING, _BEARING)
        place = place + rng.uniform(*_LENGTH) * np.array([math.cos(bearing), math.sin(bearing)])
        yaw = float(rotations.wrap_angle(yaw + rng.uniform(-_TURN, _TURN)))
        waypoints.append(Waypoint(float(place[0]), float(place[1]), yaw))
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


def run_tour(
    factory: ControllerFactory, config: TourConfig, on_episode: Callable[[TourEpisode], None] | None = None
) -> TourResult:
    """Run the protocol.

    Args:
        factory: makes the controller; with more than one worker it must be picklable.
        config: settings.
        on_episode: called with every finished tour, in order.
    """
    plans = [tour_plan(config, number) for number in range(config.episodes)]
    rows = run_episodes(factory, plans, TourJudge(), config, on_episode)
    return TourResult.of(
        factory,
        config,
        rows,
        strongest_blow=strongest_blow(config),
        completed=sum(not row.fell for row in rows) / len(rows),
        blows=sum(row.blows for row in rows),
        blows_survived=mean(outcome for row in rows for outcome in blow_outcomes(row.blows, row.felled)),
        reached=sum(row.reached for row in rows) / (WAYPOINTS * len(rows)),
        position_error=mean(row.position_error for row in rows),
        yaw_error=mean(row.yaw_error for row in rows),
        survived_s=float(np.mean([row.survived_s for row in rows])),
    )


def blow_outcomes(blows: int, felled: bool) -> list[bool]:
    """For each blow of a tour, whether the robot survived it: the last one `felled` it, or none."""
    return [*[True] * (blows - 1), not felled][:blows]


@dataclasses.dataclass(frozen=True)
class TourJudge:
    """Compares the pose at the end of every leg with its waypoint."""

    def __call__(self, index: int, run: Run) -> TourEpisode:
        """The row of one tour."""
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
