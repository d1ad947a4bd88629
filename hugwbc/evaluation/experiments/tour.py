"""A tour with blows: 60 s over 12 waypoints, the arms moved from outside, a blow on a random link before each.

The experiment follows the public comparison of controllers for Unitree's G1 by rhoyn
(NVlabs/GR00T-WholeBodyControl issue 269), in which a blow is up to 600 N for 0.08 s. Here the force is scaled by the
robots' masses, so that it changes the velocity as much, and the arms follow the noise of the paper's intervention.
Robot and waypoints differ from that comparison: these figures compare controllers of the H1 with one another only.
"""

import dataclasses
import math

import numpy as np
import polars as pl

from hugwbc import rotations
from hugwbc.controller import Controller
from hugwbc.evaluation.episode import MOVING, CountedSettings, Row, ending, simulate
from hugwbc.evaluation.experiment import Experiment, Section
from hugwbc.evaluation.figures import Figure
from hugwbc.evaluation.intervals import bootstrap_mean, wilson_percentage
from hugwbc.evaluation.plans import Plan, Tour, Waypoint
from hugwbc.robot import load_robot
from hugwbc.settings import Count, NotNegative, Positive, settings
from hugwbc.sim import Force

WAYPOINTS = 12
REACHED = 0.5  # [m] from a waypoint at the end of its time
G1_MASS = 35.0  # [kg], the maker's figure
BLOW_TIME = 0.08  # [s]
AFTERMATH = 3.0  # [s] after a blow in which a fall is attributed to it; later falls come from the arms or the walk
STRUCK = ("shoulder_roll", "elbow", "hip_pitch", "knee")  # parts whose links are struck, besides pelvis and trunk
# Way between two waypoints [m], change of the heading in it and bearing off the heading, both plus or minus [rad].
_LENGTH, _TURN, _BEARING = (0.8, 1.5), 1.0, 0.6


@settings(kw_only=True)
class TourSettings(CountedSettings):
    """Settings of tour."""

    episodes: Count = 8  # number of tours, each with its own waypoints and blows
    # force of the strongest blow on a G1, which is scaled to this robot's mass [N]; 0 for no blows
    blow: NotNegative = 600.0
    duration: Positive = 60.0  # length of a tour [s]
    possible = MOVING


def strongest_blow(settings: TourSettings) -> float:
    """Return the force on this robot that changes its velocity as much as `settings.blow` does that of a G1 [N]."""
    return settings.blow * load_robot(settings.conditions.chosen.robot).mass / G1_MASS


def plan(settings: TourSettings) -> list[Plan]:
    """Return the drawn tours."""
    return [tour_plan(settings, number) for number in range(settings.episodes)]


def tour_plan(settings: TourSettings, number: int) -> Plan:
    """Draw waypoints and blows of one tour from the seed and its number."""
    rng = np.random.default_rng((settings.seed, number))
    leg = settings.duration / WAYPOINTS
    place, yaw = np.zeros(2), 0.0
    waypoints, blows, robot = [], [], load_robot(settings.conditions.chosen.robot)
    struck = (robot.base, robot.trunk, *(link for part in STRUCK for link in robot.moved[part]))
    for index in range(WAYPOINTS):
        bearing = yaw + rng.uniform(-_BEARING, _BEARING)
        place = place + rng.uniform(*_LENGTH) * np.array([math.cos(bearing), math.sin(bearing)])
        yaw = float(rotations.wrap_angle(yaw + rng.uniform(-_TURN, _TURN)))
        waypoints.append(Waypoint(float(place[0]), float(place[1]), yaw))
        # The blow comes at 0.2 to 0.7 of its leg, which leaves 1.5 s of a 60 s tour to recover before the waypoint.
        start, force, angle = leg * (index + rng.uniform(0.2, 0.7)), rng.uniform(), rng.uniform(-math.pi, math.pi)
        vector = strongest_blow(settings) * force * np.array([math.cos(angle), math.sin(angle)])
        blows.append(Force((*vector.tolist(), 0.0), start, BLOW_TIME, str(rng.choice(struck))))
    arms = "noise" if settings.conditions.intervention == "none" else settings.conditions.intervention
    conditions = dataclasses.replace(settings.conditions, intervention=arms)
    tour = Tour(tuple(waypoints), leg, settings.gaits[number % 2])
    return Plan(number, tour, forces=tuple(blows), conditions=conditions)


def episode(controller: Controller, settings: TourSettings, plan: Plan) -> Row:
    """Compare the pose at the end of every leg with its waypoint.

    - `reached`: number of waypoints within 0.5 m at the end of their legs.
    - `position_error`, `yaw_error`: mean distance and angle to the waypoints at the ends of survived legs [m], [rad].
    - `blows`: number of blows before the end; `felled`: whether the robot fell within `AFTERMATH` of one.
    """
    trace, tour = simulate(controller, settings, plan).trace, plan.commands
    assert isinstance(tour, Tour)
    errors = []
    struck = [f.start for f in plan.forces if any(f.vector) and f.start < trace.survived_s]
    for number, goal in enumerate(tour.waypoints, start=1):
        end = number * tour.leg
        if trace.survived_s < end - 1e-6:
            break
        qpos = trace.qpos[np.searchsorted(trace.time, end - 1e-6) - 1]
        turned = rotations.wrap_angle(goal.yaw - float(rotations.yaw_of(qpos[3:7])))
        errors.append((math.hypot(goal.x - qpos[0], goal.y - qpos[1]), abs(float(turned))))
    return {
        "reached": sum(distance <= REACHED for distance, _ in errors),
        "position_error": bootstrap_mean(distance for distance, _ in errors).value,
        "yaw_error": bootstrap_mean(angle for _, angle in errors).value,
        "blows": len(struck),
        "felled": trace.fell and bool(struck) and trace.survived_s - max(struck) <= AFTERMATH,
        **ending(trace),
    }


def blow_outcomes(blows: int, felled: bool) -> list[bool]:
    """Return for each blow of a tour whether the robot survived it; only the last one can have `felled` it."""
    return [*[True] * (blows - 1), not felled][:blows]


def figures(settings: TourSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return how far the tours went, and how near they came to their waypoints."""
    table = f"Tour with blows, {settings.gait}"
    blows = [up for count, felled in rows.select("blows", "felled").iter_rows() for up in blow_outcomes(count, felled)]
    reached = bootstrap_mean([100.0 * count / WAYPOINTS for count in rows["reached"]])
    return [
        Figure(table, "completed", "% of tours", wilson_percentage((~rows["fell"]).to_list()), higher_is_better=True),
        Figure(table, "blows survived", "% of blows", wilson_percentage(blows), higher_is_better=True),
        Figure(table, "waypoints reached", "%", reached, higher_is_better=True),
        Figure(table, "survived", "s", bootstrap_mean(rows["survived_s"]), higher_is_better=True),
        Figure(table, "position error", "m", bootstrap_mean(rows["position_error"])),
        Figure(table, "yaw error", "rad", bootstrap_mean(rows["yaw_error"])),
    ]


EXPERIMENT = Experiment(
    "tour",
    "walk over 12 waypoints with the arms moved and a blow on the way to each",
    TourSettings,
    plan,
    episode,
    figures,
    note="The blows are those on a G1, scaled by mass. Intervals of completion and blows: Wilson's score interval.",
    section=Section(
        "Tour with blows",
        "60 s over 12 waypoints, the arms moved by noise, one blow of 0.08 s per leg on a random link; the strongest "
        "changes the velocity as much as 600 N do that of a G1: 1.4 m/s. A waypoint is reached within 0.5 m. A blow is "
        "survived if the robot does not fall within 3 s; the intervals of completion and of blows are score intervals.",
        lambda: [TourSettings(episodes=1)],
        lambda: [TourSettings(episodes=64)],
    ),
)
