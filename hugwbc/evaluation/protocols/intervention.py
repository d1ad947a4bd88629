"""The paper's table of tracking errors while the arms are under external control: noise, motions, or nothing.

Every kind of intervention has the same sampled commands, so that what differs between two of them is the arms alone.
"""

import dataclasses
from collections.abc import Callable, Sequence

from hugwbc.commands import COMMAND_NAMES
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.evaluation.conditions import INTERVENTIONS
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.paper import TRAININGS, intervention_errors
from hugwbc.evaluation.protocols.episodes import (
    ControllerFactory,
    CountedSettings,
    GaitSettings,
    ProtocolResult,
    Run,
    mean,
    run_episodes,
)
from hugwbc.evaluation.protocols.single_command import Episode, judged, sampled_commands, stratified_samples

ERROR_OF = {name: f"E_{name.replace('_', '')}" for name in COMMAND_NAMES}  # the paper's names; v_x at all speeds


@dataclasses.dataclass(frozen=True)
class InterventionConfig(CountedSettings):
    """Settings of the protocol, beside those of any of one gait.

    Attributes:
        episodes: in all, split evenly over the interventions, and each share over the commands of the gait.
        training: which of the paper's policies stands beside, one of `paper.TRAININGS`.
    """

    episodes: int = 96
    training: str = "noise"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.training not in TRAININGS:
            raise UnknownNameError("training", self.training, TRAININGS)
        if self.conditions.intervention != "none":
            raise ConfigError("this protocol runs every intervention; leave that of the conditions at none")

    @property
    def least(self) -> tuple[int, str]:
        """One for each command of the gait under each intervention."""
        commands = len(sampled_commands(self.gait))
        return len(INTERVENTIONS) * commands, f"{len(INTERVENTIONS)} interventions and {commands} commands"

    @property
    def samples(self) -> int:
        """Episodes of each intervention."""
        return self.episodes // len(INTERVENTIONS)


@dataclasses.dataclass(frozen=True)
class InterventionEpisode(Episode):
    """One episode.

    Attributes:
        intervention: what moved the arms.
    """

    intervention: str


@dataclasses.dataclass(frozen=True, kw_only=True)
class InterventionResult(ProtocolResult[InterventionEpisode]):
    """Outcome of the protocol, beside what any has; the tables are by intervention, then by the paper's error name.

    Attributes:
        training: how the paper's policy in `paper` was trained.
        episodes: how many of each intervention.
        falls: in how many of them the robot fell.
        errors: mean of the episodes' errors.
        arm_error: mean distance of the arm joints to their external targets [rad].
        paper: the paper's errors.
    """

    training: str
    episodes: int
    falls: dict[str, int]
    errors: dict[str, dict[str, float | None]]
    arm_error: dict[str, float | None]
    paper: dict[str, dict[str, float]]


@dataclasses.dataclass(frozen=True)
class InterventionJudge:
    """Judges an episode by the error of the command that its plan's label names.

    Attributes:
        settle: start of the episode that is left out [s].
    """

    settle: float

    def __call__(self, index: int, run: Run) -> InterventionEpisode:
        """The row of one episode."""
        assert run.plan.conditions is not None
        row = judged(run, run.plan.label, self.settle)
        return InterventionEpisode(**dataclasses.asdict(row), intervention=run.plan.conditions.intervention)


def intervention_plans(config: GaitSettings, samples: int) -> list[EpisodePlan]:
    """The same stratified samples of single commands under every intervention.

    Args:
        config: settings of the episodes.
        samples: episodes of each intervention.
    """
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
    """The rows of each intervention."""
    return {name: [row for row in rows if row.intervention == name] for name in INTERVENTIONS}


def run_intervention(
    factory: ControllerFactory,
    config: InterventionConfig,
    on_episode: Callable[[InterventionEpisode], None] | None = None,
) -> InterventionResult:
    """Run the protocol.

    Args:
        factory: makes the controller; with more than one worker it must be picklable.
        config: settings.
        on_episode: called with every finished episode, in order.
    """
    plans = intervention_plans(config, config.samples)
    rows = run_episodes(factory, plans, InterventionJudge(config.settle), config, on_episode)
    parts = by_intervention(rows)
    return InterventionResult.of(
        factory,
        config,
        rows,
        training=config.training,
        episodes=config.samples,
        falls={kind: sum(row.fell for row in part) for kind, part in parts.items()},
        errors={
            kind: {
                ERROR_OF[name]: mean(row.error for row in part if row.command == name)
                for name in sampled_commands(config.gait)
            }
            for kind, part in parts.items()
        },
        arm_error={kind: mean(row.arm_error for row in part) for kind, part in parts.items()},
        paper={kind: dict(intervention_errors(config.gait, kind, config.training)) for kind in parts},
    )
