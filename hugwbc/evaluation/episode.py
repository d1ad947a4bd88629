"""One episode: the settings that every experiment has, and the simulation of a plan."""

import dataclasses
from typing import Annotated, Any, ClassVar

from hugwbc.commands import Command, default_command
from hugwbc.controller import Controller
from hugwbc.errors import ConfigError
from hugwbc.evaluation.conditions import ArmIntervention, Conditions
from hugwbc.evaluation.metrics import SETTLE_S
from hugwbc.evaluation.plans import Plan
from hugwbc.gait import Gait
from hugwbc.robot import Robot, load_robot
from hugwbc.runtime.rollout import rollout
from hugwbc.runtime.trace import Trace
from hugwbc.scripts.view import CommandSource
from hugwbc.settings import SELECTION_SEED, Count, NotNegative, Positive, Seed, not_default, one_of, settings
from hugwbc.sim import Engine, Scene
from hugwbc.upper_ik import UpperBodySource

Row = dict[str, Any]
"""What is kept of an episode: plain numbers and texts by column; None where there is nothing to measure."""
BOTH_LEGS = "hopping"
GAITS = (*(gait.label for gait in Gait), BOTH_LEGS)
MOVING = GAITS[1:]  # all but standing
BY_BEHAVIOUR = frozenset({"gait", "settle", "intervention", "motions"})  # what a behaviour decides itself


@settings(kw_only=True)
class Settings:
    """Settings that every experiment has."""

    # seed of the sampled commands, the ground, the sensor noise and the arm motion (its classes: docs/evaluation.md)
    seed: Seed = SELECTION_SEED
    duration: Positive = 10.0  # duration of an episode [s]
    settle: NotNegative = SETTLE_S  # start of an episode that is left out of the errors [s]
    # standing, walking, jumping, hopping_left, hopping_right, or hopping: on the left and the right leg in alternate
    # episodes
    gait: Annotated[str, one_of("gait", lambda: GAITS)] = Gait.WALKING.label
    conditions: Conditions = dataclasses.field(default_factory=Conditions)  # physics, robot, sensors, arms
    varied: ClassVar[frozenset[str]] = frozenset()
    """Conditions and settings that the experiment sets itself."""
    possible: ClassVar[tuple[str, ...]] = GAITS
    """Gaits with which the experiment makes sense."""

    def __post_init__(self) -> None:
        if self.gait not in self.possible:
            raise ConfigError(f"gait is {self.gait}; this experiment takes {', '.join(self.possible)}")
        if "settle" not in self.varied and not self.settle < self.duration:
            raise ConfigError(f"duration is {self.duration} s and settle {self.settle} s; give 0 <= settle < duration")
        if "duration" not in self.varied:
            self.conditions.check_duration(self.duration)
        played = self.conditions.intervention == "motion" or self.varied & {"intervention", "motions"}
        if self.conditions.motions is not None and not played:
            raise ConfigError(
                f"motions is {self.conditions.motions}, which only the motion intervention plays; add --intervention "
                "motion, or leave --motions out"
            )
        for owner in (self, self.conditions):
            for field in dataclasses.fields(owner):
                if field.name in self.varied and getattr(owner, field.name) != field.default:
                    raise ConfigError(
                        f"the experiment sets {field.name} itself; leave --{field.name.replace('_', '-')} out"
                    )

    @property
    def gaits(self) -> tuple[Gait, Gait]:
        """The gaits of even and of odd draws, which differ for hopping only."""
        if self.gait == BOTH_LEGS:
            return Gait.HOPPING_LEFT, Gait.HOPPING_RIGHT
        return Gait.parse(self.gait), Gait.parse(self.gait)

    @property
    def robot(self) -> Robot:
        """The simulated robot's table."""
        return load_robot(self.conditions.robot)

    @property
    def remark(self) -> str:
        """What differs from the defaults, such as "gait jumping, robot g1, payload 5"; empty for the defaults."""
        own = not_default(self, without={"seed", "episodes", "conditions"})
        return ", ".join(words for words in (own, not_default(self.conditions)) if words)

    def default_command(self, draw: int = 0) -> Command:
        """Return the robot's default command in the gait whose turn it is in a draw."""
        return default_command(self.gaits[draw % 2], self.robot)


@settings(kw_only=True)
class CountedSettings(Settings):
    """Settings of an experiment with a number of episodes."""

    episodes: Count = 1  # number of episodes


def simulation_of(settings: Settings, plan: Plan, duration: float | None = None, scene: Scene | None = None) -> Engine:
    """Return the simulation of an episode, whose seed is that of the settings and the plan's draw.

    A duration [s] takes the place of the settings', where an experiment has its own.
    """
    conditions, duration = plan.conditions or settings.conditions, duration or settings.duration
    conditions.check_duration(duration)
    return conditions.simulation(duration, (settings.seed, plan.draw), scene)


def simulate(
    controller: Controller,
    settings: Settings,
    plan: Plan,
    *,
    source: CommandSource | None = None,
    simulation: Engine | None = None,
    upper_body: UpperBodySource | ArmIntervention | None = None,
    **options: Any,  # noqa: ANN401
) -> Trace:
    """Run one episode in a simulation of its own, and return its record.

    By default the commands are the plan's, and the simulation, the estimator and what moves the arms are those of the
    conditions. Further options are those of `rollout`.
    """
    conditions = plan.conditions or settings.conditions
    simulation = simulation or simulation_of(settings, plan)
    defaults: dict[str, Any] = {"duration": settings.duration, "forces": plan.forces, "strict": False}
    defaults |= {
        "estimator": conditions.estimator(),
        "upper_body": upper_body or conditions.arms((settings.seed, plan.draw)),
    }
    return rollout(controller, source or plan.source, simulation, **defaults | options)


def ending(trace: Trace) -> Row:
    """Return whether the robot fell or knelt down, how long it was up [s], and mistakes of controller and sources."""
    return {"fell": trace.down, "survived_s": trace.survived_s, "mistakes": trace.safety.mistakes}
