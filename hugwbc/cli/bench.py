"""`hugwbc bench`: speed of training, controllers and IK."""

import dataclasses
import pathlib
from collections.abc import Sequence
from typing import TYPE_CHECKING

from hugwbc.cli.output import check_writable, format_table, parse, progress, say, write_json
from hugwbc.errors import ConfigError

if TYPE_CHECKING:
    from hugwbc.evaluation.benchmark import EnvironmentSpeed, TrainingSpeed


@dataclasses.dataclass(frozen=True)
class BenchOptions:
    """Measure training and its environment beside bare physics, a tick of each controller, and one of the hand IK."""

    count: int = 1024
    """Robots in training."""
    control_steps: int = 50
    """Steps of the training environment to measure."""
    iterations: int = 2
    """Training iterations to measure, of 24 control steps and one update each."""
    threads: int = 1
    """Of training, its environment and bare physics; controllers and IK use one."""
    seconds: float = 4.0
    """Simulated walking time over which the QP is measured [s]."""
    calls: int = 500
    """Calls of the policy and of the IK to measure."""
    json: pathlib.Path | None = None
    """Write the figures to this file; without a path, to standard output."""


def run(words: Sequence[str]) -> int:
    """Parse, measure, print, write."""
    options = parse(BenchOptions, words, "bench", BenchOptions.__doc__)
    check_writable(options.json)
    for name in ("count", "control_steps", "iterations", "threads", "seconds", "calls"):
        if not getattr(options, name) > 0:
            raise ConfigError(f"{name} is {getattr(options, name)}; give a value above 0")
    from hugwbc.evaluation import benchmark
    from hugwbc.learned.contract import policy_contract
    from hugwbc.learned.networks import Actor
    from hugwbc.learned.policy import LearnedController
    from hugwbc.mbc import WholeBodyController

    with progress("benchmark") as advance:
        environment = benchmark.environment_speed(options.count, options.control_steps, threads=options.threads)
        advance(0.4)
        bare = environment.bare_steps_per_s
        training = benchmark.training_speed(bare, options.count, options.iterations, options.threads)
        advance(0.8)
        ticks = {"qp_tick_ms": benchmark.controller_tick(WholeBodyController(), options.seconds)}
        advance(0.9)
        # The time of a call does not depend on the weights: a fresh network will do.
        ticks["policy_tick_ms"] = benchmark.policy_tick(LearnedController(Actor(), policy_contract()), options.calls)
        ticks["ik_tick_ms"] = benchmark.ik_tick(options.calls)
    say(_describe(environment, training, ticks, options.threads), options.json)
    speeds = {"environment": dataclasses.asdict(environment), "training": dataclasses.asdict(training)}
    write_json(options.json, {**speeds, **ticks, "threads": options.threads})
    return 0


def _describe(
    environment: "EnvironmentSpeed", training: "TrainingSpeed", ticks: dict[str, dict[str, float]], threads: int
) -> str:
    rows = [(name.removesuffix("_tick_ms"), tick["p50"], tick["p99"]) for name, tick in ticks.items()]
    return "\n".join(
        [
            f"{environment.count} robots, {threads} thread(s), control steps per second of one robot:",
            f"bare mujoco.batch     {environment.bare_steps_per_s:6.0f}",
            f"training environment  {environment.steps_per_s:6.0f}, {environment.ratio:.2f} of bare",
            f"training end to end   {training.steps_per_s:6.0f}, {training.ratio:.2f} of bare; "
            f"{training.collect_fraction:.0%} of the time collecting, the rest learning",
            "",
            format_table(("tick [ms]", "p50", "p99"), rows),
        ]
    )
