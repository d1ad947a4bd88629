"""`hugwbc bench`: measure the speed of training, controllers and hand IK."""

import dataclasses
import pathlib
from collections.abc import Sequence
from typing import TYPE_CHECKING

from hugwbc.benchmarks.suite import BenchFigures, BenchSettings, measure_training, run_benchmarks
from hugwbc.cli.output import check_writable, parse, progress, say, write_json
from hugwbc.evaluation.tables import Cell, format_table
from hugwbc.settings import settings

if TYPE_CHECKING:
    from hugwbc.benchmarks.speed import TrainingSpeed


@settings
class BenchOptions(BenchSettings):
    """Measure the speed of training, controllers and hand IK."""

    json: pathlib.Path | None = None  # Write the figures to this file; without a path, to standard output.
    training: bool = False  # Print only the speed of training and its parts.
    profile: bool = False  # Print only where the time of an episode goes, by part of the code, for both controllers.


def run(words: Sequence[str]) -> int:
    """Parse, measure, print, write."""
    options = parse(BenchOptions, words, "bench", BenchOptions.__doc__)
    check_writable(options.json)
    if options.profile:
        write_json(options.json, _profile(options))
        return 0
    if options.training:
        speeds = measure_training(options)
        say(_training(speeds, options.threads), options.json)
        write_json(options.json, [dataclasses.asdict(speed) for speed in speeds])
        return 0
    with progress("benchmark") as advance:
        figures = run_benchmarks(options, advance)
    say(_describe(figures), options.json)
    write_json(options.json, dataclasses.asdict(figures))
    return 0


def _profile(options: BenchOptions) -> dict[str, dict[str, float]]:
    """Profile an episode of each controller, and print the share of each room."""
    from hugwbc.benchmarks.speed import period_shares
    from hugwbc.runtime.controllers import load_controller

    shares = {name: period_shares(load_controller(name), options.seconds) for name in ("qp", "learned")}
    rooms = dict.fromkeys(room for found in shares.values() for room in found)
    rows = [(room, *(f"{found.get(room, 0.0):.0%}" for found in shares.values())) for room in rooms]
    say(format_table(("walking, share of the time", *shares), rows), options.json)
    return shares


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
