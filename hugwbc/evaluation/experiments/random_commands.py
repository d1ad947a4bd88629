"""All commands drawn at random over their full ranges at once: does the robot stay up, and what are the errors?

The paper studies pairs of commands; this experiment covers the whole space. In each episode, every command is drawn
independently and uniformly from its finishing range. A controller may follow each command alone and not their
combinations. Episodes with a fall are left out of the errors and counted.

With `changing`, the gait also changes every few seconds, and the commands jump or ramp; only falls are counted then.
"""

import numpy as np
import polars as pl

from hugwbc.commands import COMMAND_NAMES, Command, default_command, sample_all
from hugwbc.controller import Controller
from hugwbc.errors import ConfigError
from hugwbc.evaluation import metrics
from hugwbc.evaluation.episode import CountedSettings, Row, ending, simulate
from hugwbc.evaluation.experiment import Experiment, Section
from hugwbc.evaluation.experiments.single_command import episode_error, sampled_commands
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import bootstrap_mean, known
from hugwbc.evaluation.paper import ERROR_UNITS, error_name
from hugwbc.evaluation.plans import Knot, Plan, Schedule
from hugwbc.gait import Gait
from hugwbc.robot import Robot
from hugwbc.settings import Count, settings

SEGMENT = (1.0, 5.0)  # [s], shortest and longest time between two changes


@settings(kw_only=True)
class RandomCommandsSettings(CountedSettings):
    """Settings of random-commands."""

    episodes: Count = 64  # number of episodes in all
    changing: bool = False  # change to any gait and other commands every 1 to 5 s, at once or with a ramp

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.changing and self.gait != Gait.WALKING.label:
            raise ConfigError("changing draws every gait; leave --gait out")
        if self.changing and self.settle != metrics.SETTLE_S:
            raise ConfigError("changing counts falls only, from the start on; leave --settle out")


def plan(settings: RandomCommandsSettings) -> list[Plan]:
    """Return an episode for each drawn command, or for each drawn schedule of `changing`."""
    robot = settings.robot
    if settings.changing:
        draws = [(draw, np.random.default_rng((settings.seed, draw))) for draw in range(settings.episodes)]
        return [Plan(draw, random_schedule(rng, settings.duration, robot)) for draw, rng in draws]
    values = sample_all(settings.gaits[0], np.random.default_rng(settings.seed), settings.episodes, robot)
    return [Plan(draw, Command.from_array(row, settings.gaits[draw % 2])) for draw, row in enumerate(values)]


def random_schedule(rng: np.random.Generator, duration: float, robot: Robot) -> Schedule:
    """Draw gaits, times, ramps and commands; a random share of each segment's commands departs from the defaults."""
    knots, time = [], 0.0
    while time < duration:
        gait = Gait(rng.integers(len(Gait)))
        varied = rng.uniform(size=len(COMMAND_NAMES)) < rng.uniform()
        values = np.where(varied, sample_all(gait, rng, 1, robot)[0], default_command(gait, robot).array())
        ramp = rng.choice([0.0, rng.uniform(0.0, SEGMENT[0])]) if knots else 0.0
        knots.append(Knot(time, Command.from_array(values, gait), float(ramp)))
        time += rng.uniform(*SEGMENT)
    return Schedule(tuple(knots))


def episode(controller: Controller, settings: RandomCommandsSettings, plan: Plan) -> Row:
    """Return the drawn commands, and their errors, None after a fall; with `changing`, the last gait and the ending."""
    trace, command = simulate(controller, settings, plan), plan.command
    if settings.changing:
        return {"gait": Gait(int(trace.gait[-1])).label, **ending(trace)}
    errors = metrics.tracking_errors(trace, settings.settle)
    feet = [name for name in ("f", "l") if name in sampled_commands(command.gait, settings.robot)]
    errors |= {name: episode_error(trace, name, settings.settle) for name in feet}
    return {
        "gait": command.gait.label,
        **dict(zip(COMMAND_NAMES, command.array().tolist(), strict=True)),
        **{f"error_{name}": None if trace.down else known(error) for name, error in errors.items()},
        **ending(trace),
    }


def figures(settings: RandomCommandsSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return the errors of the episodes without a fall, and the falls."""
    if settings.changing:
        return [falls_figure("Changing gaits and commands", rows["fell"])]
    table, found = f"All commands at once, {settings.gait}", []
    errors: dict[str, list[float | None]] = {name: [] for name in ERROR_UNITS}
    for row in rows.filter(~pl.col("fell")).iter_rows(named=True):
        for name in sampled_commands(Gait.parse(row["gait"]), settings.robot):
            errors[error_name(name, row[name])].append(row[f"error_{name}"])
    for name, values in errors.items():
        if values:
            found.append(Figure(table, name, ERROR_UNITS[name], bootstrap_mean(values)))
    return [*found, falls_figure(table, rows["fell"])]


EXPERIMENT = Experiment(
    "random-commands",
    "draw all commands at random at once: errors and falls",
    RandomCommandsSettings,
    plan,
    episode,
    figures,
    section=Section(
        "All commands at once",
        "All commands are drawn at random over their ranges. Errors are those of the episodes without a fall.",
        quick=lambda: [
            RandomCommandsSettings(gait=gait, episodes=count, duration=5.0)
            for gait, count in {"standing": 6, "walking": 16}.items()
        ],
        full=lambda: [
            RandomCommandsSettings(gait=gait, episodes=256, duration=21.0)
            for gait in ("standing", "walking", "jumping", "hopping")
        ],
    ),
)
