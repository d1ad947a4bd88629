"""The paper's figure of disturbance tolerance: the largest force that a standing robot survives.

The force acts on the torso from eight directions, either from its start to the end of the episode or for one second.
It counts as tolerated if at least 98 % of the rollouts, 4096 in the paper, end without a fall. The paper's figure has
no numbers, and does not say what differs between two rollouts. Here friction, payload and joint gains are drawn from
the training's ranges, and the start of the force from an interval of half a second. A rollout's draws are the same for
every force.
"""

import math
from collections.abc import Sequence
from typing import Annotated

import numpy as np
import polars as pl
from pydantic import Field
from scipy.special import bdtr, bdtrc

from hugwbc.controller import Controller
from hugwbc.errors import ConfigError
from hugwbc.evaluation.episode import Row, Settings, ending, simulate
from hugwbc.evaluation.experiment import Experiment, Measured, Section
from hugwbc.evaluation.experiments.forces import DIRECTIONS, heading
from hugwbc.evaluation.figures import Figure
from hugwbc.evaluation.intervals import Estimate
from hugwbc.evaluation.plans import Plan
from hugwbc.settings import Count, Positive, settings
from hugwbc.sim import Force
from hugwbc.viz import evaluation_plots
from hugwbc.viz.plots import Panel

KINDS = {"constant": None, "second": 1.0}  # how long the force acts [s]
SURVIVAL = 0.98
FIRST_TRIALS = 8  # of a load before the first look at the outcome; the number then doubles
DOUBT = 0.001  # a load is decided early if an outcome as extreme as the one seen is less probable than this
_START_SPREAD = 0.5  # [s]
_KIND_NAMES = {"constant": "constant", "second": "for one second"}


@settings(kw_only=True)
class DisturbanceSettings(Settings):
    """Settings of disturbance; a force begins at `settle` or up to half a second later."""

    gait: str = "standing"  # standing, or a gait at its default command
    rollouts: Count = 16  # number of rollouts of each force; the paper's figure has 4096
    first: Positive = 50.0  # force to begin the search with [N]
    limit: Positive = 800.0  # largest force to try [N]
    # relative width of the bracket at which the search for a force ends
    resolution: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.05
    varied = frozenset({"payload", "friction", "gain"})  # drawn for every rollout

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.first > self.limit:
            raise ConfigError(f"first is {self.first} N and limit {self.limit} N; give first <= limit")
        if self.settle + _START_SPREAD + 1.0 >= self.duration:
            raise ConfigError(
                f"duration is {self.duration} s and settle {self.settle} s; leave {_START_SPREAD + 1.0} s for the force"
            )


class SurvivalSearch:
    """Search for the largest load at which at least a share `SURVIVAL` of the rollouts is survived.

    Use it in a loop: read `load` and `numbers`, run these rollouts, pass the outcome to `record`, until `done`. The
    load doubles from `first` until it is too large and is bisected from there, which assumes that survival falls with
    the load. Using the same random numbers for the same rollout at every load makes this nearly true for few rollouts.

    The outcome is examined after 8, 16, 32, ... rollouts. A load is decided early if the remaining ones cannot change
    the answer, or if the outcome so far has a probability below `DOUBT` at a survival of exactly the required share
    (exact binomial test).

    Attributes:
        tolerated: largest load that was survived often enough; 0 if none was.
        refused: smallest load that was not survived often enough; None if there is none up to `limit`.
    """

    def __init__(self, settings: DisturbanceSettings) -> None:
        """Start the search in one direction."""
        self.tolerated = 0.0
        self.refused: float | None = None
        self._settings = settings
        self._count = self._failed = 0

    @property
    def done(self) -> bool:
        """Whether the answer is known."""
        if self.refused is None:
            return self.tolerated >= self._settings.limit
        width = self._settings.resolution * max(self.tolerated, self._settings.first)
        return self.refused - self.tolerated <= width

    @property
    def load(self) -> float:
        """The load to try next."""
        if self.refused is not None:
            return 0.5 * (self.tolerated + self.refused)
        return min(2.0 * self.tolerated or self._settings.first, self._settings.limit)

    @property
    def numbers(self) -> range:
        """The numbers of the rollouts to run next at `load`."""
        return range(self._count, min(max(FIRST_TRIALS, 2 * self._count), self._settings.rollouts))

    def record(self, survived: list[bool]) -> None:
        """Take the outcome of the rollouts of `numbers`, in their order."""
        self._count += len(survived)
        self._failed += len(survived) - sum(survived)
        verdict = self._verdict()
        if verdict is None:
            return
        if verdict:
            self.tolerated = self.load
        else:
            self.refused = self.load
        self._count = self._failed = 0

    def _verdict(self) -> bool | None:
        """Return whether the load is tolerated; None if it takes more rollouts to tell."""
        risk, rollouts = 1.0 - SURVIVAL, self._settings.rollouts
        allowed = math.floor(risk * rollouts + 1e-9)
        if self._failed > allowed or bdtrc(self._failed - 1, self._count, risk) < DOUBT:
            return False
        if self._failed + rollouts - self._count <= allowed or bdtr(self._failed, self._count, risk) < DOUBT:
            return True
        return None


def following(settings: DisturbanceSettings, rows: Sequence[Row]) -> list[Plan]:
    """Return the next rollouts of every search that is not over, so that all of them fill the workers."""
    plans = []
    for (kind, direction), search in searches(settings, rows).items():
        for draw in () if search.done else search.numbers:
            # The draws depend on the rollout's number alone, so that every force is tried on the same robots.
            rng = np.random.default_rng((settings.seed, draw))
            conditions = settings.conditions.of_a_drawn_robot(rng)
            start = settings.settle + float(rng.uniform(0.0, _START_SPREAD))
            vector = tuple((search.load * heading(direction)).tolist())
            push = Force(vector, start, KINDS[kind], frame="heading")
            tags = {"kind": kind, "direction": direction, "force": search.load}
            plans.append(Plan(draw, settings.default_command(draw), tags, (push,), conditions))
    return plans


def searches(settings: DisturbanceSettings, rows: Sequence[Row]) -> dict[tuple[str, int], SurvivalSearch]:
    """Return how far the search of each kind and direction is after some rows."""
    found = {}
    for kind in KINDS:
        for direction in DIRECTIONS:
            search = found[kind, direction] = SurvivalSearch(settings)
            outcomes = [not row["fell"] for row in rows if (row["kind"], row["direction"]) == (kind, direction)]
            while outcomes:
                count = len(search.numbers)
                search.record(outcomes[:count])
                outcomes = outcomes[count:]
    return found


def episode(controller: Controller, settings: DisturbanceSettings, plan: Plan) -> Row:
    """Return whether the robot fell."""
    return ending(simulate(controller, settings, plan))


def figures(settings: DisturbanceSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return the largest tolerated force by direction, with the bracket in which its search ended."""
    return [
        Figure(
            f"Tolerated force, {_KIND_NAMES[kind]}",
            f"{direction}°",
            "N",
            Estimate(search.tolerated, search.tolerated, search.refused, settings.rollouts),
            higher_is_better=True,
        )
        for (kind, direction), search in searches(settings, rows.to_dicts()).items()
    ]


def pictures(measured: Sequence[Measured], controllers: Sequence[str]) -> list[Panel]:
    """Return the tolerated force over direction, for each kind of force."""
    found = {name: searches(chosen, rows.to_dicts()) for name, chosen, rows in measured}
    angles = [math.radians(direction) for direction in DIRECTIONS]
    # Controllers without a result keep their place, so that the colours are the same on the whole page.
    return [
        evaluation_plots.polar(
            f"Tolerated force, {name}",
            angles,
            {c: [found[c][kind, d].tolerated if c in found else None for d in DIRECTIONS] for c in controllers},
            "N",
        )
        for kind, name in _KIND_NAMES.items()
        if found
    ]


EXPERIMENT = Experiment(
    "disturbance",
    "search for the largest force on a standing robot that it survives",
    DisturbanceSettings,
    lambda settings: following(settings, ()),
    episode,
    figures,
    following=following,
    note="Largest forces with at least 98 % survival; the interval is the bracket in which the search ended.",
    section=Section(
        "Disturbance tolerance",
        "Largest force at the torso of a standing robot with at least 98 % survival (in the quick profile: that one "
        "robot survives), by where it pushes: 0° ahead, 90° to the left. It is found by bisection; the interval is the "
        "bracket in which the search ended. The paper's figure has no numbers.",
        # With one rollout per force the search finds where a single robot falls, not 98 % survival.
        lambda: [DisturbanceSettings(rollouts=1, first=80.0, resolution=0.25, duration=4.0)],
        lambda: [DisturbanceSettings(rollouts=4096)],
        pictures,
    ),
)
