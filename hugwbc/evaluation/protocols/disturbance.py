"""The paper's figure of disturbance tolerance: the largest force that a standing robot survives.

The force acts on the torso from eight directions, either from its start to the end of the episode or for one second.
It counts as tolerated if at least 98 % of the rollouts, 4096 in the paper, end without a fall. The paper's figure has
no numbers, and does not say what differs between two rollouts. Here friction, payload and joint gains are drawn from
the training's ranges, and the start of the force from an interval of half a second. A rollout's draws are the same for
every force.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from hugwbc.commands import default_command
from hugwbc.errors import ConfigError
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.figures import Figure
from hugwbc.evaluation.intervals import Estimate
from hugwbc.evaluation.picture_data import Polar
from hugwbc.evaluation.protocols.episodes import ControllerFactory, GaitSettings, ProtocolResult, Run, run_episodes
from hugwbc.evaluation.protocols.protocol import Measured, Protocol
from hugwbc.evaluation.survival import SurvivalSearch
from hugwbc.evaluation.tables import format_table
from hugwbc.gait import Gait
from hugwbc.sim import Force

DIRECTIONS = tuple(range(0, 360, 45))  # [deg] of the force, counted from the robot's front to its left
KINDS = {"constant": None, "second": 1.0}  # how long the force acts [s]
SURVIVAL = 0.98
_START_SPREAD = 0.5  # [s]
_DIRECTION_NAMES = {"0": "0 deg, forward", "90": "90 deg, left", "180": "180 deg, backward", "270": "270 deg, right"}
_KIND_NAMES = {"constant": "constant", "second": "for one second"}


@dataclasses.dataclass(frozen=True)
class DisturbanceConfig(GaitSettings):
    """Settings of the disturbance protocol, in addition to `GaitSettings`.

    Attributes:
        gait: standing, or a gait at its default command.
        rollouts: number of rollouts of each force; the paper's figure has 4096.
        first: force to begin the search with [N].
        limit: largest force to try [N].
        resolution: relative width of the bracket at which the search for a force ends.
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
        """Return a new search for one direction and kind of force."""
        return SurvivalSearch(
            trials=self.rollouts, survival=SURVIVAL, first=self.first, limit=self.limit, resolution=self.resolution
        )

    @property
    def episodes(self) -> int:
        """Approximate number of rollouts: most forces are decided early."""
        return len(KINDS) * len(DIRECTIONS) * self.search().likely_trials


@dataclasses.dataclass(frozen=True)
class DisturbanceEpisode:
    """One rollout.

    Attributes:
        kind: key of `KINDS`.
        direction: direction of the force [deg].
        force: magnitude of the force [N].
        start: start of the force [s].
        fell: whether the robot fell.
        survived_s: time until the fall, or the whole episode [s].
    """

    kind: str
    direction: int
    force: float
    start: float
    fell: bool
    survived_s: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class DisturbanceResult(ProtocolResult[DisturbanceEpisode]):
    """Result of the disturbance protocol; its tables are by kind of force, then by direction in degrees.

    Attributes:
        rollouts: number of rollouts of each force.
        tolerated: largest force with at least 98 % survival [N].
        refused: smallest force with less [N]; None where the limit was tolerated.
        episodes: number of rollouts that were needed.
    """

    rollouts: int
    tolerated: dict[str, dict[str, float]]
    refused: dict[str, dict[str, float | None]]
    episodes: int


def disturbance_plan(config: DisturbanceConfig, kind: str, direction: int, force: float, draw: int) -> EpisodePlan:
    """Plan one rollout.

    Args:
        config: settings of the protocol.
        kind: key of `KINDS`.
        direction: direction of the force [deg].
        force: magnitude of the force [N].
        draw: number of the rollout; the same number gives the same robot and the same start of the force.
    """
    # The draws depend on the rollout's number alone, so that every force is tried on the same robots.
    rng = np.random.default_rng((config.seed, draw))
    conditions = config.conditions.of_a_drawn_robot(rng)
    angle = math.radians(direction)
    vector = (force * math.cos(angle), force * math.sin(angle), 0.0)
    start = config.settle + float(rng.uniform(0.0, _START_SPREAD))
    push = Force(vector, start, KINDS[kind], frame="heading")
    command = default_command(config.alternating[draw % 2])
    return EpisodePlan(command, (push,), conditions, draw, label=f"{kind} {direction} {force!r}")


@dataclasses.dataclass(frozen=True)
class DisturbanceJudge:
    """Judge that reads kind, direction and force from the plan's label, as `disturbance_plan` writes it."""

    def __call__(self, index: int, run: Run) -> DisturbanceEpisode:
        """Return the row of one rollout."""
        kind, direction, force = run.plan.label.split()
        return DisturbanceEpisode(
            kind=kind,
            direction=int(direction),
            force=float(force),
            start=run.plan.forces[0].start,
            fell=run.trace.fell,
            survived_s=run.trace.survived_s,
        )


class DisturbanceProtocol(Protocol[DisturbanceConfig, DisturbanceEpisode, DisturbanceResult]):
    """The largest force that a standing robot survives."""

    name = "disturbance"
    summary = "search for the largest force on a standing robot that it survives"
    settings = DisturbanceConfig
    fixed = frozenset({"payload", "friction", "gain"})  # drawn for every rollout
    report_title = "Disturbance tolerance"
    report_text = (
        "Largest force at the torso of a standing robot with at least 98 % survival, from its front (0°) to its left "
        "(90°), found by bisection; the interval is the bracket in which the search ended. The paper's figure has "
        "no numbers."
    )

    def run(
        self,
        factory: ControllerFactory,
        settings: DisturbanceConfig,
        on_episode: Callable[[DisturbanceEpisode], None] | None = None,
    ) -> DisturbanceResult:
        """Search all directions and kinds side by side, so that they fill the workers; arguments as in `Protocol`."""
        searches = {(kind, direction): settings.search() for kind in KINDS for direction in DIRECTIONS}
        rows: list[DisturbanceEpisode] = []
        # Each round runs the next rollouts of every search that is still open.
        while open_ones := {key: search for key, search in searches.items() if not search.done}:
            plans = [
                disturbance_plan(settings, *key, search.load, draw)
                for key, search in open_ones.items()
                for draw in search.numbers
            ]
            found = run_episodes(factory, plans, DisturbanceJudge(), settings, on_episode)
            rows += found
            for (kind, direction), search in open_ones.items():
                search.record([not row.fell for row in found if (row.kind, row.direction) == (kind, direction)])
        return DisturbanceResult.of(
            factory,
            settings,
            rows,
            rollouts=settings.rollouts,
            tolerated={kind: {str(d): searches[kind, d].tolerated for d in DIRECTIONS} for kind in KINDS},
            refused={kind: {str(d): searches[kind, d].refused for d in DIRECTIONS} for kind in KINDS},
            episodes=len(rows),
        )

    def describe(self, result: DisturbanceResult) -> str:
        """Return the tolerated force by direction and kind."""
        constant, second = result.tolerated["constant"], result.tolerated["second"]
        rows = [(_DIRECTION_NAMES.get(d, f"{d} deg"), f"{f:.0f}", f"{second[d]:.0f}") for d, f in constant.items()]
        table = format_table((f"{result.gait}, {result.controller}", "constant [N]", "one second [N]"), rows)
        about = f"largest forces with at least 98 % survival of {result.rollouts} rollouts"
        limit = " (the limit of the search was survived somewhere)"
        unbounded = any(force is None for forces in result.refused.values() for force in forces.values())
        return f"{table}\n\n{about}; {result.episodes} rollouts in all{limit if unbounded else ''}"

    def quick(self) -> list[DisturbanceConfig]:
        """Return one rollout per force: the search then finds where a single robot falls, not 98 % survival."""
        return [DisturbanceConfig(rollouts=1, first=80.0, resolution=0.25, duration=4.0)]

    def full(self) -> list[DisturbanceConfig]:
        """Return the paper's number of rollouts."""
        return [DisturbanceConfig(rollouts=4096)]

    def figures(self, controller: str, result: Mapping[str, Any]) -> list[Figure]:
        """Return the largest tolerated force by direction, with the bracket that its search ended in."""
        figures = []
        for kind, forces in result["tolerated"].items():
            table = f"Tolerated force, {_KIND_NAMES[kind]}"
            for direction, force in forces.items():
                estimate = Estimate(force, force, result["refused"][kind][direction], result["rollouts"])
                figures.append(Figure(table, f"{direction}°", "N", controller, estimate, higher_is_better=True))
        return figures

    def pictures(self, measured: Sequence[Measured], controllers: Sequence[str]) -> list[Polar]:
        """Return the tolerated force over direction, for each kind of force."""
        results = {name: result["tolerated"] for name, result in measured}
        pictures = []
        for kind in dict.fromkeys(kind for tolerated in results.values() for kind in tolerated):
            directions = list(dict.fromkeys(d for tolerated in results.values() for d in tolerated[kind]))
            # Controllers without a result keep their place, so that the colours are the same on the whole page.
            found = {name: results.get(name, {}).get(kind, {}) for name in controllers}
            series = {name: [forces.get(d) for d in directions] for name, forces in found.items()}
            angles = [math.radians(float(d)) for d in directions]
            pictures.append(Polar(f"Tolerated force, {_KIND_NAMES[kind]}", angles, series, "N"))
        return pictures
