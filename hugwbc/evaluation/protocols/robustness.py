"""How much a robot may differ from its description: one thing at a time, over a grid of values.

Payload, friction, sensor latency, joint gains, motor strength, roughness and slope of the ground. All values have the
same sampled single commands as the unchanged robot, so that the ratio of their errors is what the difference costs.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

from hugwbc.errors import ConfigError
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.paper import ERROR_NAMES
from hugwbc.evaluation.protocols.episodes import (
    ControllerFactory,
    GaitSettings,
    ProtocolResult,
    Run,
    mean,
    run_episodes,
)
from hugwbc.evaluation.protocols.single_command import Episode, judged, sampled_commands, stratified_samples

NOMINAL = "nominal"
# Fields of Conditions, and the values that each goes through.
GRID: Mapping[str, tuple[float, ...]] = {
    "payload": (-2.0, 5.0, 10.0, 15.0),  # [kg]
    "friction": (0.2, 0.4, 0.6, 1.2),
    "latency": (0.005, 0.01, 0.02, 0.04),  # [s]
    "gain": (0.8, 0.9, 1.1, 1.2),
    "strength": (0.7, 0.8, 0.9, 1.1),
    "terrain_roughness": (0.01, 0.02, 0.03),  # [m]
    "slope": (-0.087, 0.087),  # [rad], 5 degrees down and up
}
GRID_UNITS = {"payload": "kg", "latency": "s", "terrain_roughness": "m", "slope": "rad"}


@dataclasses.dataclass(frozen=True)
class RobustnessConfig(GaitSettings):
    """Settings of the protocol, beside those of any of one gait.

    Attributes:
        samples: episodes of each value, split evenly over the commands of the gait.
    """

    samples: int = 8

    def __post_init__(self) -> None:
        super().__post_init__()
        least = len(sampled_commands(self.gait))
        if self.samples < least:
            raise ConfigError(f"samples is {self.samples}; the {self.gait.label} gait needs at least {least}")
        for slope in GRID["slope"]:
            dataclasses.replace(self.conditions, slope=slope).check_duration(self.duration)

    @property
    def episodes(self) -> int:
        """In all, those of the unchanged robot included."""
        return self.samples * (1 + sum(len(values) for values in GRID.values()))


@dataclasses.dataclass(frozen=True)
class RobustnessEpisode(Episode):
    """One episode.

    Attributes:
        factor: what differs, a key of `GRID`, or "nominal".
        level: its value; 0 for "nominal".
    """

    factor: str
    level: float


@dataclasses.dataclass(frozen=True)
class RobustnessLevel:
    """One value of one factor.

    Attributes:
        factor: what differs, a key of `GRID`, or "nominal".
        level: its value; 0 for "nominal".
        falls: in how many episodes the robot fell.
        episodes: how many.
        errors: mean of the episodes' errors by the paper's names, those with a fall left out.
        ratio: mean over the errors of the error over the unchanged robot's on the same commands, of those that neither
            fell in; None if there is none.
    """

    factor: str
    level: float
    falls: int
    episodes: int
    errors: dict[str, float | None]
    ratio: float | None


@dataclasses.dataclass(frozen=True, kw_only=True)
class RobustnessResult(ProtocolResult[RobustnessEpisode]):
    """Outcome of the protocol, beside what any has.

    Attributes:
        samples: episodes of each value.
        levels: the unchanged robot first.
    """

    samples: int
    levels: tuple[RobustnessLevel, ...]


def grid_levels() -> list[tuple[str, float]]:
    """Factor and value of all cells, the unchanged robot first."""
    return [(NOMINAL, 0.0), *((factor, value) for factor, values in GRID.items() for value in values)]


def run_robustness(
    factory: ControllerFactory,
    config: RobustnessConfig,
    on_episode: Callable[[RobustnessEpisode], None] | None = None,
) -> RobustnessResult:
    """Run the protocol.

    Args:
        factory: makes the controller; with more than one worker it must be picklable.
        config: settings.
        on_episode: called with every finished episode, in order.
    """
    samples = stratified_samples(config, config.samples)
    plans = []
    for name, value in grid_levels():
        change = {} if name == NOMINAL else {name: value}
        conditions = dataclasses.replace(config.conditions, **change)
        label = f"{name} {value!r}"
        plans += [
            EpisodePlan(command, conditions=conditions, draw=draw, label=f"{label} {sampled}")
            for draw, (sampled, command) in enumerate(samples)
        ]
    rows = run_episodes(factory, plans, RobustnessJudge(config.settle), config, on_episode)
    parts = [rows[start : start + config.samples] for start in range(0, len(rows), config.samples)]
    return RobustnessResult.of(
        factory,
        config,
        rows,
        samples=config.samples,
        levels=tuple(robustness_level(part, parts[0]) for part in parts),
    )


def robustness_level(rows: Sequence[RobustnessEpisode], nominal: Sequence[RobustnessEpisode]) -> RobustnessLevel:
    """The summary of one value's episodes.

    Args:
        rows: its episodes.
        nominal: those of the unchanged robot, with the same commands in the same order.
    """
    upright = [(row, base) for row, base in zip(rows, nominal, strict=True) if not (row.fell or base.fell)]

    def error(name: str, part: int) -> float | None:
        return mean(pair[part].error for pair in upright if pair[0].error_name == name)

    both = {name: (error(name, 0), error(name, 1)) for name in ERROR_NAMES}
    return RobustnessLevel(
        factor=rows[0].factor,
        level=rows[0].level,
        falls=sum(row.fell for row in rows),
        episodes=len(rows),
        errors={
            name: mean(row.error for row in rows if row.error_name == name and not row.fell) for name in ERROR_NAMES
        },
        ratio=mean(own / base for own, base in both.values() if own is not None and base),
    )


@dataclasses.dataclass(frozen=True)
class RobustnessJudge:
    """Reads factor, value and sampled command from the plan's label, as `run_robustness` writes it.

    Attributes:
        settle: start of the episode that is left out [s].
    """

    settle: float

    def __call__(self, index: int, run: Run) -> RobustnessEpisode:
        """The row of one episode."""
        factor, level, name = run.plan.label.split()
        row = judged(run, name, self.settle)
        return RobustnessEpisode(**dataclasses.asdict(row), factor=factor, level=float(level))
