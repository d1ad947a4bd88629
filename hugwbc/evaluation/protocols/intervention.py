"""The paper's table of tracking errors while the arms are under external control: noise, motions, or nothing.

Every kind of intervention gets the same sampled commands, so that two of them differ in the arms alone. The paper's
ablation crosses what moves the arms in the test with what moved them in training, and prints policies of all
`TRAININGS`. A learned policy is compared with the paper's policy of the same training, and a controller that was not
trained with the paper's best one.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

from hugwbc.commands import COMMAND_NAMES, COMMAND_UNITS
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.evaluation.conditions import INTERVENTIONS
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import Estimate, bootstrap_mean
from hugwbc.evaluation.paper import TRAININGS, intervention_errors
from hugwbc.evaluation.protocols.episodes import CountedSettings, GaitSettings, GroupedResult, Run, SettledJudge, mean
from hugwbc.evaluation.protocols.protocol import (
    INTERVAL,
    INTERVAL_NOTE,
    Measured,
    PlannedProtocol,
    Result,
    beside_paper,
    count_text,
    failure_lines,
)
from hugwbc.evaluation.protocols.single_command import Episode, judged, sampled_commands, stratified_samples
from hugwbc.evaluation.tables import format_table
from hugwbc.gait import Gait

ERROR_OF = {name: f"E_{name.replace('_', '')}" for name in COMMAND_NAMES}  # the paper's names; v_x at all speeds
ARMS = {"noise": "arms moved by noise", "motion": "arms moved by motions", "none": "arms free"}
TRAINED = {"noise": "trained with noise", "motion": "trained with motions", "none": "trained without intervention"}
UNTRAINED_AGAINST = "noise"  # the training of the paper's policy that is compared with untrained controllers
_COMMAND = {error: name for name, error in ERROR_OF.items()}


@dataclasses.dataclass(frozen=True)
class InterventionConfig(CountedSettings):
    """Settings of the protocols that move the arms, in addition to `CountedSettings`.

    Attributes:
        episodes: number of episodes in all, split evenly over the interventions and the commands of the gait.
        training: training of the paper's policy to compare with: noise, motion or none; by default the one that the
            policy's own file names, and noise for other controllers.
    """

    episodes: int = 96
    training: str | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.training is not None and self.training not in TRAININGS:
            raise UnknownNameError("training", self.training, TRAININGS)
        if self.conditions.intervention != "none":
            raise ConfigError("this protocol runs every intervention; leave that of the conditions at none")

    @property
    def least(self) -> tuple[int, str]:
        """One episode for each command of the gait under each intervention."""
        commands = len(sampled_commands(self.gait))
        return len(INTERVENTIONS) * commands, f"{len(INTERVENTIONS)} interventions and {commands} commands"

    @property
    def samples(self) -> int:
        """Number of episodes of each intervention."""
        return self.episodes // len(INTERVENTIONS)

    @property
    def papers_training(self) -> str:
        """Training of the paper's policy to compare with."""
        return self.training or UNTRAINED_AGAINST


@dataclasses.dataclass(frozen=True)
class InterventionEpisode(Episode):
    """One episode of a single command under an intervention, in addition to `Episode`.

    Attributes:
        intervention: what moved the arms.
    """

    intervention: str


@dataclasses.dataclass(frozen=True, kw_only=True)
class InterventionResult(GroupedResult[InterventionEpisode]):
    """Result of the intervention protocol; its tables are by intervention, then by the paper's name of the error.

    Attributes:
        training: training of the paper's policy in `paper`.
        errors: mean of the episodes' errors.
        intervals: the same means with their intervals.
        arm_error: mean distance of the arm joints to their external targets [rad].
        paper: the paper's errors.
    """

    training: str
    errors: dict[str, dict[str, float | None]]
    intervals: dict[str, dict[str, Estimate]] = dataclasses.field(default_factory=dict)
    arm_error: dict[str, float | None]
    paper: dict[str, dict[str, float]]


class InterventionJudge(SettledJudge):
    """Judge of an episode by the error of the command that its plan's label names."""

    def __call__(self, index: int, run: Run) -> InterventionEpisode:
        """Return the row of one episode."""
        assert run.plan.conditions is not None
        row = judged(run, run.plan.label, self.settle)
        return InterventionEpisode(**dataclasses.asdict(row), intervention=run.plan.conditions.intervention)


def intervention_plans(config: GaitSettings, samples: int) -> list[EpisodePlan]:
    """Return the same stratified samples of single commands under every intervention.

    Args:
        config: settings of the episodes.
        samples: number of episodes of each intervention.
    """
    # The same draw under every intervention: ground and sensor noise are the same as well.
    return [
        EpisodePlan(
            command,
            conditions=dataclasses.replace(config.conditions, intervention=intervention),
            draw=draw,
            label=name,
        )
        for intervention in INTERVENTIONS
        for draw, (name, command) in enumerate(stratified_samples(config, samples))
    ]


def by_intervention(rows: Sequence[InterventionEpisode]) -> dict[str, list[InterventionEpisode]]:
    """Return the rows of each intervention."""
    return {name: [row for row in rows if row.intervention == name] for name in INTERVENTIONS}


def missing_trainings(measured: Sequence[Measured]) -> list[str]:
    """Return the paper's trainings that no result is compared with."""
    return [name for name in TRAININGS if name not in {result["training"] for _, result in measured}]


def paper_alone(table: str, values: Mapping[str, float], units: Mapping[str, str], training: str) -> list[Figure]:
    """Return figures of the paper to which no measured figure corresponds.

    Args:
        table: title of their table.
        values: the figures by quantity.
        units: unit of each quantity.
        training: training of the paper's policy that they belong to.
    """
    return [
        Figure(table, quantity, units[quantity], "", None, value, reference=TRAINED[training])
        for quantity, value in values.items()
    ]


Config = TypeVar("Config", bound=InterventionConfig)


class MovedArmsProtocol(PlannedProtocol[Config, InterventionEpisode, Result]):
    """A protocol that runs the same single commands under every intervention: part of the paper's ablation."""

    fixed = frozenset({"intervention"})
    ablation = True

    def plans(self, settings: Config) -> list[EpisodePlan]:
        """Return the same samples of single commands under every intervention."""
        return intervention_plans(settings, settings.samples)

    def judge(self, settings: Config) -> InterventionJudge:
        """Return the judge of the sampled command's error."""
        return InterventionJudge(settings.settle)

    def for_training(self, settings: Config, training: str | None) -> Config:
        """Compare with the paper's policy of the same training, unless the settings name another one."""
        return dataclasses.replace(settings, training=settings.training or training or UNTRAINED_AGAINST)


class InterventionProtocol(MovedArmsProtocol[InterventionConfig, InterventionResult]):
    """The paper's tracking errors with the arms under external control."""

    name = "intervention"
    summary = "the same single commands with the arms moved by noise, by motions, and not at all"
    settings = InterventionConfig
    result = InterventionResult
    report_title = "Intervention"
    report_text = (
        "The same single commands while the arms are moved from outside. A policy is compared with the paper's policy "
        "of the same training (noise, motions or nothing), and an untrained controller with the one trained with "
        "noise. Where we have no policy, the paper's figures stand alone. The paper's motions are recorded from "
        "people, ours are generated or given."
    )

    def summarise(self, settings: InterventionConfig, rows: Sequence[InterventionEpisode]) -> dict[str, Any]:
        """Return falls and mean errors of each intervention, with the paper's."""
        parts = by_intervention(rows)
        errors = {
            kind: {
                ERROR_OF[name]: [row.error for row in part if row.command == name]
                for name in sampled_commands(settings.gait)
            }
            for kind, part in parts.items()
        }
        return {
            "training": settings.papers_training,
            "episodes": settings.samples,
            "falls": {kind: sum(row.fell for row in part) for kind, part in parts.items()},
            "errors": {kind: {name: mean(values) for name, values in part.items()} for kind, part in errors.items()},
            "intervals": {
                kind: {name: bootstrap_mean(values) for name, values in part.items()} for kind, part in errors.items()
            },
            "arm_error": {kind: mean(row.arm_error for row in part) for kind, part in parts.items()},
            "paper": {kind: dict(intervention_errors(settings.gait, kind, settings.papers_training)) for kind in parts},
        }

    def describe(self, result: InterventionResult) -> str:
        """Return a table for each intervention with the paper's errors, and the falls."""
        parts = []
        for kind, errors in result.errors.items():
            intervals, paper = result.intervals.get(kind, {}), result.paper[kind]
            rows = [beside_paper(name, error, intervals.get(name), paper.get(name)) for name, error in errors.items()]
            header = (f"arms: {kind}", result.controller, INTERVAL, f"paper ({result.training})", "ratio")
            falls = f"falls: {count_text(result.falls[kind], result.episodes)}"
            parts.append(f"{format_table(header, rows)}\n\n{falls}")
            if result.arm_error[kind] is not None:
                parts[-1] += f"; arm joints {result.arm_error[kind]:.3f} rad from their targets on average"
        return "\n\n".join([*parts, INTERVAL_NOTE, *failure_lines(result.rows)])

    def quick(self) -> list[InterventionConfig]:
        """Return few episodes of the gaits for which the paper has figures."""
        episodes = {Gait.STANDING: 9, Gait.WALKING: 24, Gait.JUMPING: 24}
        return [InterventionConfig(gait, episodes=count, duration=5.0) for gait, count in episodes.items()]

    def full(self) -> list[InterventionConfig]:
        """Return 256 episodes of each intervention for these gaits."""
        gaits = (Gait.STANDING, Gait.WALKING, Gait.JUMPING)
        return [InterventionConfig(gait, episodes=3 * 256, duration=21.0) for gait in gaits]

    def figures(self, controller: str, result: Mapping[str, Any]) -> list[Figure]:
        """Return tracking errors and falls, a table for each intervention."""
        figures, trained = [], TRAINED[result["training"]]
        for arms, errors in result["errors"].items():
            table = _table(result["gait"], arms)
            rows = [row for row in result["rows"] if row["intervention"] == arms]
            for error in errors:
                estimate = bootstrap_mean([row["error"] for row in rows if row["command"] == _COMMAND[error]])
                paper, unit = result["paper"][arms].get(error), COMMAND_UNITS[_COMMAND[error]]
                figures.append(Figure(table, error, unit, controller, estimate, paper, reference=trained))
            figures.append(falls_figure(table, controller, rows, trained))
        return figures

    def published(self, measured: Sequence[Measured]) -> list[Figure]:
        """Return the paper's errors of trainings that no result is compared with."""
        figures = []
        for gait in dict.fromkeys(result["gait"] for _, result in measured):
            for training in missing_trainings([entry for entry in measured if entry[1]["gait"] == gait]):
                for arms in ARMS:
                    errors = intervention_errors(Gait.parse(gait), arms, training)
                    units = {error: COMMAND_UNITS[_COMMAND[error]] for error in errors}
                    figures += paper_alone(_table(gait, arms), errors, units, training)
        return figures


def _table(gait: str, arms: str) -> str:
    return f"Intervention, {gait}, {ARMS[arms]}"
