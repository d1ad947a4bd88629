"""Settings of the learner and of a training run."""

import dataclasses
import math
import pathlib
from typing import Literal

from hugwbc.learned.config.checks import require, require_finite, require_seed
from hugwbc.learned.config.environment import EnvConfig
from hugwbc.learned.config.schedules import Schedule, scheduled
from hugwbc.seeds import TRAINING_SEED


@dataclasses.dataclass(frozen=True)
class PPOConfig:
    """PPO: loss = value + policy_weight surrogate + estimation_weight L_est + beta L_sym - entropy_weight entropy."""

    horizon: int = 24
    """Control steps of every robot per iteration."""
    epochs: int = 3
    """Passes over the experience of an iteration."""
    minibatches: int = 4
    """Minibatches per epoch."""
    gamma: float = 0.99
    """Discount per control step."""
    lam: float = 0.95
    """Trace decay lambda of the generalised advantage estimate. With the discount it gives credit over 1 / (1 - gamma
    lam) = 17 control steps, two thirds of a hop's cycle."""
    advantages: Literal["gait", "all"] = "gait"
    """Over which samples advantages are standardised: those of each gait, or all. Over all, the rare falls of a hard
    gait make up the variance, and the cost of a small error in an easy one cannot be seen."""
    clip: float = 0.2
    """Largest change of the probability ratio that the surrogate rewards."""
    value_clip: float = 0.0
    """Largest change of a value in an update [reward]; 0 for no limit. With a limit of 0.2 the values of the hop
    drifted to 13 above its returns (docs/log/training.md)."""
    policy_weight: float = 1.0
    """Weight of the surrogate loss (the paper's lambda_policy)."""
    estimation_weight: float = 1.0
    """Weight of the estimation loss (the paper's lambda_est)."""
    symmetry: Literal["network", "loss", "none"] = "network"
    """How the policy learns that left and right are alike: by networks that commute with the mirror, by the paper's
    symmetry loss, or not at all."""
    beta: float = 0.5
    """Weight of the symmetry loss (the paper's beta), if there is one."""
    labels: pathlib.Path | None = None
    """File with labels of a teacher, for behaviour cloning; None for none."""
    cloning_weight: float = 0.0
    """Weight of the cloning loss, the smooth L1 error of the action; meant to decay by a schedule."""
    cloning_batch: int = 2048
    """Labels in the cloning loss of a gradient step."""
    entropy_weight: float = 0.002
    """Weight of the entropy bonus."""
    learning_rate: float = 3e-4
    """Learning rate of the actor at the start; the KL divergence then moves it within `learning_rate_range`."""
    critic_learning_rate: float = 3e-4
    """Learning rate of the critic, constant."""
    learning_rate_range: tuple[float, float] = (1e-5, 1e-3)
    """Smallest and largest learning rate of the actor."""
    target_kl: float = 0.02
    """KL divergence of an update at which the learning rate stays; above twice of it the rate falls, below half of it
    the rate rises."""
    max_grad_norm: float = 1.0
    """Largest norm of the gradient, for actor and critic separately."""
    std_initial: float = 0.6
    """Largest exploration std at the start."""
    std_final: float = 0.25
    """Largest exploration std at the end of the schedule."""
    std_steps: float = 45e6
    """Environment steps over which the largest exploration std falls geometrically from initial to final."""
    std_limit: float = 1.0
    """Largest exploration std whatever the three settings above say; for schedules of other forms."""
    std_min: float = 0.03
    """Smallest exploration std."""
    mixed_precision: bool = False
    """Use bfloat16 in the critic and in the mirrored branch of the symmetry loss; the actor has float32. A value of 10
    is then rounded to .06, more than what a step of perfect tracking is worth."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_finite(self, "ppo.")
        for name in ("horizon", "epochs", "minibatches"):
            require(getattr(self, name) > 0, f"ppo.{name}", getattr(self, name), "a positive integer")
        for name in ("gamma", "lam", "clip"):
            require(0.0 < getattr(self, name) <= 1.0, f"ppo.{name}", getattr(self, name), "above 0, up to 1")
        require(self.value_clip >= 0.0, "ppo.value_clip", self.value_clip, "0 or a positive number")
        for name in (
            "learning_rate",
            "std_initial",
            "std_final",
            "std_min",
            "std_limit",
            "target_kl",
            "max_grad_norm",
            "critic_learning_rate",
            "std_steps",
        ):
            value = getattr(self, name)
            require(value > 0.0, f"ppo.{name}", value, "a positive number")
        require(self.cloning_batch > 0, "ppo.cloning_batch", self.cloning_batch, "a positive integer")
        for name in ("policy_weight", "estimation_weight", "beta", "entropy_weight", "cloning_weight"):
            value = getattr(self, name)
            require(value >= 0.0, f"ppo.{name}", value, "0 or a positive number")
        low, high = self.learning_rate_range
        require(0.0 < low <= high, "ppo.learning_rate_range", (low, high), "low and high, above 0")


@dataclasses.dataclass(frozen=True)
class TrainConfig:
    """A training run."""

    out: pathlib.Path = pathlib.Path("runs/h1")
    """Folder of checkpoints, policy and log."""
    resume: bool = False
    """Continue from the latest checkpoint in `out`."""
    start_from: pathlib.Path | None = None
    """Checkpoint or snapshot of another run to start from, such as that of a shipped policy."""
    steps: float = 50e6
    """Environment steps, over all sessions of the run, after which it stops."""
    hours: float = 24.0
    """Wall-clock time after which the session stops [h]."""
    seed: int = TRAINING_SEED
    """Seed of all random numbers."""
    threads: int = 2
    """Threads of the simulation and of torch; with 1, other cores stay free."""
    device: Literal["cpu", "cuda"] = "cpu"
    """With cuda, the networks learn on the GPU; physics, rewards and observations stay on the CPU."""
    critic_warm_up: int = 0
    """Iterations at the start of this session in which only the critic learns. Use it for a policy from another method,
    or after a change of rewards or discount: the values are wrong at first and would spoil the actor."""
    save_interval: int = 50
    """Iterations between two checkpoints."""
    evaluation_interval: int = 50
    """Iterations between two evaluations, whose best policy is kept in `out`/best; 0 for none."""
    evaluation_robots: int = 128
    """Robots of an evaluation."""
    evaluation_seconds: float = 5.0
    """Length of the episodes of an evaluation [s]."""
    evaluation_timestep: float = 0.002
    """Physics time step of the evaluations [s]: that of the arena, in which policies are judged."""
    env: EnvConfig = dataclasses.field(default_factory=EnvConfig)
    ppo: PPOConfig = dataclasses.field(default_factory=PPOConfig)
    schedules: tuple[Schedule, ...] = ()
    """Settings that change with the steps and replace the values above. They have no options: recipes have them."""

    def at(self, steps: float) -> "TrainConfig":
        """Return the configuration with the scheduled settings at their values after a number of steps."""
        return scheduled(dataclasses.replace(self, schedules=()), self.schedules, steps)

    def __post_init__(self) -> None:
        """Check the limits."""
        require_seed(self.seed)
        require(self.steps > 0, "steps", self.steps, "a positive number")
        require(self.hours > 0, "hours", self.hours, "a positive number")
        require(self.threads > 0, "threads", self.threads, "a positive integer")
        require(self.critic_warm_up >= 0, "critic_warm_up", self.critic_warm_up, "0 or more")
        require(self.save_interval > 0, "save_interval", self.save_interval, "a positive integer")
        require(self.evaluation_interval >= 0, "evaluation_interval", self.evaluation_interval, "0 or more")
        require(self.evaluation_robots > 0, "evaluation_robots", self.evaluation_robots, "a positive integer")
        seconds = self.evaluation_seconds
        require(0.0 < seconds < math.inf, "evaluation_seconds", seconds, "a positive number")
        step = self.evaluation_timestep
        require(0.0 < step <= 0.01, "evaluation_timestep", step, "above 0, up to 0.01 s")
        if self.schedules:  # refuse unknown names and values now, not in the middle of the night
            for steps in {step for schedule in self.schedules for step in schedule.steps}:
                scheduled(dataclasses.replace(self, schedules=()), self.schedules, steps)
