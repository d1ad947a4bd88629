"""Settings of the learner, of a training run, and of a calibration."""

import dataclasses
import math
import pathlib
from typing import Annotated, Literal

import tyro
from pydantic import Field

from hugwbc.errors import ConfigError
from hugwbc.gait import Gait
from hugwbc.learned.config.environment import ADOPTED, READ_ONCE, EnvConfig
from hugwbc.learned.config.robot_settings import Range
from hugwbc.learned.config.schedules import Schedule, scheduled
from hugwbc.settings import (
    SELECTION_SEED,
    TRAINING_SEED,
    Count,
    NotNegative,
    Positive,
    PositiveShare,
    Seed,
    one_of,
    settings,
)

Device = Literal["auto", "cpu", "cuda", "warp"]
_BUILT_ONCE = (
    "env.count",
    "env.robot",
    "env.timestep",
    "env.substeps",
    "env.observations",
    "env.action_scale",
    "env.yaw_action_factor",
    "env.yaw_damping_factor",
    "env.waist_rate",
    *(f"env.{name}" for name in READ_ONCE),
    "ppo.learning_rate",
    "ppo.critic_learning_rate",
)  # settings of robots, networks, optimiser, control period and PD gains, and what curricula read only at the start


@settings
class PPOConfig:
    """PPO: loss = value + policy_weight surrogate + estimation_weight L_est - entropy_weight entropy."""

    horizon: Count = 24
    """Control steps of every robot per iteration."""
    epochs: Count = 3
    """Passes over the experience of an iteration."""
    minibatches: Count = 4
    """Minibatches per epoch."""
    gamma: PositiveShare = 0.99
    """Discount per control step."""
    lam: PositiveShare = 0.95
    """Trace decay lambda of the generalised advantage estimate. With the discount it gives credit over 1 / (1 - gamma
    lam) = 17 control steps, two thirds of a hop's cycle."""
    advantage_clip: Annotated[float, Field(gt=0, allow_inf_nan=True)] = math.inf
    """Largest advantage of a gait, in mean absolute deviations. Few steps, such as those before a fall, have advantages
    ten times as large as all others, and alone make half of the gradient's noise (docs/log/signal.md)."""
    clip: PositiveShare = 0.2
    """Largest change of the probability ratio that the surrogate rewards."""
    policy_weight: NotNegative = 1.0
    """Weight of the surrogate loss (the paper's lambda_policy)."""
    estimation_weight: NotNegative = 1.0
    """Weight of the estimation loss (the paper's lambda_est)."""
    entropy_weight: NotNegative = 0.002
    """Weight of the entropy bonus."""
    learning_rate: Positive = 3e-4
    """Learning rate of the actor at the start, which the KL divergence then moves within `learning_rate_range`; a run
    that starts from another goes on with that one's."""
    critic_learning_rate: Positive = 3e-4
    """Learning rate of the critic, constant."""
    learning_rate_range: Range = (1e-5, 1e-3)
    """Smallest and largest learning rate of the actor."""
    target_kl: Positive = 0.02
    """KL divergence of an update at which the learning rate stays; above twice of it the rate falls, below half of it
    the rate rises."""
    max_grad_norm: Positive = 1.0
    """Largest norm of the gradient, for actor and critic separately."""
    std_initial: Positive = 0.6
    """Largest exploration std at the start."""
    std_final: Positive = 0.25
    """Largest exploration std at the end of the schedule."""
    std_steps: Positive = 45e6
    """Environment steps over which the largest exploration std falls geometrically from initial to final; those of the
    run that this one starts from count."""
    std_limit: Positive = 1.0
    """Largest exploration std whatever the three settings above say; for schedules of other forms."""
    std_min: Positive = 0.03
    """Smallest exploration std."""


@settings
class TrainConfig:
    """A training run."""

    out: pathlib.Path = pathlib.Path("runs/h1")
    """Folder of checkpoints, policy and log."""
    resume: bool = False
    """Continue from the latest checkpoint in `out`."""
    start_from: pathlib.Path | None = None
    """Checkpoint or snapshot of another run to start from, such as that of a shipped policy."""
    steps: Positive = 50e6
    """Environment steps of this run, over all its sessions, after which it stops."""
    hours: Positive = 24.0
    """Wall-clock time after which the session stops [h]."""
    seed: Seed = TRAINING_SEED
    """Seed of all random numbers."""
    threads: Count = 2
    """Threads of the simulation and of torch; with 1, other cores stay free."""
    device: Device = "auto"
    """Where physics, rewards, observations and networks are computed: on the processor, by MuJoCo; or on an NVIDIA GPU,
    by MuJoCo Warp (hugwbc[gpu]); auto takes a GPU where there is one. Evaluations stay on the processor. With warp, the
    GPU's physics runs on the processor, for tests."""
    critic_warm_up: Annotated[int, Field(ge=0)] = 0
    """Iterations at the start of the run in which only the critic learns. Use it for a policy from another run, or
    after a change of rewards or discount: the values are wrong at first and would spoil the actor."""
    save_interval: Count = 50
    """Iterations between two checkpoints."""
    average_steps: NotNegative = 0.0
    """Time constant, in environment steps, of the exponential moving average (EMA) of the learner's weights that is
    evaluated and given out; 0 for the weights themselves. The errors of single updates cancel (docs/log/signal.md)."""
    evaluation_steps: NotNegative = 1e6
    """Environment steps between two evaluations, whose best policy is kept in `out`/best; 0 for none."""
    evaluation_robots: Count = 128
    """Robots of an evaluation."""
    evaluation_seconds: Positive = 5.0
    """Length of the episodes of an evaluation [s]."""
    evaluation_timestep: Annotated[float, Field(gt=0, le=0.01)] = 0.002
    """Largest physics time step of the evaluations [s]: that of the arena, in which policies are judged."""
    env: EnvConfig = dataclasses.field(default_factory=EnvConfig)
    ppo: PPOConfig = dataclasses.field(default_factory=PPOConfig)
    schedules: Annotated[dict[str, Schedule], tyro.conf.Suppress] = dataclasses.field(default_factory=dict)
    """Settings by dotted name, such as ppo.horizon, that change with the steps of this run and replace the values
    above. They have no options: recipes have them. What is built once cannot change (`_BUILT_ONCE`); what the robots
    are rebuilt for (of env, all that is not in `ADOPTED`) changes in steps."""

    source: Annotated[str, tyro.conf.Suppress] = ""
    """Name and digest of the Python file that these settings come from, for the record."""

    def at(self, steps: float) -> "TrainConfig":
        """Return the configuration with the scheduled settings at their values after some steps of this run."""
        return scheduled(dataclasses.replace(self, schedules={}), self.schedules, steps)

    def __post_init__(self) -> None:
        """Refuse unknown names and invalid values of schedules before the training begins, not hours later."""
        for name in self.schedules:
            if not name.startswith(("env.", "ppo.")) or name in _BUILT_ONCE:
                raise ConfigError(
                    f"'{name}' cannot change during a training; give settings of env and ppo, other than "
                    f"{', '.join(_BUILT_ONCE)}",
                    at=("schedules", name),
                )
            if name.removeprefix("env.") in self.env.curriculum.rules:
                raise ConfigError(
                    f"'{name}' has a schedule, and a rule of env.curriculum.rules moves it; give one of the two",
                    at=("schedules", name),
                )
        places = {place for schedule in self.schedules.values() for place in schedule.points}
        # Just before a point, too: a schedule of the shape steps has its previous value there.
        for steps in sorted(places | {math.nextafter(place, 0.0) for place in places}):
            try:
                self.at(steps)
            except ConfigError as error:
                raise ConfigError(f"the schedules give at {steps:g} steps: {error}", at=("schedules",)) from error
        for name, schedule in self.schedules.items():
            kind, _, setting = name.partition(".")
            adopted = kind == "ppo" or setting.partition(".")[0] in ADOPTED
            if not adopted and schedule.shape != "steps" and len(schedule.points) > 1:
                raise ConfigError(
                    f"a {schedule.shape} schedule of '{name}' would rebuild all robots in every iteration; give it the "
                    f"shape steps. Other shapes are for settings of ppo and for {', '.join(ADOPTED)} of env",
                    at=("schedules", name),
                )


@settings
class CalibrationConfig:
    """Calibration of a policy by feed-forward: curves of what to request, measured in the arena."""

    policy: pathlib.Path
    """Policy to calibrate: a file, or in a recipe the name of an earlier stage."""
    commands: tuple[Literal["v_x", "v_y", "omega", "h", "p", "w", "l"], ...] = ("v_x", "v_y", "omega", "h", "p", "l")
    """Commands to calibrate."""
    gaits: tuple[Annotated[str, one_of("gait", lambda: [gait.label for gait in Gait])], ...] = tuple(
        gait.label for gait in Gait
    )
    """Gaits to calibrate."""
    knots: Annotated[int, Field(ge=2, le=25)] = 5
    """Values of each command at which a curve is measured, spread evenly over its range."""
    rounds: Annotated[int, Field(ge=1, le=20)] = 3
    """How often the curves are measured and corrected."""
    rate: PositiveShare = 0.7
    """Fraction of the measured error that is corrected in a round."""
    duration: Annotated[float, Field(ge=1.5, le=60)] = 6.0
    """Length of an episode [s]; the first second does not count."""
    seed: Annotated[int, Field(ge=0, le=999)] = SELECTION_SEED
    """Seed of the episodes: one of selection."""
