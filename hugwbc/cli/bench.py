"""`hugwbc bench`: measure the speed of training, controllers, hand IK and whole episodes."""

import dataclasses
import pathlib
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from hugwbc.cli.output import check_writable, parse, progress, say, write_json
from hugwbc.evaluation.tables import Cell, format_table
from hugwbc.learned.config.training_settings import Device
from hugwbc.settings import Count, Positive, settings

if TYPE_CHECKING:
    from hugwbc.evaluation.speed import EpisodeSpeed, QpSpeed, TrainingSpeed


@settings
class BenchOptions:
    """Measure the speed of training, controllers, hand IK and whole episodes."""

    count: tuple[Count, ...] = (1024,)  # robots in training; of several numbers, one after the other
    device: Device = "auto"  # of training, as in hugwbc train
    control_steps: Count = 50  # steps of the training environment to measure
    iterations: Count = 2  # training iterations to measure, of 24 control steps and one update each
    threads: Count = 1  # threads of training and bare physics; controllers and IK use one
    # simulated time over which each episode is measured, and the QP in each of standing, walking and jumping [s]
    seconds: Positive = 4.0
    calls: Count = 500  # calls of the policy and of the IK to measure
    json: pathlib.Path | None = None  # Write the figures to this file; without a path, to standard output.
    training: bool = False  # Print only the speed of training and its parts.


@dataclasses.dataclass(frozen=True)
class BenchFigures:
    """Figures of all measurements."""

    training: list["TrainingSpeed"]  # speed of training and its parts, by number of robots
    qp: dict[str, "QpSpeed"]  # speed of `qp`, by gait
    episodes: dict[str, "EpisodeSpeed"]  # speed of an episode with everything in the loop, by controller and activity
    # policy_tick_ms and ik_tick_ms: p50 and p99 of one call of the policy and of the hand IK [ms]
    policy_tick_ms: dict[str, float | None]
    ik_tick_ms: dict[str, float | None]
    threads: int  # threads of training, its environment and bare physics


def run(words: Sequence[str]) -> int:
    """Parse, measure, print, write."""
    options = parse(BenchOptions, words, "bench")
    check_writable(options.json)
    if options.training:
        speeds = _measure_training(options)
        say(_training(speeds, options.threads), options.json)
        write_json(
            options.json, {"training": [dataclasses.asdict(speed) for speed in speeds], "threads": options.threads}
        )
        return 0
    with progress("benchmark") as advance:
        figures = _measure(options, advance)
    say(_describe(figures), options.json)
    write_json(options.json, dataclasses.asdict(figures))
    return 0


def _measure_training(options: BenchOptions) -> list["TrainingSpeed"]:
    from hugwbc.evaluation.speed import training_speed  # loads torch

    o = options
    return [training_speed(count, o.control_steps, o.iterations, o.threads, o.device) for count in o.count]


def _measure(options: BenchOptions, advance: Callable[[float], None]) -> BenchFigures:
    """Measure everything, and call `advance` with the fraction done."""
    from hugwbc.evaluation import speed
    from hugwbc.learned.policy import load_policy
    from hugwbc.runtime.controllers import load_controller

    training = _measure_training(options)
    advance(0.2)
    qp = {gait: speed.qp_speed(command, options.seconds) for gait, command in speed.COMMANDS.items()}
    advance(0.5)
    policy = load_policy()
    episodes = {
        f"{name}, {activity}": speed.episode_speed(controller, activity, options.seconds)
        for name, controller in (("qp", load_controller("qp")), ("policy", policy))
        for activity in speed.ACTIVITIES
    }
    policy_tick, ik_tick = speed.policy_tick(policy, options.calls), speed.ik_tick(options.calls)
    advance(1.0)
    return BenchFigures(training, qp, episodes, policy_tick, ik_tick, options.threads)


def _training(speeds: Sequence["TrainingSpeed"], threads: int) -> str:
    parts = ("bare", "environment", "learner", "training")
    rows = [(s.count, *(f"{getattr(s, part):.0f}" for part in parts), f"{s.training / s.bare:.2f}") for s in speeds]
    table = format_table(("robots", "bare physics", *parts[1:], "of bare"), rows)
    return f"control steps per second of one robot on {speeds[0].device}, {threads} thread(s)\n{table}"


def _describe(figures: BenchFigures) -> str:
    rows: list[tuple[Cell, ...]] = [
        (f"qp, {gait}", *speed.tick_ms.values(), *speed.cpu_ms.values()) for gait, speed in figures.qp.items()
    ]
    for name, tick in (("policy", figures.policy_tick_ms), ("ik", figures.ik_tick_ms)):
        rows.append((name, tick["p50"], tick["p99"], "", ""))
    episodes = [
        (name, episode.factor, episode.physics, *episode.period_ms.values(), f"{episode.share:.0%}")
        for name, episode in figures.episodes.items()
    ]
    unsolved = ", ".join(f"{gait} {speed.unsolved:.2%}" for gait, speed in figures.qp.items())
    return "\n".join(
        [
            _training(figures.training, figures.threads),
            "",
            format_table(("tick [ms]", "p50", "p99", "CPU p50", "CPU p99"), rows),
            f"unsolved QPs: {unsolved}",
            "",
            format_table(
                ("episode", "times real time", "times bare physics", "period p50 [ms]", "p99.9", "of the period"),
                episodes,
            ),
        ]
    )
