"""`hugwbc bench`: speed of training, controllers and IK."""

import dataclasses
import importlib.util
import pathlib
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from hugwbc.cli.output import check_writable, parse, progress, say, write_json
from hugwbc.errors import ConfigError
from hugwbc.evaluation.tables import format_table

if TYPE_CHECKING:
    from hugwbc.benchmarks.hand_ik import IKFigures
    from hugwbc.benchmarks.qp_side_by_side import SideBySide
    from hugwbc.benchmarks.speed import EnvironmentSpeed, QpSpeed, RolloutSpeed, TrainingSpeed


@dataclasses.dataclass(frozen=True)
class BenchOptions:
    """Measure training, controllers and hand IK; hand IK beside mink and pink; and what the hands can reach."""

    count: int = 1024
    """Robots in training."""
    control_steps: int = 50
    """Steps of the training environment to measure."""
    iterations: int = 2
    """Training iterations to measure, of 24 control steps and one update each."""
    threads: int = 1
    """Of training, its environment and bare physics; controllers and IK use one."""
    seconds: float = 4.0
    """Simulated time over which the QP is measured, standing, walking and jumping each [s]."""
    rollouts: int = 64
    """Robots in a batch of a policy's evaluation, which stand for two simulated seconds."""
    calls: int = 500
    """Calls of the policy and of the IK to measure."""
    ik_targets: int = 20
    """Targets that our IK, mink and pink visit side by side, 3 s each; mink and pink only where they are installed."""
    spacing: float = 0.25
    """Of the grid in a 2 m cube on which the reachable workspace is measured [m]."""
    side_by_side: int = 0
    """Solve this many random states with the whole-body QP, placo's dynamics solver and DAQP, and compare; 0 for none.
    Needs the development extras."""
    json: pathlib.Path | None = None
    """Write the figures to this file; without a path, to standard output."""


def run(words: Sequence[str]) -> int:
    """Parse, measure, print, write."""
    options = parse(BenchOptions, words, "bench", BenchOptions.__doc__)
    counts = ("count", "control_steps", "iterations", "threads", "rollouts", "calls", "ik_targets")
    for name in (*counts, "seconds", "spacing"):
        if not getattr(options, name) > 0:
            raise ConfigError(f"{name} is {getattr(options, name)}; give a value above 0")
    if options.ik_targets < 2:
        raise ConfigError(f"ik_targets is {options.ik_targets}; give 2 or more: within reach and out of it in turn")
    if options.side_by_side > 0 and not all(map(importlib.util.find_spec, ("qpsolvers", "daqp"))):
        raise ConfigError("--side-by-side needs qpsolvers and DAQP; install them with: pip install 'hugwbc[dev]'")
    from hugwbc.benchmarks import speed as benchmark
    from hugwbc.benchmarks.hand_ik import compare_solvers
    from hugwbc.learned.policy.policy import load_policy
    from hugwbc.upper_ik.workspace import check_spacing, measure_workspace

    check_spacing(options.spacing)
    check_writable(options.json)
    with progress("benchmark") as advance:
        environment = benchmark.environment_speed(options.count, options.control_steps, threads=options.threads)
        advance(0.1)
        bare = environment.bare_steps_per_s
        training = benchmark.training_speed(bare, options.count, options.iterations, options.threads)
        advance(0.2)
        qp = {gait: benchmark.qp_speed(command, options.seconds) for gait, command in benchmark.QP_COMMANDS.items()}
        advance(0.3)
        policy = load_policy()
        evaluation = [benchmark.rollout_speed(policy, options.rollouts, 2.0, step) for step in (0.002, 0.005)]
        ticks = {"policy_tick_ms": benchmark.policy_tick(policy, options.calls)}
        ticks["ik_tick_ms"] = benchmark.ik_tick(options.calls)
        solvers = compare_solvers(options.ik_targets, on_progress=lambda fraction: advance(0.3 + 0.4 * fraction))
        workspace = measure_workspace(options.spacing, on_progress=lambda fraction: advance(0.7 + 0.3 * fraction))
    say(_describe(environment, training, qp, ticks, options.threads), options.json)
    say("\n" + _describe_rollouts(evaluation), options.json)
    say("\n" + describe_solvers(solvers), options.json)
    say(
        f"\nreachable part of a 2 m cube ({workspace.points} points): {100 * workspace.arms:.1f} % with the arms, "
        f"{100 * workspace.whole_body:.1f} % with the whole body",
        options.json,
    )
    figures = {
        "environment": dataclasses.asdict(environment),
        "training": dataclasses.asdict(training),
        "qp": {gait: dataclasses.asdict(speed) for gait, speed in qp.items()},
        "evaluation": [dataclasses.asdict(speed) for speed in evaluation],
        **ticks,
        "ik": {name: dataclasses.asdict(solver) for name, solver in solvers.items()},
        "workspace": dataclasses.asdict(workspace),
        "threads": options.threads,
    }
    if options.side_by_side > 0:
        from hugwbc.benchmarks.qp_side_by_side import side_by_side

        comparison = side_by_side(options.side_by_side)
        figures["side_by_side"] = dataclasses.asdict(comparison)
        say(_describe_side_by_side(comparison), options.json)
    write_json(options.json, figures)
    return 0


def describe_solvers(solvers: Mapping[str, "IKFigures"]) -> str:
    """Inverse kinematics side by side."""
    rows: list[tuple[object, ...]] = [
        ("tick p50 [ms]", *(solver.tick_ms["p50"] for solver in solvers.values())),
        ("tick p99 [ms]", *(solver.tick_ms["p99"] for solver in solvers.values())),
        ("residual, reachable [cm]", *(100.0 * solver.residual_m for solver in solvers.values())),
        ("reached within 1 cm", *(solver.reached for solver in solvers.values())),
        ("excess, out of reach [cm]", *(100.0 * solver.excess_m for solver in solvers.values())),
        ("ticks beyond a limit", *(solver.limit_violations for solver in solvers.values())),
        ("jitter [rad^2/s^6]", *(f"{solver.jitter:.3g}" for solver in solvers.values())),
        ("exceptions", *(solver.exceptions for solver in solvers.values())),
    ]
    return format_table(("inverse kinematics", *solvers), rows)


def _describe(
    environment: "EnvironmentSpeed",
    training: "TrainingSpeed",
    qp: Mapping[str, "QpSpeed"],
    ticks: dict[str, dict[str, float | None]],
    threads: int,
) -> str:
    rows = [(f"qp, {gait}", *speed.tick_ms.values(), *speed.cpu_ms.values()) for gait, speed in qp.items()]
    rows += [(name.removesuffix("_tick_ms"), tick["p50"], tick["p99"], "", "") for name, tick in ticks.items()]
    unsolved = ", ".join(f"{gait} {speed.unsolved:.2%}" for gait, speed in qp.items())
    return "\n".join(
        [
            f"{environment.count} robots, {threads} thread(s), control steps per second of one robot:",
            f"bare mujoco.batch     {environment.bare_steps_per_s:6.0f}",
            f"training environment  {environment.steps_per_s:6.0f}, {environment.ratio:.2f} of bare",
            f"training end to end   {training.steps_per_s:6.0f}, {training.ratio:.2f} of bare; "
            f"{training.collect_fraction:.0%} of the time collecting, the rest learning",
            "",
            format_table(("tick [ms]", "p50", "p99", "CPU p50", "CPU p99"), rows),
            f"unsolved QPs: {unsolved}",
        ]
    )


def _describe_rollouts(evaluation: Sequence["RolloutSpeed"]) -> str:
    header = ("a policy's evaluation", "alone [ms]", f"one of {evaluation[0].count} [ms]", "ratio")
    rows = [(f"time step {1e3 * s.timestep:g} ms", s.single_ms, s.batched_ms, s.ratio) for s in evaluation]
    return format_table(header, rows) + "\nprocessor time for a simulated second of a robot"


def _describe_side_by_side(comparison: "SideBySide") -> str:
    differences = (
        f"{comparison.states} states, all solvers solved {comparison.solved}; largest differences: torque to placo "
        f"{comparison.torque_difference_placo:.1e}, acceleration to placo "
        f"{comparison.acceleration_difference_placo:.1e} (in {comparison.compared_with_placo} states), solution to "
        "DAQP "
        f"{comparison.solution_difference_other:.1e}, as shares of the largest component"
    )
    rows = [(name, time["p50"], time["p99"]) for name, time in comparison.time_ms.items()]
    return "\n".join(["", format_table(("solve [ms]", "p50", "p99"), rows), "", differences])
