"""What `hugwbc evaluate` prints of each protocol's result."""

from hugwbc.evaluation.intervals import wilson_percentage
from hugwbc.evaluation.paper import ERROR_UNITS
from hugwbc.evaluation.protocols import (
    ContactsResult,
    DisturbanceResult,
    EffortResult,
    FootDisplacementResult,
    HandsResult,
    HeatmapResult,
    InterventionResult,
    RampResult,
    RandomCommandsResult,
    RobustnessResult,
    SingleCommandResult,
    SmallVelocitiesResult,
    TourResult,
)
from hugwbc.evaluation.protocols.random_commands import PARTS, Combination
from hugwbc.evaluation.protocols.robustness import GRID_UNITS, NOMINAL
from hugwbc.evaluation.protocols.tour import blow_outcomes
from hugwbc.evaluation.tables import format_table, hand_rows

LISTED_PAIRS = 10


def describe_contacts(result: ContactsResult) -> str:
    """In what part of the time contacts and clock agree, and how long each foot is on the ground."""
    rows: list[tuple[object, ...]] = []
    for index, row in enumerate(result.rows):
        stance = [sum(foot) / len(foot) if foot else None for foot in (row.left, row.right)]
        rows.append((f"episode {index + 1}", row.agreement, *stance))
    header = (f"{result.gait}, part of the time", "contacts as the clock", "left on the ground", "right on the ground")
    falls = f"falls: {result.falls} of {result.episodes} episodes"
    return "\n".join([format_table(header, rows), "", falls, *_failures(sum(row.failures for row in result.rows))])


def describe_hands(result: HandsResult) -> str:
    """Hand errors, joint error, saturation and jitter, and the falls."""
    rows = [
        *hand_rows([result.hand_error_m]),
        ("arm joints' error [rad]", result.joint_error_rad),
        ("control steps with an arm joint at its torque limit", result.saturated_ticks),
        ("jitter [rad^2/s^6]", result.jitter),
    ]
    falls = f"falls: {result.fell} of {result.episodes} episodes"
    return format_table((result.gait, result.controller), rows) + f"\n\n{falls}"


def describe_single(result: SingleCommandResult) -> str:
    """The result as a table beside the paper's figures, and the falls."""
    rows = []
    for name, unit in ERROR_UNITS.items():
        error, paper = result.errors[name], result.paper.get(name)
        if error is None and paper is None:
            continue
        ratio = error / paper if error is not None and paper is not None else None
        rows.append((name, unit, _four(error), paper, ratio))
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


def describe_intervention(result: InterventionResult) -> str:
    """For each intervention the errors beside the paper's, and the falls."""
    parts = []
    for kind, errors in result.errors.items():
        rows = [_beside(name, error, result.paper[kind].get(name)) for name, error in errors.items()]
        header = (f"arms: {kind}", result.controller, f"paper ({result.training})", "ratio")
        parts.append(format_table(header, rows) + f"\n\nfalls: {result.falls[kind]} of {result.episodes} episodes")
        if result.arm_error[kind] is not None:
            parts[-1] += f"; arm joints {result.arm_error[kind]:.3f} rad from their targets on average"
    return "\n\n".join(["\n\n".join(parts), *_failures(sum(row.failures for row in result.rows))])


def describe_foot_displacement(result: FootDisplacementResult) -> str:
    """Length of the feet's paths by intervention and command, beside the paper's, and the falls."""
    rows = [
        (*_beside(f"{kind}, {name}", length, result.paper[kind].get(name)), _four(result.creep[kind][name]))
        for kind, lengths in result.displacement.items()
        for name, length in lengths.items()
    ]
    header = ("foot displacement [m]", result.controller, f"paper ({result.training})", "ratio", "of it creep")
    falls = ", ".join(f"{kind} {count} of {result.episodes}" for kind, count in result.falls.items())
    seconds = result.duration - result.settle
    lines = [format_table(header, rows), "", f"in {seconds:g} s; falls: {falls} episodes, left out above"]
    return "\n".join(lines + _failures(sum(row.failures for row in result.rows)))


def describe_ramp(result: RampResult) -> str:
    """Errors during the ramps beside the paper's on the real robot, and the falls."""
    rows = [_beside(name, error, result.paper.get(name)) for name, error in result.errors.items()]
    table = format_table((f"{result.gait}, ramp [rad]", result.controller, "paper (real robot)", "ratio"), rows)
    falls = ", ".join(f"{name} {count} of {result.episodes}" for name, count in result.falls.items())
    return f"{table}\n\nfalls: {falls} runs"


def describe_disturbance(result: DisturbanceResult) -> str:
    """The tolerated force by direction and kind."""
    names = {"0": "0 deg, forward", "90": "90 deg, left", "180": "180 deg, backward", "270": "270 deg, right"}
    constant, second = result.tolerated["constant"], result.tolerated["second"]
    rows = [(names.get(d, f"{d} deg"), f"{force:.0f}", f"{second[d]:.0f}") for d, force in constant.items()]
    table = format_table((f"{result.gait}, {result.controller}", "constant [N]", "one second [N]"), rows)
    end = f"largest forces with at least 98 % survival of {result.rollouts} rollouts; {result.episodes} rollouts in all"
    limit = " (the limit of the search was survived somewhere)"
    unbounded = any(force is None for forces in result.refused.values() for force in forces.values())
    return f"{table}\n\n{end}{limit if unbounded else ''}"


def describe_heatmap(result: HeatmapResult) -> str:
    """For every pair of commands the range in which the one leaves the other alone."""
    names = list(result.values)
    share = {(entry.tracked, entry.against): entry for entry in result.orthogonality}
    rows = []
    for tracked in names:
        cells = [share.get((tracked, against)) for against in names]
        rows.append((tracked, result.single[tracked], *("" if c is None else _range(c.low, c.high) for c in cells)))
    table = format_table((f"{result.gait}, error of", "alone", *(f"over {name}" for name in names)), rows)
    about = (
        "Ranges of the column's command about its default in which the row's error stays within 1.5 times its error "
        "alone; -: none."
    )
    falls = f"falls: {result.falls} of {result.episodes} episodes, {result.points} values of each command"
    return "\n".join([table, "", about, falls, *_failures(sum(row.failures for row in result.rows))])


def describe_robustness(result: RobustnessResult) -> str:
    """Falls and errors with each value of each factor, against those of the unchanged robot."""
    rows = []
    for level in result.levels:
        value = "" if level.factor == NOMINAL else f" {level.level:g} {GRID_UNITS.get(level.factor, '')}".rstrip()
        name = level.factor.replace("terrain_roughness", "roughness")
        rows.append((f"{name}{value}", f"{level.falls} of {level.episodes}", level.ratio))
    table = format_table((f"{result.gait}, {result.controller}", "falls", "errors over nominal"), rows)
    return "\n".join([table, *_failures(sum(row.failures for row in result.rows))])


def describe_effort(result: EffortResult) -> str:
    """Power, cost of transport, use of the limits, roughness and times, by commanded speed."""
    columns = {
        "executed [m/s]": "speed",
        "power [W]": "power",
        "cost of transport": "cost_of_transport",
        "torque, rms of limit": "torque_rms",
        "torque, peak": "torque_peak",
        "joint speed, rms of limit": "joint_speed_rms",
        "joint speed, peak": "joint_speed_peak",
        "torque rate, rms [N*m/s]": "torque_rate",
        "target jerk [rad^2/s^6]": "target_jerk",
        "tick, median [ms]": "tick_p50_ms",
        "tick, p99 [ms]": "tick_p99_ms",
        "fell": "fell",
    }
    header = (f"{result.gait}, {result.controller}", *(f"{row.v_x:g} m/s" for row in result.rows))
    table = format_table(
        header, [(label, *(_figures(getattr(row, field)) for row in result.rows)) for label, field in columns.items()]
    )
    return f"{table}\n\n{result.mass:.1f} kg; use of the joint that uses most of its limit; times of this machine"


def describe_tour(result: TourResult) -> str:
    """Completion, blows and errors at the waypoints."""
    blows = [up for row in result.rows for up in blow_outcomes(row.blows, row.felled)]
    rows = [
        ("tours completed [%]", _share([not row.fell for row in result.rows])),
        (f"of {result.blows} blows survived [%]", _share(blows)),
        ("waypoints reached [%]", f"{100.0 * result.reached:.0f}"),
        ("position error [m]", result.position_error),
        ("yaw error [rad]", result.yaw_error),
        ("survived [s]", f"{result.survived_s:.1f} of {result.duration:g}"),
    ]
    table = format_table((f"{result.gait}, {result.episodes} tours", result.controller), rows)
    blow = f"blows of up to {result.strongest_blow:.0f} N for 0.08 s: those on a G1, scaled by mass"
    blow += "; in brackets the 95 % score interval"
    return "\n".join([table, "", blow, *_failures(sum(row.failures for row in result.rows))])


def _share(happened: list[bool]) -> str | None:
    """In what part of some cases something happened [%], with its interval."""
    share = wilson_percentage(happened)
    return None if share.value is None else f"{share.value:.0f} [{share.low:.0f}, {share.high:.0f}]"


def _figures(value: float | bool | None) -> object:
    """A number with three figures, whatever its size."""
    return value if value is None or isinstance(value, bool) else f"{value:#.3g}".rstrip(".")


def _range(low: float | None, high: float | None) -> str | None:
    return None if low is None or high is None else f"{low:g} to {high:g}"


def _beside(name: str, value: float | None, paper: float | None) -> tuple[object, ...]:
    ratio = value / paper if value is not None and paper else None
    return name, _four(value), _four(paper), ratio


def _four(value: float | None) -> str | None:
    """Four decimals: the paper's three would print some of the figures as zero."""
    return None if value is None else f"{value:.4f}"


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
