"""Settings of learning from teachers: imitation of a controller, and distillation of several policies."""

import dataclasses
import math
import pathlib

from hugwbc.errors import ConfigError
from hugwbc.learned.config.checks import require, require_seed, require_speed
from hugwbc.learned.config.environment import CommandConfig, EnvConfig
from hugwbc.seeds import TRAINING_SEED

# In the order in which they are asked: catching blends into the label that standing gave.
TEACHERS = ("standing", "catching", "walking", "jumping", "hopping")
CALIBRATED_COMMANDS = ("v_x", "v_y", "omega", "h", "p", "w", "l")  # all commands whose execution is measured


def _imitation_env() -> EnvConfig:
    """Build a small environment, since every robot has a teacher to ask; the QP cannot jump at the policy's rate."""
    command = CommandConfig(standing_fraction=0.25, walking_fraction=0.75, resample_steps=250)
    return EnvConfig(count=24, episode_steps=600, command=command)


@dataclasses.dataclass(frozen=True)
class ImitationConfig:
    """Imitation of a controller, as a start for reinforcement learning."""

    out: pathlib.Path = pathlib.Path("runs/imitation")
    """Folder of the policy and of the snapshot for `hugwbc train --start-from`."""
    samples: float = 3e5
    """Labels to collect; each is one call of the teacher."""
    seed: int = TRAINING_SEED
    """Seed of all random numbers."""
    threads: int = 1
    """Threads of the simulation and of torch."""
    handover: float = 0.2
    """Fraction of the labels over which the student takes over the driving."""
    least_taught: float = 0.1
    """Fraction of the episodes that the teacher drives after that."""
    own_time: float = 0.0
    """Mean time that the student drives before the teacher takes over again within the episode [s], for motions that
    the student cannot sustain yet. The teacher then begins every episode, and also takes over where the held foot of a
    hop comes down. With 0, a whole episode belongs to one of them."""
    taught_time: float = 0.5
    """Mean time that the teacher then drives [s]; at least until it and the robot have been in the commanded gait for
    half a second."""
    exploration: float = 0.08
    """Std of the noise on all actions, so that states off the teacher's path are labelled too."""
    noise_level: float = 1.0
    """Noise level alpha of the intervention."""
    max_speed: float = 1.4
    """Largest v_x of the agile group [m/s]."""
    learning_rate: float = 1e-3
    """Learning rate at the start; it falls to a tenth."""
    batch: int = 1024
    """Samples of a gradient step."""
    updates: int = 14
    """Gradient steps after every 40 control steps."""
    upper_weight: float = 0.3
    """Weight of arms and waist in the loss; legs have 1."""
    estimation_weight: float = 0.2
    """Weight of the estimation loss."""
    starts: int = 4096
    """States to write as starts.safetensors, in which episodes of a training can start (`--env.starts`). They come from
    robots that the teacher drives in the commanded gait."""
    keep_labels: bool = False
    """Write all labels as labels.safetensors, for behaviour cloning in a training (`--ppo.labels`)."""
    std: float = 0.12
    """Exploration std with which the snapshot starts reinforcement learning."""
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


def _distillation_env() -> EnvConfig:
    """Build an environment with frequent changes of command; starts and pushes are those of training, to see falls."""
    command = CommandConfig(standing_fraction=0.4, walking_fraction=0.4, resample_steps=250)
    return EnvConfig(count=512, episode_steps=800, command=command)


@dataclasses.dataclass(frozen=True)
class DistillationConfig:
    """One network from several, each the teacher of a gait. Paths are those of snapshots or checkpoints."""

    out: pathlib.Path = pathlib.Path("runs/distilled")
    """Folder of the policy and of the snapshot for `hugwbc train --start-from`."""
    start_from: pathlib.Path | None = None
    """Network that the student starts as; its critic, exploration std and record are kept."""
    standing: pathlib.Path | None = None
    """Teacher of standing."""
    catching: pathlib.Path | None = None
    """Teacher of standing while the robot moves much; the teacher of standing if it is not given."""
    walking: pathlib.Path | None = None
    """Teacher of walking."""
    jumping: pathlib.Path | None = None
    """Teacher of jumping."""
    hopping: pathlib.Path | None = None
    """Teacher of hopping on either leg."""
    samples: float = 2e6
    """Labels to collect."""
    memory: int = 400_000
    """Number of labels that are kept; the oldest are dropped."""
    seed: int = TRAINING_SEED
    """Seed of all random numbers."""
    threads: int = 1
    """Threads of the simulation and of torch."""
    calibration: float = 0.2
    """Fraction of the labels during which the teachers drive and are calibrated; after that the student drives."""
    calibrated: tuple[str, ...] = ("standing", "catching", "walking")
    """Teachers to calibrate. Leave out a teacher that falls often: asked for more, it falls more."""
    calibrated_commands: tuple[str, ...] = CALIBRATED_COMMANDS
    """Commands to calibrate. Leave out commands that are executed well enough."""
    exploration: float = 0.1
    """Std of the noise on all actions, so that states off the teacher's path are labelled too."""
    noise_level: float = 0.5
    """Noise level alpha of the intervention."""
    max_speed: float = 1.4
    """Largest v_x of the agile group [m/s]."""
    learning_rate: float = 5e-4
    """Learning rate at the start; it falls to a twentieth."""
    batch: int = 2048
    """Samples of a gradient step."""
    updates: int = 6
    """Gradient steps after every 10 control steps."""
    estimation_weight: float = 0.2
    """Weight of the estimation loss."""
    env: EnvConfig = dataclasses.field(default_factory=_distillation_env)

    def __post_init__(self) -> None:
        """Check the ranges, and that every gait that is drawn has a teacher."""
        require_seed(self.seed)
        require_speed(self.max_speed)
        for name in ("samples", "learning_rate"):
            value = getattr(self, name)
            require(0.0 < value < math.inf, name, value, "a positive number")
        for name in ("threads", "batch", "updates", "memory"):
            require(getattr(self, name) > 0, name, getattr(self, name), "a positive integer")
        for name in ("noise_level", "calibration"):
            require(0.0 <= getattr(self, name) <= 1.0, name, getattr(self, name), "0 to 1")
        for name in ("exploration", "estimation_weight"):
            require(0.0 <= getattr(self, name) < math.inf, name, getattr(self, name), "0 or a positive number")
        for name in self.calibrated:
            require(name in TEACHERS, "calibrated", name, ", ".join(TEACHERS))
        for name in self.calibrated_commands:
            require(name in CALIBRATED_COMMANDS, "calibrated_commands", name, ", ".join(CALIBRATED_COMMANDS))
        fractions = self.env.command.fractions()
        for gait, fraction in fractions.items():
            if fraction > 0.0 and getattr(self, gait) is None:
                raise ConfigError(
                    f"{gait} is {fraction:.2f} of the commands and has no teacher; give --{gait} SNAPSHOT, or set "
                    "its share to 0 (--env.command.*-fraction)"
                )

    def teachers(self) -> dict[str, pathlib.Path]:
        """Return the paths of the given teachers by name, in the order of `TEACHERS`."""
        return {name: getattr(self, name) for name in TEACHERS if getattr(self, name) is not None}
