"""All benchmarks in one run: training, controllers and hand IK."""

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING

from hugwbc.learned.config.training_settings import Device
from hugwbc.settings import Count, Positive, settings

if TYPE_CHECKING:
    from hugwbc.benchmarks.speed import EpisodeSpeed, QpSpeed, TrainingSpeed


@settings
class BenchSettings:
    """Sizes of the benchmarks."""

    count: tuple[Count, ...] = (1024,)  # robots in training; of several numbers, one after the other
    device: Device = "auto"  # of training, as in hugwbc train
    control_steps: Count = 50  # steps of the training environment to measure
    iterations: Count = 2  # training iterations to measure, of 24 control steps and one update each
    threads: Count = 1  # threads of training and bare physics; controllers and IK use one
    # simulated time over which the QP is measured, standing, walking and jumping each, and every episode [s]
    seconds: Positive = 4.0
    calls: Count = 500  # calls of the policy and of the IK to measure


@dataclasses.dataclass(frozen=True)
class BenchFigures:
    """Figures of all benchmarks.

    Attributes:
        training: speed of training and its parts, by number of robots.
        qp: speed of `qp`, by gait.
        episodes: speed of an episode with everything in the loop, by controller and activity.
        policy_tick_ms, ik_tick_ms: p50 and p99 of one call of the policy and of the hand IK [ms].
        threads: threads of training, its environment and bare physics.
    """

    training: list["TrainingSpeed"]
    qp: dict[str, "QpSpeed"]
    episodes: dict[str, "EpisodeSpeed"]
    policy_tick_ms: dict[str, float | None]
    ik_tick_ms: dict[str, float | None]
    threads: int


def measure_training(settings: BenchSettings) -> list["TrainingSpeed"]:
    """Return the speed of training by number of robots."""
    from hugwbc.benchmarks.speed import training_speed  # loads torch

    s = settings
    return [training_speed(count, s.control_steps, s.iterations, s.threads, s.device) for count in s.count]


def run_benchmarks(settings: BenchSettings, advance: Callable[[float], None]) -> BenchFigures:
    """Run all benchmarks, and call `advance` with the fraction done."""
    # Loads torch and the controllers.
    from hugwbc.benchmarks import speed
    from hugwbc.learned.policy import load_policy
    from hugwbc.runtime import load_controller

    training = measure_training(settings)
    advance(0.2)
    qp = {gait: speed.qp_speed(command, settings.seconds) for gait, command in speed.COMMANDS.items()}
    advance(0.5)
    policy = load_policy()
    episodes = {
        f"{name}, {activity}": speed.episode_speed(controller, activity, settings.seconds)
        for name, controller in (("qp", load_controller("qp")), ("policy", policy))
        for activity in speed.ACTIVITIES
    }
    policy_tick, ik_tick = speed.policy_tick(policy, settings.calls), speed.ik_tick(settings.calls)
    advance(1.0)
    return BenchFigures(training, qp, episodes, policy_tick, ik_tick, settings.threads)
