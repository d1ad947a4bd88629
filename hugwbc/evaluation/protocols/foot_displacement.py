"""The paper's table of foot displacement: how far the feet of a standing robot travel while its arms are moved.

An episode of 20 s, in which h, p or w is commanded and the others are at their defaults. The displacement is the length
of both feet's paths, added up; a robot that has to step to stay up has a long one. What feet that stand firm creep in
MuJoCo is in it, and told apart as well (`metrics.foot_creep`). Episodes in which the robot fell would have short paths:
they are left out, and counted.
"""

import dataclasses
from collections.abc import Callable

from hugwbc.errors import ConfigError
from hugwbc.evaluation.paper import foot_displacement
from hugwbc.evaluation.protocols.episodes import ControllerFactory, ProtocolResult, mean, run_episodes
from hugwbc.evaluation.protocols.intervention import (
    InterventionConfig,
    InterventionEpisode,
    InterventionJudge,
    by_intervention,
    intervention_plans,
)
from hugwbc.evaluation.protocols.single_command import sampled_commands
from hugwbc.gait import Gait


@dataclasses.dataclass(frozen=True)
class FootDisplacementConfig(InterventionConfig):
    """Settings of the protocol: those of the tracking errors under intervention.

    Attributes:
        gait: standing, nothing else.
        episodes: in all, split evenly over the interventions, and each share over h, p and w.
        duration: of an episode: the paper's 20 s, and the settling time [s].
    """

    gait: Gait = Gait.STANDING
    episodes: int = 36
    _: dataclasses.KW_ONLY
    duration: float = 21.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.gait is not Gait.STANDING:
            raise ConfigError(f"foot displacement is that of a standing robot; the gait is {self.gait.label}")


@dataclasses.dataclass(frozen=True, kw_only=True)
class FootDisplacementResult(ProtocolResult[InterventionEpisode]):
    """Outcome of the protocol, beside what any has; the tables are by intervention, then by command.

    Attributes:
        training: how the paper's policy in `paper` was trained.
        episodes: how many of each intervention.
        falls: in how many of them the robot fell.
        displacement: mean length of both feet's paths in the episodes without a fall [m].
        creep: the part of it that is creep of feet that stand firm [m].
        paper: the paper's displacement [m].
    """

    training: str
    episodes: int
    falls: dict[str, int]
    displacement: dict[str, dict[str, float | None]]
    creep: dict[str, dict[str, float | None]]
    paper: dict[str, dict[str, float]]


def run_foot_displacement(
    factory: ControllerFactory,
    config: FootDisplacementConfig,
    on_episode: Callable[[InterventionEpisode], None] | None = None,
) -> FootDisplacementResult:
    """Run the protocol.

    Args:
        factory: makes the controller; with more than one worker it must be picklable.
        config: settings.
        on_episode: called with every finished episode, in order.
    """
    plans = intervention_plans(config, config.samples)
    rows = run_episodes(factory, plans, InterventionJudge(config.settle), config, on_episode)
    parts = by_intervention(rows)
    return FootDisplacementResult.of(
        factory,
        config,
        rows,
        training=config.training,
        episodes=config.samples,
        falls={kind: sum(row.fell for row in part) for kind, part in parts.items()},
        displacement={kind: _means(part, "foot_travel") for kind, part in parts.items()},
        creep={kind: _means(part, "foot_creep") for kind, part in parts.items()},
        paper={kind: dict(foot_displacement(kind, config.training)) for kind in parts},
    )


def _means(rows: list[InterventionEpisode], field: str) -> dict[str, float | None]:
    """Mean of a field over the episodes without a fall, by command."""
    return {
        name: mean(getattr(row, field) for row in rows if row.command == name and not row.fell)
        for name in sampled_commands(Gait.STANDING)
    }
