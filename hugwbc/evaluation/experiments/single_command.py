"""The paper's table of single-command tracking errors.

Each command is sampled over its finishing range while the others stay at their defaults, one episode per sample. The
samples are stratified: the range of a command is cut into as many equal parts as it has episodes, and each part gets
one uniform sample, so that even few episodes cover the whole range.
"""

import dataclasses
import math

import numpy as np
import polars as pl

from hugwbc.commands import COMMAND_NAMES, Command, command_ranges
from hugwbc.controller import Controller
from hugwbc.errors import ConfigError
from hugwbc.evaluation import metrics
from hugwbc.evaluation.episode import MOVING, CountedSettings, Row, Settings, ending, simulate
from hugwbc.evaluation.experiment import Experiment, Section
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import bootstrap_mean, known
from hugwbc.evaluation.paper import ERROR_UNITS, TRAININGS, error_name, other_controllers, single_command_errors
from hugwbc.evaluation.plans import Plan
from hugwbc.gait import Gait
from hugwbc.robot import Robot
from hugwbc.runtime.trace import Trace
from hugwbc.settings import Count, settings

# Figures of `metrics.impact` that are shown, with their names and units.
IMPACTS = {
    "speed_median": ("touch-down speed, median", "m/s"),
    "peak_mean": ("peak foot force of 10 ms, mean of stances", "body weights"),
}
SLOW_SPEED = 0.6  # [m/s]; falls at commanded speeds up to this are counted separately


@settings(kw_only=True)
class SingleCommandSettings(CountedSettings):
    """Settings of single-command."""

    episodes: Count = 128  # number of episodes in all, split evenly over the commands: 16 for each of a walk's eight
    ends: bool = False  # draw each command at the two ends of its range, half of the times each, instead of inside

    def __post_init__(self) -> None:
        super().__post_init__()
        least = len(sampled_commands(self.gaits[0], self.robot))
        if self.episodes < least:
            raise ConfigError(
                f"episodes is {self.episodes}; give {least} or more: one per command of the {self.gait} gait"
            )
        legs = len(set(self.gaits))
        if self.ends and self.episodes % (cases := 2 * legs * least):
            each = f"both ends of {least} commands" + " on each leg" * (legs == 2)
            raise ConfigError(f"episodes is {self.episodes}; with ends, give a multiple of {cases}: {each}")


def sampled_commands(gait: Gait, robot: Robot) -> tuple[str, ...]:
    """Return a robot's commands whose range under a gait is more than one value; without foot commands for standing."""
    names = [name for name, limits in command_ranges(gait, robot).items() if limits.finishing[0] < limits.finishing[1]]
    return tuple(name for name in names if gait is not Gait.STANDING or name not in ("f", "l"))


def stratified_samples(settings: Settings, episodes: int, *, ends: bool = False) -> list[tuple[str, Command]]:
    """Return name and whole command of samples that are stratified over the commands' finishing ranges.

    The episodes are split evenly over the commands of the gait. With `ends` the two ends of each range, each half of
    the times, take the place of samples of its inside.
    """
    rng = np.random.default_rng(settings.seed)
    robot = settings.robot
    names = sampled_commands(settings.gaits[0], robot)
    share, rest = divmod(episodes, len(names))
    samples: list[tuple[str, Command]] = []
    for position, name in enumerate(names):
        count = share + (position < rest)
        low, high = command_ranges(settings.gaits[0], robot)[name].finishing
        # One uniform sample in each of `count` equal parts of the range.
        values = low + (high - low) * (np.arange(count) + rng.uniform(size=count)) / count
        if ends:  # they alternate, in hops every second time, so that each leg has both
            values = np.where(np.arange(count) // len(set(settings.gaits)) % 2 == 0, low, high)
        for index, value in enumerate(values):
            samples.append((name, dataclasses.replace(settings.default_command(index), **{name: float(value)})))
    return samples


def plan(settings: SingleCommandSettings) -> list[Plan]:
    """Return an episode for each stratified sample."""
    samples = stratified_samples(settings, settings.episodes, ends=settings.ends)
    return [Plan(draw, command, {"command": name}) for draw, (name, command) in enumerate(samples)]


def episode(controller: Controller, settings: Settings, plan: Plan) -> Row:
    """Return the error of the sampled command after the settling time, the impacts and the paths of the feet.

    - `error_name`, `error`: the paper's name of the error and its value; None if the robot fell too early.
    - `arm_error`: mean distance of the arm joints to their external targets [rad].
    - `foot_travel`, `foot_creep`: path of both feet, and the part of it that is MuJoCo's creep [m]; standing only.
    - `held_foot_contact`: part of the time in which the held leg touched the ground; hopping only.
    - `hop_frequency_error`: mean difference between hops per second and the clock's frequency [Hz]; hopping only.
    """
    arms = (plan.conditions or settings.conditions).arms((settings.seed, plan.draw))
    trace, settle = simulate(controller, settings, plan, upper_body=arms), settings.settle
    command, name = plan.command, str(plan.tags["command"])
    value = float(command.array()[COMMAND_NAMES.index(name)])
    travel, creep = metrics.foot_travel(trace, settle) if command.gait is Gait.STANDING else (math.nan, math.nan)
    impact = metrics.impact(trace, settle)
    return {
        "gait": command.gait.label,
        "value": value,
        "error_name": error_name(name, value),
        "error": known(episode_error(trace, name, settle)),
        "arm_error": None if arms is None else known(arms.error(trace, settle)),
        "foot_travel": known(travel),
        "foot_creep": known(creep),
        "held_foot_contact": known(metrics.held_foot_contact(trace, settle)),
        "hop_frequency_error": known(metrics.frequency_error(trace, settle)) if command.gait.hops else None,
        **{f"impact_{figure}": impact.get(figure) for figure in IMPACTS},
        **ending(trace),
    }


def episode_error(trace: Trace, command: str, settle: float) -> float:
    """Return the error of one command over a run; NaN if the run did not last beyond `settle` [s]."""
    if command == "f":
        return metrics.frequency_error(trace, settle)
    if command == "l":
        return metrics.swing_height_error(trace, settle)
    return metrics.tracking_errors(trace, settle)[command]


def figures(settings: SingleCommandSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return the errors by the paper's names, impacts, paths of the feet and falls, and what others published.

    Moved arms are compared with the paper's best policy, the one trained with noise.
    """
    table, found = f"Single command, {settings.gait}", []
    paper = single_command_errors(settings.gaits[0], settings.conditions.intervention)
    if "E_vx" in paper:  # at all speeds
        errors = rows.filter(pl.col("command") == "v_x")["error"]
        found.append(Figure(table, "E_vx", "m/s", bootstrap_mean(errors), paper["E_vx"]))
    for name, unit in ERROR_UNITS.items():
        errors = rows.filter(pl.col("error_name") == name)["error"]
        if len(errors) or name in paper:
            found.append(Figure(table, name, unit, bootstrap_mean(errors), paper.get(name)))
    for name, (quantity, unit) in IMPACTS.items():
        estimate = bootstrap_mean(rows[f"impact_{name}"])
        if estimate.value is not None:
            found.append(Figure(table, quantity, unit, estimate))
    found.append(falls_figure(table, rows["fell"]))
    if settings.gait in MOVING:
        slow = rows.filter(~pl.col("command").is_in(["v_x", "v_y"]) | (pl.col("value").abs() <= SLOW_SPEED))
        found.append(falls_figure(table, slow["fell"], quantity=f"falls at up to {SLOW_SPEED} m/s"))
    upright = rows.filter(~pl.col("fell"))
    for quantity, unit, values in (
        (f"path of both feet in {settings.duration - settings.settle:g} s", "m", upright["foot_travel"]),
        ("held foot on the ground", "part of the time", rows["held_foot_contact"]),
        ("hops per second, difference to the clock", "Hz", rows["hop_frequency_error"]),
        ("arm joints, distance to their external targets", "rad", rows["arm_error"]),
    ):
        if values.null_count() < len(values):
            found.append(Figure(table, quantity, unit, bootstrap_mean(values)))
    if settings.gait == Gait.WALKING.label:
        found += [
            Figure(table, error, ERROR_UNITS[error], None, controller=name, published=value)
            for name, errors in other_controllers().items()
            for error, value in errors.items()
        ]
    trained = "" if settings.conditions.intervention == "none" else TRAININGS["noise"]
    return [dataclasses.replace(figure, reference=trained) for figure in found]


EXPERIMENT = Experiment(
    "single-command",
    "sample each command over its range, the others at their defaults",
    SingleCommandSettings,
    plan,
    episode,
    figures,
    section=Section(
        "Single commands",
        "One command is sampled over its range while the others stay at their defaults. Foot commands (f, l) are "
        "judged over gait cycles, those included that a foot misses before its first and after its last step, the "
        "others over samples of 20 ms. The impact of a foot after a swing is the "
        "sole's vertical speed in the physics step before the touch-down, and the largest vertical force on the foot "
        "in the stance after it. The figures of HOVER and ExBody are the paper's; they were not run here.",
        quick=lambda: [
            SingleCommandSettings(gait=gait, episodes=count, duration=5.0)
            for gait, count in {"standing": 6, "walking": 16, "jumping": 16, "hopping": 8}.items()
        ],
        full=lambda: [  # 20 s after the settling time, as in the paper
            SingleCommandSettings(gait=gait, episodes=256, duration=21.0)
            for gait in ("standing", "walking", "jumping", "hopping")
        ],
    ),
)
