"""How closely the hands follow their targets in closed loop, standing or walking, with any controller."""

import math

import numpy as np
import polars as pl

from hugwbc.controller import Controller
from hugwbc.errors import ConfigError
from hugwbc.evaluation import metrics
from hugwbc.evaluation.episode import CountedSettings, Row, ending, simulate
from hugwbc.evaluation.experiment import Experiment, numbered
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import Estimate, bootstrap_mean, known, scaled, single
from hugwbc.evaluation.plans import Plan
from hugwbc.gait import Gait
from hugwbc.robot import Robot
from hugwbc.scripts.hand_paths import Line
from hugwbc.scripts.script import DEFAULT_RAMP, HandMotion, Script, Segment
from hugwbc.settings import Count, NotNegative, settings
from hugwbc.state import RobotState
from hugwbc.targets import HandTargets
from hugwbc.upper_ik import ArmIK

# Targets of the left hand in the pelvis frame [m] for an arm of this length [m]; for others in proportion. The right
# hand's are drawn from the mirror image.
LOW, HIGH, ARM = np.array([0.15, 0.08, -0.05]), np.array([0.48, 0.50, 0.55]), 0.6132
LEG_TIME, DWELL = 1.2, 0.8  # [s] from target to target, and at each
REACHED = 0.005  # [m]
_DRAWS = 50  # at most, for each pair of targets; an H1 and a G1 reach two thirds of the drawn pairs
STANDING_START, WALK = 1.0, 0.5  # [s] before a walk, and its velocity forwards [m/s]


@settings(kw_only=True)
class HandsSettings(CountedSettings):
    """Settings of hands."""

    episodes: Count = 8  # number of episodes, each with its own targets
    # start of an episode that is left out of the errors, in which the arms are taken over [s]
    settle: NotNegative = 2.0
    varied = frozenset({"intervention", "motions"})

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.gait != "standing" and not self.duration > STANDING_START + DEFAULT_RAMP:
            raise ConfigError(
                f"duration is {self.duration} s; give more than {STANDING_START + DEFAULT_RAMP:g} s, in which the "
                f"{self.gait} gait gets going"
            )


def arms_size(robot: Robot) -> float:
    """Return the length of a robot's arms relative to an H1's, to three digits."""
    return round((robot.upper_arm + robot.forearm) / ARM, 3)


def reachable_targets(count: int, rng: np.random.Generator, robot: Robot) -> np.ndarray:
    """Draw pairs of hand targets in the pelvis frame that the arms reach on a nominal body [m], shape (count, 2, 3)."""
    state = RobotState(robot.nominal, np.zeros_like(robot.nominal), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))
    ik, pairs, size = ArmIK(robot), [], arms_size(robot)
    for _ in range(_DRAWS * count):
        pair = size * rng.uniform(LOW, HIGH, (2, 3)) * np.array([[1.0, 1.0, 1.0], [1.0, -1.0, 1.0]])
        ik.reset(robot.nominal[robot.arms])
        targets = HandTargets(pair[0], pair[1])
        # 100 steps of 20 ms let the inverse kinematics converge from the nominal posture.
        solutions = [ik.solve(targets, state, 0.02) for _ in range(100)]
        if np.all(solutions[-1].residual < REACHED):
            pairs.append(pair)
        if len(pairs) == count:
            return np.array(pairs)
    raise ConfigError(
        f"{robot.name} reaches {len(pairs)} of {_DRAWS * count} pairs of targets from {size * LOW} to {size * HIGH} m "
        "in the frame of its pelvis; this experiment is for arms that do"
    )


def hands_script(settings: HandsSettings, rng: np.random.Generator, index: int = 0) -> Script:
    """Script one episode: both hands go from one reachable target to the next while the robot stands or moves.

    The number of the episode, `index`, decides the leg where the gait is hopping.
    """
    gait, robot = settings.gaits[index % 2], settings.conditions.told_arena.known_robot
    count = math.ceil(settings.duration / (LEG_TIME + DWELL)) + 1
    pairs = reachable_targets(count, rng, robot)
    left, right = (Line(tuple(tuple(p.tolist()) for p in pairs[:, hand]), LEG_TIME, DWELL) for hand in range(2))
    hands = HandMotion(left, right)
    if gait is Gait.STANDING:
        return Script("hands", (Segment("stand", settings.duration, hands=hands, ramp=0.0, robot=robot),))
    walk = Segment("go", settings.duration - STANDING_START, gait, {"v_x": WALK}, hands, robot=robot)
    return Script("hands", (Segment("stand", STANDING_START, hands=hands, robot=robot), walk))


def episode(controller: Controller, settings: HandsSettings, plan: Plan) -> Row:
    """Return the errors of the hands and arms after the settling time.

    - `hand_error_m`: mean distance of both hands to the targets that the inverse kinematics calls reachable [m].
    - `errors`, `reachable`: of every sample, for the left and the right hand.
    - `joint_error_rad`: mean distance of the arm joints to the inverse kinematics' solution [rad].
    """
    script = hands_script(settings, np.random.default_rng((settings.seed, plan.draw)), plan.draw)
    trace = simulate(controller, settings, plan, source=script, upper_body=settings.conditions.upper_body())
    kept = trace.time >= settings.settle
    joint_error = np.abs(trace.qpos[:, 7:][:, settings.robot.arms] - trace.arm_target)[kept]
    joint_error = joint_error[np.isfinite(joint_error)]
    hands = metrics.hand_errors(trace.hand_error[kept], trace.reachable[kept])
    return {
        "hand_error_m": hands["mean"],
        "reachable_fraction": hands["reachable_fraction"],
        "joint_error_rad": float(joint_error.mean()) if joint_error.size else None,
        "errors": [[known(error) for error in pair] for pair in trace.hand_error[kept].tolist()],
        "reachable": trace.reachable[kept].tolist(),
        **ending(trace),
    }


def figures(settings: HandsSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return the mean error over the episodes, the 95th percentile over all samples, the arm joints', and the falls.

    An episode counts once in the mean, however early it fell and whatever part of its targets was reachable.
    """
    table = f"Hands, {settings.gait}"
    samples = (
        np.array([pair for samples in rows[name].to_list() for pair in samples], dtype=kind).reshape(-1, 2)
        for name, kind in (("errors", float), ("reachable", bool))
    )
    pooled = metrics.hand_errors(*samples)
    mean = bootstrap_mean(rows["hand_error_m"])
    p95, reachable = Estimate(pooled["p95"], None, None, len(rows)), single(pooled["reachable_fraction"])
    return [
        Figure(table, "hand error, mean", "cm", scaled(mean, 100.0)),
        Figure(table, "hand error, 95th percentile", "cm", scaled(p95, 100.0)),
        Figure(table, "targets that the IK calls reachable", "", reachable, higher_is_better=True),
        Figure(table, "arm joints' error", "rad", bootstrap_mean(rows["joint_error_rad"])),
        falls_figure(table, rows["fell"]),
    ]


EXPERIMENT = Experiment(
    "hands",
    "accuracy of the hands, moving from one reachable target to the next",
    HandsSettings,
    numbered,
    episode,
    figures,
)
