"""The paper's table of foot displacement: how far the feet of a standing robot travel while its arms are moved.

In an episode of 20 s, one of h, p and w is commanded and the others are at their defaults. The displacement is the
summed path length of both feet; a robot that has to step to stay up has a long one. Feet that stand firmly still creep
a little in MuJoCo. That creep is part of the displacement and is also given separately (`metrics.foot_creep`). Episodes
with a fall would have short paths: they are left out, and counted.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from hugwbc.errors import ConfigError
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import Estimate, bootstrap_mean
from hugwbc.evaluation.paper import foot_displacement
from hugwbc.evaluation.protocols.episodes import GroupedResult, mean
from hugwbc.evaluation.protocols.intervention import (
    ARMS,
    TRAINED,
    InterventionConfig,
    InterventionEpisode,
    MovedArmsProtocol,
    by_intervention,
    missing_trainings,
    paper_alone,
)
from hugwbc.evaluation.protocols.protocol import (
    INTERVAL,
    INTERVAL_NOTE,
    Measured,
    beside_paper,
    count_text,
    failure_lines,
    four_decimals,
)
from hugwbc.evaluation.protocols.single_command import sampled_commands
from hugwbc.evaluation.tables import format_table
from hugwbc.gait import Gait


@dataclasses.dataclass(frozen=True)
class FootDisplacementConfig(InterventionConfig):
    """Settings of the foot-displacement protocol, in addition to `InterventionConfig`.

    Attributes:
        gait: standing; other gaits are refused.
        episodes: number of episodes in all, split evenly over the interventions, and each share over h, p and w.
        duration: length of an episode [s]: the paper's 20 s, and the settling time.
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
class FootDisplacementResult(GroupedResult[InterventionEpisode]):
    """Result of the foot-displacement protocol; its tables are by intervention, then by command.

    Attributes:
        training: training of the paper's policy in `paper`.
        displacement: mean summed path length of both feet in the episodes without a fall [m].
        intervals: the same means with their intervals.
        creep: part of the displacement that is creep of firmly standing feet [m].
        paper: the paper's displacement [m].
    """

    training: str
    displacement: dict[str, dict[str, float | None]]
    intervals: dict[str, dict[str, Estimate]] = dataclasses.field(default_factory=dict)
    creep: dict[str, dict[str, float | None]]
    paper: dict[str, dict[str, float]]


class FootDisplacementProtocol(MovedArmsProtocol[FootDisplacementConfig, FootDisplacementResult]):
    """The paper's foot displacement of a standing robot with the arms under external control."""

    name = "foot-displacement"
    summary = "path length of the feet of a standing robot while its arms are moved"
    settings = FootDisplacementConfig
    result = FootDisplacementResult
    report_title = "Foot displacement"
    report_text = (
        "Summed path length of both feet of a robot that should stand for 20 s. Episodes with a fall are left out of "
        "the length and counted."
    )

    def summarise(self, settings: FootDisplacementConfig, rows: Sequence[InterventionEpisode]) -> dict[str, Any]:
        """Return falls, displacement and creep of each intervention, with the paper's displacement."""
        parts = by_intervention(rows)
        return {
            "training": settings.papers_training,
            "episodes": settings.samples,
            "falls": {kind: sum(row.fell for row in part) for kind, part in parts.items()},
            "displacement": {
                kind: {name: mean(values) for name, values in _upright(part, "foot_travel").items()}
                for kind, part in parts.items()
            },
            "intervals": {
                kind: {name: bootstrap_mean(values) for name, values in _upright(part, "foot_travel").items()}
                for kind, part in parts.items()
            },
            "creep": {
                kind: {name: mean(values) for name, values in _upright(part, "foot_creep").items()}
                for kind, part in parts.items()
            },
            "paper": {kind: dict(foot_displacement(kind, settings.papers_training)) for kind in parts},
        }

    def describe(self, result: FootDisplacementResult) -> str:
        """Return the displacement by intervention and command with the paper's, and the falls."""
        rows = [
            (
                *beside_paper(
                    f"{kind}, {name}",
                    length,
                    result.intervals.get(kind, {}).get(name),
                    result.paper[kind].get(name),
                ),
                four_decimals(result.creep[kind][name]),
            )
            for kind, lengths in result.displacement.items()
            for name, length in lengths.items()
        ]
        paper = f"paper ({result.training})"
        header = ("foot displacement [m]", result.controller, INTERVAL, paper, "ratio", "of it creep")
        falls = ", ".join(f"{kind} {count_text(count, result.episodes)}" for kind, count in result.falls.items())
        seconds = result.duration - result.settle
        lines = [format_table(header, rows), "", f"in {seconds:g} s; falls: {falls}, left out above", INTERVAL_NOTE]
        return "\n".join(lines + failure_lines(result.rows))

    def quick(self) -> list[FootDisplacementConfig]:
        """Return one episode for each intervention and command."""
        return [FootDisplacementConfig(episodes=9)]

    def full(self) -> list[FootDisplacementConfig]:
        """Return 32 episodes for each intervention and command."""
        return [FootDisplacementConfig(episodes=3 * 96)]

    def figures(self, controller: str, result: Mapping[str, Any]) -> list[Figure]:
        """Return displacement and falls, a table for each intervention."""
        figures, trained = [], TRAINED[result["training"]]
        for arms, travel in result["displacement"].items():
            table = _table(arms)
            rows = [row for row in result["rows"] if row["intervention"] == arms]
            for command in travel:
                kept = [row["foot_travel"] for row in rows if row["command"] == command and not row["fell"]]
                paper, quantity = result["paper"][arms].get(command), _commanded(command)
                estimate = bootstrap_mean(kept)
                figures.append(Figure(table, quantity, "m", controller, estimate, paper, reference=trained))
            figures.append(falls_figure(table, controller, rows, trained))
        return figures

    def published(self, measured: Sequence[Measured]) -> list[Figure]:
        """Return the paper's displacement of trainings that no result is compared with."""
        figures = []
        for training in missing_trainings(measured) if measured else ():
            for arms in ARMS:
                lengths = {_commanded(name): length for name, length in foot_displacement(arms, training).items()}
                figures += paper_alone(_table(arms), lengths, dict.fromkeys(lengths, "m"), training)
        return figures


def _upright(rows: Sequence[InterventionEpisode], field: str) -> dict[str, list[float | None]]:
    """Return a field of the episodes without a fall, by command."""
    return {
        name: [getattr(row, field) for row in rows if row.command == name and not row.fell]
        for name in sampled_commands(Gait.STANDING)
    }


def _table(arms: str) -> str:
    return f"Foot displacement, {ARMS[arms]}"


def _commanded(name: str) -> str:
    return f"{name} commanded"
