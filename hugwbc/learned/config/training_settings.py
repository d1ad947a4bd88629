"""Settings of the learner and of a training run."""

import dataclasses
import math
import pathlib
from typing import Literal

from hugwbc.learned.config.checks import require, require_finite, require_seed
from hugwbc.learned.config.environment import EnvConfig


@dataclasses.dataclass(frozen=True)
class PPOConfig:
    """The learner. Weights: loss = value + policy_weight * surrogate + estimation_weight * L_est + beta * L_sym."""

    horizon: int = 24
    """Control steps per iteration."""
    epochs: int = 3
    minibatches: int = 4
    gamma: float = 0.98
    lam: float = 0.92
    """With the usual 0.99 and 0.95, rare falls made most of the advantages' variance and hid what a command's error
    costs: see the log in docs/learned.md."""
    clip: float = 0.2
    value_clip: float = 0.2
    """How far a value may move in an update [reward]; 0 for no limit, which the critic of a policy that often falls
    needs: with the limit, that of the hop drifted 13 above its returns (docs/learned.md)."""
    policy_weight: float = 1.0
    estimation_weight: float = 1.0
    beta: float = 0.5
    """Weight of the symmetry loss (the paper's beta)."""
    entropy_weight: float = 0.002
    learning_rate: float = 3e-4
    """Of the actor at the start of a run; the KL then moves it within the range below."""
    critic_learning_rate: float = 3e-4
    """Of the critic, throughout."""
    learning_rate_range: tuple[float, float] = (1e-5, 1e-3)
    target_kl: float = 0.02
    max_grad_norm: float = 1.0
    std_initial: float = 0.8
    std_final: float = 0.25
    std_steps: float = 45e6
    """Environment steps over which the largest exploration std falls, geometrically, from initial to final."""
    std_min: float = 0.03
    mixed_precision: bool = True
    """bfloat16 in the critic and in the mirrored branch of the symmetry loss; never in the actor."""

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
            "target_kl",
            "max_grad_norm",
            "critic_learning_rate",
            "std_steps",
        ):
            value = getattr(self, name)
            require(value > 0.0, f"ppo.{name}", value, "a positive number")
        for name in ("policy_weight", "estimation_weight", "beta", "entropy_weight"):
            value = getattr(self, name)
            require(value >= 0.0, f"ppo.{name}", value, "0 or a positive number")
        low, high = self.learning_rate_range
        require(0.0 < low <= high, "ppo.learning_rate_range", (low, high), "low and high, above 0")


@dataclasses.dataclass(frozen=True)
class TrainConfig:
    """A training run."""

    out: pathlib.Path = pathlib.Path("runs/h1")
    """Folder of checkpoints and logs."""
    resume: bool = False
    """Continue from the latest checkpoint in `out`."""
    start_from: pathlib.Path | None = None
    """Checkpoint or snapshot of another run to start from, such as a shipped policy's."""
    steps: float = 50e6
    """Stop after this many environment steps in all."""
    hours: float = 24.0
    """Stop after this much wall-clock time."""
    seed: int = 1
    threads: int = 2
    """Threads of the simulation and of torch; 1 leaves the other cores alone."""
    critic_warm_up: int = 0
    """Iterations at the start of this session in which only the critic learns: for a policy that another method made,
    or after a change of rewards or discount, when the values are wrong at first and would lead the actor astray."""
    save_interval: int = 50
    """Iterations between two checkpoints."""
    evaluation_interval: int = 50
    """Iterations between two evaluations, whose best policy is kept in `out`/best; 0 for none."""
    evaluation_robots: int = 128
    evaluation_seconds: float = 5.0
    device: Literal["cpu", "cuda"] = "cpu"
    """cuda: physics (mujoco_warp) and learner on the GPU, extra [gpu]; rewards and observations stay on the CPU."""
    env: EnvConfig = dataclasses.field(default_factory=EnvConfig)
    ppo: PPOConfig = dataclasses.field(default_factory=PPOConfig)

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
