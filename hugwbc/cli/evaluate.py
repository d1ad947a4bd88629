"""`hugwbc evaluate`: one of the paper's protocols, for any controller."""

import dataclasses
import pathlib
from collections.abc import Sequence

from hugwbc.cli.output import check_writable, format_table, parse, progress, say, write_json
from hugwbc.errors import UnknownNameError
from hugwbc.evaluation.controllers import ControllerSpec
from hugwbc.evaluation.paper import ERROR_UNITS
from hugwbc.evaluation.protocols import PROTOCOL_NAMES, SingleCommandConfig, SingleCommandResult, run_single_command
from hugwbc.gait import Gait


@dataclasses.dataclass(frozen=True)
class EvaluateOptions:
    """Run a protocol of the paper and print the errors beside the paper's figures."""

    controller: str = "learned"
    """learned, qp, or hold (the baseline that only holds its pose)."""
    policy: str | None = None
    """Name of a shipped policy, or path of a policy file, for the learned controller."""
    gait: str = "walking"
    """standing, walking, jumping, hopping_left, hopping_right, or hopping: left and right leg in turn."""
    protocol: str = "single-command"
    """single-command: each command sampled over its range, the others at default."""
    episodes: int = 32
    """Episodes in all, split evenly over the commands."""
    seed: int = 0
    """Of the sampled commands."""
    duration: float = 10.0
    """Length of an episode [s]."""
    settle: float = 1.0
    """Start of an episode that is left out of the errors [s]."""
    timestep: float = 0.002
    """Of the physics [s]; 0.005, the training's, is faster and enough for the learned controller."""
    workers: int = 1
    """Processes that share the episodes."""
    json: pathlib.Path | None = None
    """Write the result to this file; without a path, to standard output."""


def run(words: Sequence[str]) -> int:
    """Parse, run, print, write."""
    options = parse(EvaluateOptions, words, "evaluate", EvaluateOptions.__doc__)
    check_writable(options.json)
    if options.protocol not in PROTOCOL_NAMES:
        raise UnknownNameError("protocol", options.protocol, PROTOCOL_NAMES)
    both_legs = options.gait == "hopping"
    config = SingleCommandConfig(
        gait=Gait.HOPPING_LEFT if both_legs else Gait.parse(options.gait),
        both_legs=both_legs,
        episodes=options.episodes,
        seed=options.seed,
        duration=options.duration,
        settle=options.settle,
        timestep=options.timestep,
        workers=options.workers,
    )
    spec = ControllerSpec(options.controller, options.policy)
    done = 0
    with progress(f"{options.controller}, {config.gait_label}: {config.episodes} episodes") as advance:

        def on_episode(_: object) -> None:
            nonlocal done
            done += 1
            advance(done / config.episodes)

        result = run_single_command(spec.build, config, on_episode)
    say(describe(result), options.json)
    write_json(options.json, dataclasses.asdict(result))
    return 0


def describe(result: SingleCommandResult) -> str:
    """The result as a table beside the paper's figures, and the falls."""
    rows = []
    for name, unit in ERROR_UNITS.items():
        error, paper = result.errors[name], result.paper.get(name)
        if error is None and paper is None:
            continue
        ratio = error / paper if error is not None and paper is not None else None
        # Four decimals: the paper's three would print some of the errors as zero.
        rows.append((name, unit, None if error is None else f"{error:.4f}", paper, ratio))
    lines = [format_table(("error", "unit", result.controller, "paper", "ratio"), rows), ""]
    lines.append(f"falls: {result.falls} of {result.episodes} episodes; ")
    lines[-1] += f"at |v| <= 0.6 m/s {result.falls_slow} of {result.episodes_slow}"
    if result.foot_travel is not None:
        seconds = result.duration - result.settle
        lines.append(f"foot travel: {result.foot_travel:.3f} m of both feet in {seconds:g} s")
    if result.held_foot_contact is not None:
        lines.append(f"held foot on the ground: {100 * result.held_foot_contact:.1f} % of the time")
    failures = sum(row.failures for row in result.rows)
    if failures:
        lines.append(f"the controller raised {failures} exceptions, which the safety filter caught")
    return "\n".join(lines)
