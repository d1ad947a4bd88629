"""`hugwbc evaluate`: one of the protocols, for any controller, on level or rough ground, arms free or moved."""

import dataclasses
import pathlib
from collections.abc import Sequence

from hugwbc.cli.output import check_writable, format_table, parse, progress, say, write_json
from hugwbc.errors import UnknownNameError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.controllers import ControllerSpec
from hugwbc.evaluation.paper import ERROR_UNITS
from hugwbc.evaluation.protocols import (
    PROTOCOL_NAMES,
    HandsConfig,
    HandsResult,
    RandomCommandsConfig,
    RandomCommandsResult,
    SingleCommandConfig,
    SingleCommandResult,
    SmallVelocitiesConfig,
    SmallVelocitiesResult,
    run_hands,
    run_random_commands,
    run_single_command,
    run_small_velocities,
)
from hugwbc.evaluation.protocols.random_commands import PARTS, Combination
from hugwbc.gait import Gait

LISTED_PAIRS = 10


@dataclasses.dataclass(frozen=True)
class EvaluateOptions:
    """Run a protocol and print the errors beside the paper's figures, or where the robot falls."""

    controller: str = "learned"
    """learned, qp, hold (the baseline that only holds its pose), a plug-in's name, or the path of a policy or
    of a contract for somebody else's (docs/evaluation.md)."""
    policy: str | None = None
    """Name of a shipped policy or path of a policy, for the learned controller; of a network, for somebody else's."""
    gait: str = "walking"
    """standing, walking, jumping, hopping_left, hopping_right, or hopping: left and right leg in turn."""
    protocol: str = "single-command"
    """single-command: each command sampled over its range, the others at default. random-commands: all commands drawn
    at random over their full ranges at once; falls, and the combinations with which they happen. small-velocities: v_x
    or v_y of 0.1 to 0.3 m/s alone; which part of it is executed. hands: both hands go from one reachable target to the
    next; how near they come."""
    v_x: float = 0.5
    """Forward velocity in the hands protocol, for gaits that move [m/s]."""
    intervention: str = "none"
    """What moves the arms in every episode: none, noise (uniform targets every 1.8 s) or motion (motion files)."""
    motions: pathlib.Path | None = None
    """Folder of motion files (.npz) for --intervention motion; without one, generated motions."""
    terrain_roughness: float = 0.0
    """Half-width of the random height of the ground [m], such as 0.02; 0 for a plane."""
    slope: float = 0.0
    """Angle at which the ground rises along the robot's first heading [rad], such as 0.087."""
    episodes: int = 32
    """Episodes in all; the single-command protocol splits them evenly over the commands."""
    seed: int = 0
    """Of the sampled commands, the ground and the arms."""
    duration: float = 10.0
    """Length of an episode [s]."""
    settle: float | None = None
    """Start of an episode that is left out of the errors [s]; by default 1, and 2 in the hands protocol."""
    timestep: float = 0.002
    """Of the physics [s]; 0.005, the training's, is faster and enough for the learned controller."""
    noise: bool = False
    """Give the sensors a real robot's noise and latency, and estimate the state from them."""
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
    settings = {
        "gait": Gait.HOPPING_LEFT if both_legs else Gait.parse(options.gait),
        "both_legs": both_legs,
        "episodes": options.episodes,
        "seed": options.seed,
        "duration": options.duration,
        "settle": 1.0 if options.settle is None else options.settle,
        "workers": options.workers,
        "conditions": Conditions(
            timestep=options.timestep,
            terrain_roughness=options.terrain_roughness,
            slope=options.slope,
            noise=options.noise,
            intervention=options.intervention,
            motions=None if options.motions is None else str(options.motions),
        ),
    }
    spec = ControllerSpec(options.controller, options.policy)
    if options.protocol == "hands":
        return _run_hands(options, spec, settings["conditions"])
    done = 0
    with progress(f"{options.controller}, {options.gait}: {options.episodes} episodes") as advance:

        def on_episode(_: object) -> None:
            nonlocal done
            done += 1
            advance(done / options.episodes)

        if options.protocol == "single-command":
            result = run_single_command(spec.build, SingleCommandConfig(**settings), on_episode)
            text = describe(result)
        elif options.protocol == "small-velocities":
            result = run_small_velocities(spec.build, SmallVelocitiesConfig(**settings), on_episode)
            text = describe_small(result)
        else:
            result = run_random_commands(spec.build, RandomCommandsConfig(**settings), on_episode)
            text = describe_random(result)
    say(text, options.json)
    write_json(options.json, dataclasses.asdict(result))
    return 0


def _run_hands(options: EvaluateOptions, spec: ControllerSpec, conditions: Conditions) -> int:
    config = HandsConfig(
        gait=Gait.parse(options.gait),
        v_x=options.v_x,
        episodes=options.episodes,
        seed=options.seed,
        duration=options.duration,
        settle=2.0 if options.settle is None else options.settle,
        conditions=conditions,
    )
    with progress(f"{options.controller}, {options.gait}: {options.episodes} episodes") as advance:
        result = run_hands(spec.build, config, advance)
    say(describe_hands(result), options.json)
    write_json(options.json, dataclasses.asdict(result))
    return 0


def describe_hands(result: HandsResult) -> str:
    """Hand errors, joint error, saturation and jitter, and the falls."""
    errors = {part: result.hand_error_m[part] for part in ("mean", "p95", "left", "right")}
    rows: list[tuple[object, ...]] = [
        (f"hand error {part} [cm]", None if error is None else 100.0 * error) for part, error in errors.items()
    ]
    rows += [
        ("targets reached by the IK", result.hand_error_m["reachable_fraction"]),
        ("arm joints' error [rad]", result.joint_error_rad),
        ("control steps with an arm joint at its torque limit", result.saturated_ticks),
        ("jitter [rad^2/s^6]", result.jitter),
    ]
    falls = f"falls: {result.fell} of {result.episodes} episodes"
    return format_table((result.gait, result.controller), rows) + f"\n\n{falls}"


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
    if result.arm_error is not None:
        lines.append(f"arm joints: {result.arm_error:.3f} rad from their external targets on average")
    return "\n".join(lines + _failures(sum(row.failures for row in result.rows)))


def describe_random(result: RandomCommandsResult) -> str:
    """Falls in all, falls by the third of each command's range, and the pairs of thirds with the most falls."""
    lines = [f"falls: {result.falls} of {result.episodes} episodes ({100 * result.fall_rate:.1f} %)"]
    if result.falls:
        counts = _falls_by_third(result)
        rows = [(name, *(counts[name].get(part) for part in PARTS)) for name in counts]
        lines += ["", format_table(("falls of episodes", *(f"{part} third" for part in PARTS)), rows)]
        pairs = [c for c in result.combinations if len(c.parts) == 2][:LISTED_PAIRS]
        rows = [(_label(c), f"{c.falls} of {c.episodes}") for c in pairs]
        lines += ["", format_table(("pairs with the most falls", "falls"), rows)]
    return "\n".join(lines + _failures(sum(row.failures for row in result.rows)))


def describe_small(result: SmallVelocitiesResult) -> str:
    """The executed part of small velocities by direction, and the falls."""
    rows = [(name, part) for name, part in result.executed.items()]
    table = format_table(("0.1 to 0.3 m/s", "executed part"), rows)
    falls = f"falls: {result.falls} of {result.episodes} episodes"
    return "\n".join([table, "", falls, *_failures(sum(row.failures for row in result.rows))])


def _falls_by_third(result: RandomCommandsResult) -> dict[str, dict[str, str]]:
    counts: dict[str, dict[str, str]] = {}
    for combination in result.combinations:
        if len(combination.parts) == 1:
            ((name, part),) = combination.parts.items()
            counts.setdefault(name, {})[part] = f"{combination.falls} of {combination.episodes}"
    return dict(sorted(counts.items(), key=lambda item: list(result.rows[0].command).index(item[0])))


def _label(combination: Combination) -> str:
    return ", ".join(f"{name} {part}" for name, part in combination.parts.items())


def _failures(count: int) -> list[str]:
    return [f"the controller raised {count} exceptions, which the safety filter caught"] if count else []
