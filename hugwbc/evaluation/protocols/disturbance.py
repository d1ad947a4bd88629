"""The paper's figure of disturbance tolerance: the largest force on a standing robot that it survives.

From eight directions, at the torso, either all the time from its start on, or for one second. A force counts as
tolerated if at least 98 % of the rollouts end without a fall; the paper has 4096. Its figure has no numbers, nor does
it say what differs between two rollouts: here friction, payload and joint gains are drawn from the training's ranges,
and the start of the force from half a second. A rollout's draws are the same for every force.
"""

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from hugwbc.commands import default_command
from hugwbc.errors import ConfigError
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.protocols.episodes import ControllerFactory, GaitSettings, ProtocolResult, Run, run_episodes
from hugwbc.evaluation.survival import SurvivalSearch
from hugwbc.gait import Gait
from hugwbc.sim import Force

DIRECTIONS = tuple(range(0, 360, 45))  # [deg], of the force, from the robot's front to its left
KINDS = {"constant": None, "second": 1.0}  # how long the force acts [s]
SURVIVAL = 0.98
_START_SPREAD = 0.5  # [s]


@dataclasses.dataclass(frozen=True)
class DisturbanceConfig(GaitSettings):
    """Settings of the protocol, beside those of any of one gait.

    Attributes:
        rollouts: of a force.
        first: force to begin with [N].
        limit: largest force [N].
        resolution: relative width of the bracket at which the search ends.
        settle: earliest start of the force [s].
    """

    gait: Gait = Gait.STANDING
    rollouts: int = 16
    first: float = 50.0
    limit: float = 800.0
    resolution: float = 0.05

    def __post_init__(self) -> None:
        super().__post_init__()
        self.search()
        if self.settle + _START_SPREAD + 1.0 >= self.duration:
            raise ConfigError(
                f"duration is {self.duration} s and settle {self.settle} s; leave {_START_SPREAD + 1.0} s for the force"
            )

    def search(self) -> SurvivalSearch:
        """For one direction and kind.

        Raises:
            ConfigError: if a value is out of range.
        """
        return SurvivalSearch(
            trials=self.rollouts, survival=SURVIVAL, first=self.first, limit=self.limit, resolution=self.resolution
        )

    @property
    def episodes(self) -> int:
        """About how many it takes: most forces are decided early."""
        return len(KINDS) * len(DIRECTIONS) * self.search().likely_trials


@dataclasses.dataclass(frozen=True)
class DisturbanceEpisode:
    """One rollout.

    Attributes:
        kind: of `KINDS`.
        direction: of the force [deg].
        force: [N].
        start: of the force [s].
        fell: whether the robot fell.
        survived_s: [s].
    """

    kind: str
    direction: int
    force: float
    start: float
    fell: bool
    survived_s: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class DisturbanceResult(ProtocolResult[DisturbanceEpisode]):
    """Outcome of the protocol, beside what any has; the tables are by kind, then by direction in degrees.

    Attributes:
        rollouts: of a force.
        tolerated: largest force with at least 98 % survival [N].
        refused: smallest force with less [N]; None where the limit was tolerated.
        episodes: how many were needed.
    """

    rollouts: int
    tolerated: dict[str, dict[str, float]]
    refused: dict[str, dict[str, float | None]]
    episodes: int


def disturbance_plan(config: DisturbanceConfig, kind: str, direction: int, force: float, draw: int) -> EpisodePlan:
    """One rollout.

    Args:
        config: settings.
        kind: of `KINDS`.
        direction: of the force [deg].
        force: [N].
        draw: number of the rollout: same number, same robot and same start of the force.
    """
    rng = np.random.default_rng((config.seed, draw))
    conditions = config.conditions.of_a_drawn_robot(rng)
    angle = math.radians(direction)
    vector = (force * math.cos(angle), force * math.sin(angle), 0.0)
    start = config.settle + float(rng.uniform(0.0, _START_SPREAD))
    push = Force(vector, start, KINDS[kind], frame="heading")
    command = default_command(config.alternating[draw % 2])
    return EpisodePlan(command, (push,), conditions, draw, label=f"{kind} {direction} {force!r}")


def run_disturbance(
    factory: ControllerFactory,
    config: DisturbanceConfig,
    on_episode: Callable[[DisturbanceEpisode], None] | None = None,
) -> DisturbanceResult:
    """Run the protocol: all directions and kinds side by side, so that they fill the workers.

    Args:
        factory: makes the controller; with more than one worker it must be picklable.
        config: settings.
        on_episode: called with every finished rollout.
    """
    searches = {(kind, direction): config.search() for kind in KINDS for direction in DIRECTIONS}
    rows: list[DisturbanceEpisode] = []
    while open_ones := {key: search for key, search in searches.items() if not search.done}:
        plans = [
            disturbance_plan(config, *key, search.load, draw)
            for key, search in open_ones.items()
            for draw in search.numbers
        ]
        found = run_episodes(factory, plans, DisturbanceJudge(), config, on_episode)
        rows += found
        for (kind, direction), search in open_ones.items():
            search.record([not row.fell for row in found if (row.kind, row.direction) == (kind, direction)])
    return DisturbanceResult.of(
        factory,
        config,
        rows,
        rollouts=config.rollouts,
        tolerated={kind: {str(d): searches[kind, d].tolerated for d in DIRECTIONS} for kind in KINDS},
        refused={kind: {str(d): searches[kind, d].refused for d in DIRECTIONS} for kind in KINDS},
        episodes=len(rows),
    )


@dataclasses.dataclass(frozen=True)
class DisturbanceJudge:
    """Reads kind, direction and force from the plan's label, as `disturbance_plan` writes it."""

    def __call__(self, index: int, run: Run) -> DisturbanceEpisode:
        """The row of one rollout."""
        kind, direction, force = run.plan.label.split()
        return DisturbanceEpisode(
            kind=kind,
            direction=int(direction),
            force=float(force),
            start=run.plan.forces[0].start,
            fell=run.trace.fell,
            survived_s=run.trace.survived_s,
        )
