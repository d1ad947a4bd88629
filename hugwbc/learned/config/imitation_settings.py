"""Settings of learning from teachers: imitation of a controller, and distillation of several policies into one."""

import dataclasses
import math
import pathlib

from hugwbc.errors import ConfigError
from hugwbc.learned.config.checks import require, require_seed, require_speed
from hugwbc.learned.config.environment import CommandConfig, EnvConfig

TEACHERS = ("standing", "catching", "walking", "jumping", "hopping")  # in the order in which they are asked
CALIBRATED_COMMANDS = ("v_x", "v_y", "omega", "h", "p", "w", "l")  # all whose execution is measured


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


def _distillation_env() -> EnvConfig:
    """Mixed often; falls have to be seen, so starts and pushes stay as in training."""
    command = CommandConfig(standing_fraction=0.4, walking_fraction=0.4, resample_steps=250)
    return EnvConfig(count=512, episode_steps=800, command=command)


@dataclasses.dataclass(frozen=True)
class DistillationConfig:
    """One network from several, each of which is the teacher of a gait. Paths are of snapshots or checkpoints."""

    out: pathlib.Path = pathlib.Path("runs/distilled")
    """Folder of the policy and of the snapshot from which `hugwbc train --start-from` goes on."""
    start_from: pathlib.Path | None = None
    """What the student starts as; its critic, its exploration std and its record are kept."""
    standing: pathlib.Path | None = None
    """Teacher of standing."""
    catching: pathlib.Path | None = None
    """Teacher of standing while the robot moves much; without one, that of standing."""
    walking: pathlib.Path | None = None
    """Teacher of walking."""
    jumping: pathlib.Path | None = None
    """Teacher of jumping."""
    hopping: pathlib.Path | None = None
    """Teacher of hopping on either leg."""
    samples: float = 2e6
    """Labels to collect."""
    memory: int = 400_000
    """How many of the newest labels are kept."""
    seed: int = 1
    threads: int = 1
    calibration: float = 0.2
    """Part of the labels during which the teachers drive and are calibrated; after it the student drives."""
    calibrated: tuple[str, ...] = ("standing", "catching", "walking")
    """Teachers to calibrate. One that falls often is better left as it is: asked for more, it falls more."""
    calibrated_commands: tuple[str, ...] = CALIBRATED_COMMANDS
    """Commands to calibrate. One that is executed well enough is better left as it is too."""
    exploration: float = 0.1
    """Std of the noise on all actions, so that states beside the path are labelled too."""
    noise_level: float = 0.5
    """The intervention's alpha."""
    max_speed: float = 1.4
    """Largest v_x of the agile group [m/s]."""
    learning_rate: float = 5e-4
    """At the start; falls to a twentieth."""
    batch: int = 2048
    updates: int = 6
    """Gradient steps after every 10 control steps."""
    estimation_weight: float = 0.2
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
                    f"{gait} makes {fraction:.2f} of the commands and has no teacher; give --{gait} SNAPSHOT, or draw "
                    f"none of it (--env.command.*-fraction)"
                )

    def teachers(self) -> dict[str, pathlib.Path]:
        """Paths by gait, and "catching" after standing."""
        return {name: getattr(self, name) for name in TEACHERS if getattr(self, name) is not None}
