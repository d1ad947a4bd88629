"""`hugwbc bench`: speed of the parts, single-threaded."""

import dataclasses
import pathlib
from collections.abc import Sequence

from hugwbc.cli.output import check_writable, format_table, parse, progress, say, write_json
from hugwbc.errors import ConfigError


@dataclasses.dataclass(frozen=True)
class BenchOptions:
    """Measure the training environment, a tick of each controller, and a tick of the hand IK, on one thread."""

    count: int = 256
    """Robots in the training environment."""
    control_steps: int = 100
    """Steps of the training environment to measure."""
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
    for name in ("count", "control_steps", "seconds", "calls"):
        if not getattr(options, name) > 0:
            raise ConfigError(f"{name} is {getattr(options, name)}; give a value above 0")
    from hugwbc.evaluation import benchmark
    from hugwbc.learned.contract import policy_contract
    from hugwbc.learned.networks import Actor
    from hugwbc.learned.policy import LearnedController
    from hugwbc.mbc import WholeBodyController

    with progress("benchmark") as advance:
        environment = benchmark.environment_speed(options.count, options.control_steps)
        advance(0.5)
        ticks = {"qp_tick_ms": benchmark.controller_tick(WholeBodyController(), options.seconds)}
        advance(0.9)
        # The time of a call does not depend on the weights: a fresh network will do.
        ticks["policy_tick_ms"] = benchmark.policy_tick(LearnedController(Actor(), policy_contract()), options.calls)
        ticks["ik_tick_ms"] = benchmark.ik_tick(options.calls)
    say(_describe(environment, ticks), options.json)
    write_json(options.json, {"environment": dataclasses.asdict(environment), **ticks, "threads": 1})
    return 0


def _describe(environment: object, ticks: dict[str, dict[str, float]]) -> str:
    from hugwbc.evaluation.benchmark import EnvironmentSpeed

    assert isinstance(environment, EnvironmentSpeed)
    rows = [(name.removesuffix("_tick_ms"), tick["p50"], tick["p99"]) for name, tick in ticks.items()]
    return "\n".join(
        [
            f"training environment, {environment.count} robots: {environment.steps_per_s:.0f} steps/s, "
            f"{environment.ratio:.2f} of bare mujoco.batch ({environment.bare_steps_per_s:.0f} steps/s)",
            "",
            format_table(("tick [ms]", "p50", "p99"), rows),
        ]
    )
