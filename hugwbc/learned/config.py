"""Every number of the training, each with its meaning; all of them are flags of `hugwbc train`."""

import dataclasses
import math
import pathlib
from typing import Literal

import numpy as np

from hugwbc.errors import ConfigError
from hugwbc.learned.contract import ACTION_SCALE, WAIST_RATE
from hugwbc.robot import Robot


def _require(condition: bool, name: str, value: object, valid: str) -> None:
    if not condition:
        raise ConfigError(f"{name} = {value}; valid: {valid}. Change the flag or the field of that name")


def _require_finite(settings: object, prefix: str = "") -> None:
    """Refuse NaN and infinity in any number of a dataclass; they would show hours later, if at all."""
    for name, value in vars(settings).items():
        numbers = [number for number in (value if isinstance(value, tuple) else (value,)) if isinstance(number, float)]
        _require(all(map(math.isfinite, numbers)), f"{prefix}{name}", value, "finite")


def _require_seed(seed: int) -> None:
    _require(0 <= seed < 2**63, "seed", seed, "0 or more, below 2^63")


@dataclasses.dataclass(frozen=True)
class RewardWeights:
    """Weights of the paper's reward table, one per row; each is multiplied by the control period."""

    linear_velocity_tracking: float = 2.0
    angular_velocity_tracking: float = 2.0
    body_height_tracking: float = -40.0
    body_pitch_tracking: float = -10.0
    waist_yaw_tracking: float = -2.0
    foot_swing_tracking: float = -30.0
    contact_swing_tracking: float = -2.0
    roll_pitch_angular_velocity: float = -0.5
    vertical_body_movement: float = -0.1
    feet_slip: float = -0.2
    action_rate: float = -0.01
    action_smoothness: float = -0.01
    joint_torque: float = -5e-6
    joint_acceleration: float = -2.5e-7
    upper_joint_deviation: float = -0.5
    hip_joint_deviation: float = -2.0
    feet_symmetry: float = -5.0
    termination: float = -200.0

    def __post_init__(self) -> None:
        """Check the weights."""
        _require_finite(self, "rewards.")
        for name in ("linear_velocity_tracking", "angular_velocity_tracking"):
            value = getattr(self, name)
            _require(value > 0.0, f"rewards.{name}", value, "above 0: the curricula compare the reward to its maximum")


@dataclasses.dataclass(frozen=True)
class ExtraWeights:
    """Weights of terms that the paper's table lacks; zero switches a term off. Reasons in docs/learned.md."""

    alive: float = 2.0
    """Constant while not terminated; keeps early returns positive, so that falling never pays."""
    body_roll_tracking: float = -10.0
    """Squared roll; the authors' code has it inside their pitch term."""
    joint_limits: float = -5.0
    """Radians of the legs and waist beyond 95 % of the joint range."""
    linear_velocity_precision: float = 2.0
    """exp(-|e| / 0.25) on the horizontal velocity: keeps a slope near zero error, where the squared exponential is
    flat, so that small commands are not ignored."""
    yaw_rate_precision: float = 1.0
    """The same on the yaw rate."""
    yaw_rate_error: float = -1.0
    """Squared error of the yaw rate, up to 4 (rad/s)^2: its slope does not vanish under the oscillation and the
    exploration noise that flatten the exponentials."""
    posture_precision: float = 3.0
    """Mean of exp(-|e| / 0.1) over h, p and w: the squared errors alone left offsets of a decimetre and of 0.1 rad,
    which cost next to nothing beside the velocities."""
    swing_precision: float = 1.0
    """exp(-|e| / 0.05) on the clearance of each foot in its swing, for the same reason."""
    unequal_support: float = -3.0
    """1 while one foot alone carries the robot although both move in phase (standing, jumping): without it the policy
    ran at twice the frequency instead of jumping."""

    def __post_init__(self) -> None:
        """Check the weights."""
        _require_finite(self, "extra.")


@dataclasses.dataclass(frozen=True)
class CommandConfig:
    """How commands are drawn in training. Gaits: the fractions below; what they leave is jumping."""

    standing_fraction: float = 0.2
    walking_fraction: float = 0.55
    hopping_fraction: float = 0.0
    """One-leg hopping, half on either leg. The paper trains it alone: standing 0.1, walking 0, hopping 0.9."""
    default_fraction: float = 0.4
    """Probability, for each of f, l, h, p, w, to be at its default instead of drawn from its range."""
    zero_velocity_fraction: float = 0.1
    """Probability of stepping in place."""
    resample_steps: int = 500
    """Control steps after which a new command is drawn."""

    def __post_init__(self) -> None:
        """Check the fractions."""
        gaits = ("standing_fraction", "walking_fraction", "hopping_fraction")
        for name in (*gaits, "default_fraction", "zero_velocity_fraction"):
            value = getattr(self, name)
            _require(0.0 <= value <= 1.0, f"command.{name}", value, "0 to 1")
        total = sum(getattr(self, name) for name in gaits)
        # Decimal fractions that make up 1 may add up to a little more.
        _require(total <= 1.0 + 1e-9, " + ".join(f"command.{name}" for name in gaits), total, "at most 1")
        _require(self.resample_steps > 0, "command.resample_steps", self.resample_steps, "a positive integer")

    def fractions(self) -> dict[str, float]:
        """Part of the commands of each gait; jumping is what the others leave."""
        given = {"standing": self.standing_fraction, "walking": self.walking_fraction, "hopping": self.hopping_fraction}
        rest = 1.0 - sum(given.values())
        return given | {"jumping": rest if rest > 1e-9 else 0.0}


@dataclasses.dataclass(frozen=True)
class RandomizationConfig:
    """Per-robot model parameters, drawn once, and disturbances. Ranges of factors are relative to the table's value."""

    friction: tuple[float, float] = (0.4, 1.5)
    """Sliding friction of the robot's shapes."""
    torso_mass: tuple[float, float] = (-2.0, 4.0)
    """Added to the torso, which has 18 [kg]."""
    torso_centre: float = 0.03
    """Half-width of the shift of the torso's centre of mass along each axis [m]."""
    gains: tuple[float, float] = (0.9, 1.1)
    """Factor on each joint's stiffness and, independently, damping."""
    link_mass: tuple[float, float] = (1.0, 1.0)
    """Factor on the mass and inertia of each link (the authors: 0.8 to 1.2)."""
    link_centre: float = 0.0
    """Half-width of the shift of each link's centre of mass along each axis [m] (the authors: 0.01)."""
    strength: tuple[float, float] = (1.0, 1.0)
    """Factor on the torque that each joint gives, before its limit (the authors: 0.8 to 1.2)."""
    offset: float = 0.0
    """Half-width of the error of each joint's position target [rad] (the authors: 0.02)."""
    latency: tuple[float, float] = (0.0, 0.0)
    """Time from an action to its effect [s], one for each robot, in physics steps (the authors: 0 to 0.02, of the
    observations). Above 0 it costs about a fifth of the speed."""
    push_velocity: float = 0.5
    """Half-width of a push: change of the horizontal pelvis velocity [m/s]."""
    push_interval: int = 400
    """Mean control steps between two pushes of a robot."""
    noise: float = 0.2
    """Scale of the observation noise; 1 is the paper's (angular velocity 0.2, gravity 0.05, q 0.01, dq 1.5)."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name in ("friction", "gains", "link_mass", "strength", "latency"):
            low, high = getattr(self, name)
            least = "at least 0" if name == "latency" else "above 0"
            valid = low >= 0.0 if name == "latency" else low > 0.0
            _require(valid and low <= high < math.inf, f"randomization.{name}", (low, high), f"low and high, {least}")
        low, high = self.torso_mass
        _require(-10.0 <= low <= high < math.inf, "randomization.torso_mass", (low, high), "low and high, at least -10")
        for name in ("torso_centre", "push_velocity", "noise", "link_centre", "offset"):
            value = getattr(self, name)
            _require(0.0 <= value < math.inf, f"randomization.{name}", value, "0 or a positive number")
        _require(self.push_interval >= 1, "randomization.push_interval", self.push_interval, "at least 1")


@dataclasses.dataclass(frozen=True)
class CurriculumConfig:
    """Penalty scale, external arm noise and speed; each gate compares tracking rewards relative to their maximum."""

    warm_up_iterations: int = 300
    """Iterations before any of the three moves."""
    penalty_start: float = 0.2
    """Initial factor on the regularisation rewards."""
    penalty_growth: float = 1.001
    """Factor on the penalty scale per iteration, up to 1."""
    linear_threshold: float = 0.8
    angular_threshold: float = 0.6
    """Relative tracking rewards that let the noise level alpha rise; below two thirds of either it falls."""
    alpha_step: float = 0.01
    """Change of the noise level (the paper's)."""
    alpha_interval: int = 3
    """Iterations between two decisions on alpha, so that the averages reflect the level."""
    speed: Literal["range", "grid"] = "range"
    """How the speeds of the agile group grow: one range for all, or the paper's grid-adaptive rule, which opens each
    cell of the (v_x, omega) plane when its neighbours are tracked well."""
    speed_angular_threshold: float = 0.4
    """Relative angular tracking reward that a cell of the grid needs beside the linear one."""
    speed_threshold: float = 0.75
    """Relative linear tracking reward that lets the speed of the agile group grow."""
    speed_step: float = 0.02
    """Growth of the largest forward speed of the agile group [m/s]."""
    speed_interval: int = 20
    """Iterations between two decisions on the speed."""
    agile_fraction: float = 0.5
    """Fraction of robots in the agile group: higher speeds, no intervention."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        _require_finite(self, "curriculum.")
        for name in ("alpha_interval", "speed_interval"):
            value = getattr(self, name)
            _require(value > 0, f"curriculum.{name}", value, "a positive integer")
        for name in ("penalty_start", "penalty_growth"):
            value = getattr(self, name)
            _require(value > 0.0, f"curriculum.{name}", value, "a positive number")
        for name in ("warm_up_iterations", "alpha_step", "speed_step"):
            value = getattr(self, name)
            _require(value >= 0, f"curriculum.{name}", value, "0 or more")
        _require(0.0 <= self.agile_fraction <= 1.0, "curriculum.agile_fraction", self.agile_fraction, "0 to 1")


@dataclasses.dataclass(frozen=True)
class TerrainConfig:
    """Rough ground with levels; each robot has its own. Without roughness the ground is a plane."""

    roughness: float = 0.0
    """Half-width of the uniformly random heights of the highest level [m]; 0 for a plane. The paper: 0.02."""
    levels: int = 10
    """From a plane to the roughness, in equal steps."""
    start_level: int = 0
    """Highest level on which robots start at first, evenly from 0 on."""
    threshold: float = 0.7
    """Relative linear tracking reward from which a robot that stayed up moves to the next level; a fall moves back."""
    mastered: float = 0.0
    """Mean level, as a part of the highest, below which noise and speed wait; the paper lets them wait until the
    hardest ground is mastered. 0 moves all curricula at once."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        _require_finite(self, "terrain.")
        _require(0.0 <= self.roughness < 1.0, "terrain.roughness", self.roughness, "0 to 1 m")
        _require(self.levels >= 2, "terrain.levels", self.levels, "at least 2")
        _require(0 <= self.start_level < self.levels, "terrain.start_level", self.start_level, "0 to levels - 1")
        _require(0.0 <= self.mastered <= 1.0, "terrain.mastered", self.mastered, "0 to 1")


@dataclasses.dataclass(frozen=True)
class EnvConfig:
    """The training environment."""

    count: int = 1024
    """Robots simulated at once."""
    substeps: int = 4
    """Physics steps of 5 ms in a control step."""
    episode_steps: int = 1000
    action_scale: float = ACTION_SCALE
    """Radians of joint target per unit of action."""
    yaw_action_factor: float = 0.4
    """Factor on that of hip yaw and waist: stiff joints on a small yaw inertia, where the exploration noise of the
    other joints' scale drowns the yaw rate that the reward is to see."""
    yaw_damping_factor: float = 3.0
    """Factor on the damping of hip yaw and waist, which with the paper's gains resonate near 2 Hz, the stride's
    frequency. 1 for the paper's gains."""
    one_leg_start: float = 0.0
    """Part of the hopping episodes that start on one leg, the other folded, instead of on both."""
    held_foot_grace: float = 0.0
    """Time after a command's start from which the held foot of a hop on the ground ends the episode [s]; 0 never."""
    waist_rate: float = WAIST_RATE
    """Speed at which the waist's joint target follows the commanded w [rad/s]; the action is added to it. 0 leaves the
    waist to the action alone, as in the paper."""
    intervention: Literal["noise", "motion", "none"] = "noise"
    """What takes over the arms: the paper's noise, motion files, or nothing."""
    motions: pathlib.Path | None = None
    """Folder of motion files (.npz) for the motion intervention; without one, generated motions."""
    flip_probability: float = 0.005
    """Probability per step that the intervention indicator flips."""
    noise_interval: int = 90
    """Control steps between two draws of the intervention's arm targets."""
    command: CommandConfig = dataclasses.field(default_factory=CommandConfig)
    randomization: RandomizationConfig = dataclasses.field(default_factory=RandomizationConfig)
    rewards: RewardWeights = dataclasses.field(default_factory=RewardWeights)
    extra: ExtraWeights = dataclasses.field(default_factory=ExtraWeights)
    curriculum: CurriculumConfig = dataclasses.field(default_factory=CurriculumConfig)
    terrain: TerrainConfig = dataclasses.field(default_factory=TerrainConfig)

    def __post_init__(self) -> None:
        """Check the sizes."""
        for name in ("count", "substeps", "episode_steps", "noise_interval"):
            value = getattr(self, name)
            _require(value > 0, f"env.{name}", value, "a positive integer")
        _require(0.0 < self.action_scale < math.inf, "env.action_scale", self.action_scale, "a positive number")
        for name in ("yaw_action_factor", "yaw_damping_factor"):
            value = getattr(self, name)
            _require(0.0 < value < math.inf, f"env.{name}", value, "a positive number")
        _require(0.0 <= self.waist_rate < math.inf, "env.waist_rate", self.waist_rate, "0 or a positive number")
        _require(0.0 <= self.one_leg_start <= 1.0, "env.one_leg_start", self.one_leg_start, "0 to 1")
        _require(0.0 <= self.held_foot_grace < math.inf, "env.held_foot_grace", self.held_foot_grace, "0 or a time")
        _require(0.0 <= self.flip_probability <= 1.0, "env.flip_probability", self.flip_probability, "0 to 1")
        unused = self.motions is not None and self.intervention != "motion"
        _require(not unused, "env.motions", self.motions, "none without env.intervention motion")

    def action_scales(self, robot: Robot) -> np.ndarray:
        """Radians of joint target per unit of action, shape (19,)."""
        return self._with_yaw(np.full(len(robot.joint_names), self.action_scale), self.yaw_action_factor, robot)

    def damping(self, robot: Robot) -> np.ndarray:
        """Damping of the joints' PD [N*m*s/rad], shape (19,)."""
        return self._with_yaw(robot.kd, self.yaw_damping_factor, robot)

    @staticmethod
    def _with_yaw(values: np.ndarray, factor: float, robot: Robot) -> np.ndarray:
        scaled = values.copy()
        scaled[robot.yaw_joints] *= factor
        return scaled


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
        _require_finite(self, "ppo.")
        for name in ("horizon", "epochs", "minibatches"):
            _require(getattr(self, name) > 0, f"ppo.{name}", getattr(self, name), "a positive integer")
        for name in ("gamma", "lam", "clip"):
            _require(0.0 < getattr(self, name) <= 1.0, f"ppo.{name}", getattr(self, name), "above 0, up to 1")
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
            _require(value > 0.0, f"ppo.{name}", value, "a positive number")
        for name in ("policy_weight", "estimation_weight", "beta", "entropy_weight"):
            value = getattr(self, name)
            _require(value >= 0.0, f"ppo.{name}", value, "0 or a positive number")
        low, high = self.learning_rate_range
        _require(0.0 < low <= high, "ppo.learning_rate_range", (low, high), "low and high, above 0")


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
        _require_seed(self.seed)
        _require(self.steps > 0, "steps", self.steps, "a positive number")
        _require(self.hours > 0, "hours", self.hours, "a positive number")
        _require(self.threads > 0, "threads", self.threads, "a positive integer")
        _require(self.critic_warm_up >= 0, "critic_warm_up", self.critic_warm_up, "0 or more")
        _require(self.save_interval > 0, "save_interval", self.save_interval, "a positive integer")
        _require(self.evaluation_interval >= 0, "evaluation_interval", self.evaluation_interval, "0 or more")
        _require(self.evaluation_robots > 0, "evaluation_robots", self.evaluation_robots, "a positive integer")
        seconds = self.evaluation_seconds
        _require(0.0 < seconds < math.inf, "evaluation_seconds", seconds, "a positive number")


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
    std: float = 0.12
    """Exploration std that the snapshot starts reinforcement learning with."""
    env: EnvConfig = dataclasses.field(default_factory=_imitation_env)

    def __post_init__(self) -> None:
        """Check the ranges."""
        _require_seed(self.seed)
        for name in ("samples", "handover", "learning_rate", "std", "max_speed"):
            value = getattr(self, name)
            _require(0.0 < value < math.inf, name, value, "a positive number")
        for name in ("threads", "batch", "updates"):
            _require(getattr(self, name) > 0, name, getattr(self, name), "a positive integer")
        for name in ("least_taught", "noise_level"):
            _require(0.0 <= getattr(self, name) <= 1.0, name, getattr(self, name), "0 to 1")
        for name in ("exploration", "upper_weight", "estimation_weight"):
            _require(0.0 <= getattr(self, name) < math.inf, name, getattr(self, name), "0 or a positive number")


CALIBRATED_COMMANDS = ("v_x", "v_y", "omega", "h", "p", "w", "l")  # all whose execution is measured
TEACHERS = ("standing", "catching", "walking", "jumping", "hopping")  # in the order in which they are asked


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
        _require_seed(self.seed)
        for name in ("samples", "learning_rate", "max_speed"):
            value = getattr(self, name)
            _require(0.0 < value < math.inf, name, value, "a positive number")
        for name in ("threads", "batch", "updates", "memory"):
            _require(getattr(self, name) > 0, name, getattr(self, name), "a positive integer")
        for name in ("noise_level", "calibration"):
            _require(0.0 <= getattr(self, name) <= 1.0, name, getattr(self, name), "0 to 1")
        for name in ("exploration", "estimation_weight"):
            _require(0.0 <= getattr(self, name) < math.inf, name, getattr(self, name), "0 or a positive number")
        for name in self.calibrated:
            _require(name in TEACHERS, "calibrated", name, ", ".join(TEACHERS))
        for name in self.calibrated_commands:
            _require(name in CALIBRATED_COMMANDS, "calibrated_commands", name, ", ".join(CALIBRATED_COMMANDS))
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
