"""Settings of the imitation of a controller."""

import dataclasses
import math
import pathlib

from hugwbc.learned.config.checks import require, require_seed, require_speed
from hugwbc.learned.config.environment import CommandConfig, EnvConfig


def _imitation_env() -> EnvConfig:
    """Few robots, each with a teacher to ask; mixed often; no jumps, which the QP cannot do at the policy's rate."""
    command = CommandConfig(standing_fraction=0.25, walking_fraction=0.75, resample_steps=250)
    return EnvConfig(count=24, episode_steps=600, command=command)


@dataclasses.dataclass(frozen=True)
class ImitationConfig:
    """Imitation of a teacher, before reinforcement learning."""

    out: pathlib.Path = pathlib.Path("runs/imitation")
    """Folder of the policy and of the snapshot from which `hugwbc train --start-from` goes on."""
    samples: float = 3e5
    """Labels to collect; the teacher is asked once for each."""
    seed: int = 1
    threads: int = 1
    handover: float = 0.2
    """Part of the labels over which the student takes over the driving."""
    least_taught: float = 0.1
    """Part of the episodes that the teacher drives after that."""
    own_time: float = 0.0
    """Mean time that the student drives until the teacher takes over again within the episode [s], for motions that
    the student cannot keep up yet; the teacher begins every episode, and also takes over where a hop's held foot comes
    down. 0: whole episodes are either's."""
    taught_time: float = 0.5
    """Mean time that the teacher then drives [s], at least until half a second after both agree with the gait."""
    exploration: float = 0.08
    """Std of the noise on all actions, so that states beside the path are labelled too."""
    noise_level: float = 1.0
    """The intervention's alpha: what the arms follow while they are taken over."""
    max_speed: float = 1.4
    """Largest v_x of the agile group [m/s]."""
    learning_rate: float = 1e-3
    """At the start; falls to a tenth."""
    batch: int = 1024
    updates: int = 14
    """Gradient steps after every 40 control steps."""
    upper_weight: float = 0.3
    """Weight of arms and waist beside the legs' 1."""
    estimation_weight: float = 0.2
    starts: int = 4096
    """States of the first part, of robots that the teacher drives in the gait that is commanded, to write beside the
    policy as starts.safetensors, in which training episodes can start (`--env.starts`)."""
    std: float = 0.12
    """Exploration std that the snapshot starts reinforcement learning with."""
    env: EnvConfig = dataclasses.field(default_factory=_imitation_env)

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_seed(self.seed)
        require_speed(self.max_speed)
        for name in ("samples", "handover", "learning_rate", "std"):
            value = getattr(self, name)
            require(0.0 < value < math.inf, name, value, "a positive number")
        for name in ("threads", "batch", "updates"):
            require(getattr(self, name) > 0, name, getattr(self, name), "a positive integer")
        for name in ("least_taught", "noise_level"):
            require(0.0 <= getattr(self, name) <= 1.0, name, getattr(self, name), "0 to 1")
        require(self.starts >= 0, "starts", self.starts, "0 or a positive integer")
        require(0.0 < self.taught_time < math.inf, "taught_time", self.taught_time, "a positive number")
        for name in ("exploration", "upper_weight", "estimation_weight", "own_time"):
            require(0.0 <= getattr(self, name) < math.inf, name, getattr(self, name), "0 or a positive number")
