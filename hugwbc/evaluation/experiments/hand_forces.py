"""What the experiments with forces at the hands share: a stand or a walk whose hands are taken, and its figures.

With the sensors of a robot, the estimate of the forces on the hands is compared with the truth as well.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import Annotated

import numpy as np
from pydantic import Field

from hugwbc.commands import Command, default_command
from hugwbc.controller import Controller
from hugwbc.evaluation.episode import CountedSettings, Row, ending
from hugwbc.gait import Gait
from hugwbc.runtime.rollout import rollout
from hugwbc.runtime.trace import Trace
from hugwbc.settings import Count, NotNegative, settings
from hugwbc.sim import Engine, Force
from hugwbc.state import RobotState
from hugwbc.targets import HandTargets
from hugwbc.upper_ik import UpperBodySource

DIRECTIONS = tuple(range(0, 360, 45))  # [deg], counted from the robot's front to its left
TAKEN = 0.5  # [s], when the arms are taken over
STARTED = 1.0  # [s], when a walk starts
BEGIN = 3.0  # [s], when a force begins
RISE = 1.0  # [s], in which a steady force rises
HANDS = ((0.35, 0.2, 0.15), (0.35, -0.2, 0.15))  # targets in the pelvis frame [m]
_TARGETS = HandTargets.of(*HANDS)

Newtons = Annotated[float, Field(gt=0, le=500)]
Watch = Callable[[RobotState, RobotState], None]


@settings(kw_only=True)
class HandForceSettings(CountedSettings):
    """Settings of the experiments with forces at the hands.

    The duration is not used; every experiment has its own.
    """

    gait: str = "standing"  # standing or walking
    episodes: Count = 2  # number of episodes; of pull and push for each direction
    v_x: float = 0.4  # forward velocity of a walk [m/s]
    settle: NotNegative = BEGIN  # start of an episode that is left out of the errors [s]
    varied = frozenset({"intervention", "motions", "hand_payload"})
    possible = ("standing", "walking")

    def __post_init__(self) -> None:
        super().__post_init__()
        Command(v_x=self.v_x, gait=Gait.WALKING).validate()


@dataclasses.dataclass(frozen=True)
class Source:
    """Stands, and walks from `STARTED` on; the hands are taken at `TAKEN`."""

    v_x: float | None  # velocity of the walk [m/s]; None stands
    hands: HandTargets = _TARGETS  # targets of the hands

    def command_at(self, t: float) -> Command:
        """Return the command: a stand, or a walk that gets faster within a second."""
        if self.v_x is None or t < STARTED:
            return default_command(Gait.STANDING)
        return dataclasses.replace(default_command(Gait.WALKING), v_x=min(t - STARTED, 1.0) * self.v_x)

    def hands_at(self, t: float) -> HandTargets | None:
        """Return the targets of the hands."""
        return None if t < TAKEN else self.hands


def source_of(settings: HandForceSettings) -> Source:
    """Return the source of an experiment that stands or walks by its gait."""
    return Source(settings.v_x if settings.gait == "walking" else None)


class ForceWatch:
    """Compares, after each physics step from `BEGIN` on, the estimated forces on the hands with the true ones.

    Attributes:
        begun, end: position of the pelvis at `BEGIN`, and last [m].
    """

    def __init__(self, force: Callable[[RobotState], np.ndarray | None]) -> None:
        """Watch a robot, given the true force on each hand in a state [N], shape (2, 3)."""
        self._force = force
        self._squares: list[float] = []
        self.begun: np.ndarray | None = None
        self.end = np.zeros(3)

    def __call__(self, truth: RobotState, estimate: RobotState) -> None:
        """Take the state after a physics step."""
        if truth.time < BEGIN or truth.position is None:
            return
        if self.begun is None:
            self.begun = truth.position.copy()
        self.end = truth.position
        force = self._force(truth)
        if force is not None and estimate.hand_force is not None and truth.time > BEGIN + RISE:
            self._squares.append(float(np.mean(np.sum((estimate.hand_force - force) ** 2, axis=1))))

    def row(self) -> Row:
        """Return the root mean square error of a hand's force [N], and how far the pelvis moved [m]."""
        moved = None if self.begun is None else float(np.linalg.norm((self.end - self.begun)[:2]))
        error = math.sqrt(float(np.mean(self._squares))) if self._squares else None
        return {"estimate_error": error, "moved": moved}


def play(
    controller: Controller,
    settings: HandForceSettings,
    source: Source,
    simulation: Engine,
    duration: float,
    watch: Watch | None = None,
    forces: tuple[Force, ...] = (),
) -> tuple[Trace, Row]:
    """Run one episode, and return its record and what every row has."""
    trace = rollout(
        controller,
        source,
        simulation,
        UpperBodySource(robot=simulation.robot),
        duration=duration,
        estimator=settings.conditions.estimator(),
        forces=forces,
        on_step=watch,
        strict=False,
    )
    return trace, ending(trace)


def heading(direction: float) -> np.ndarray:
    """Return the unit vector of a direction [deg], shape (3,)."""
    return np.array([math.cos(math.radians(direction)), math.sin(math.radians(direction)), 0.0])
