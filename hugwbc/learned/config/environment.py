"""Settings of the training environment: commands, curricula, ground, rewards, physics."""

import dataclasses
import math
import pathlib
from collections.abc import Callable
from typing import Annotated, Any, Literal

import numpy as np
import tyro

from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.learned import ACTION_SCALE, WAIST_RATE
from hugwbc.learned.config.checks import require, require_finite
from hugwbc.learned.config.robot_settings import ArmServoGains, LoadConfig, RandomizationConfig
from hugwbc.learned.config.schedules import value_of
from hugwbc.learned.policy.terms import further_terms
from hugwbc.robot import Robot, load_robot
from hugwbc.settings import settings


@settings
class CommandConfig:
    """How training draws commands. Gaits are drawn in the fractions below; the rest is jumping."""

    standing_fraction: float = 0.2
    """Fraction of the commands that are for standing."""
    walking_fraction: float = 0.55
    """Fraction of the commands that are for walking."""
    hopping_fraction: float = 0.0
    """Fraction of the commands that are for one-leg hopping, half on each leg. The paper trains it alone: standing 0.1,
    walking 0, hopping 0.9."""
    default_fraction: float = 0.5
    """Probability that f, l, h, p or w, each by itself, is at its default instead of drawn from its range."""
    zero_velocity_fraction: float = 0.1
    """Probability of stepping in place."""
    resample_steps: int = 300
    """Control steps after which a new command is drawn."""

    def __post_init__(self) -> None:
        """Check the fractions."""
        gaits = ("standing_fraction", "walking_fraction", "hopping_fraction")
        for name in (*gaits, "default_fraction", "zero_velocity_fraction"):
            value = getattr(self, name)
            require(0.0 <= value <= 1.0, f"command.{name}", value, "0 to 1")
        total = sum(getattr(self, name) for name in gaits)
        # Decimal fractions that sum to 1 may exceed it by rounding.
        require(total <= 1.0 + 1e-9, " + ".join(f"command.{name}" for name in gaits), total, "at most 1")
        require(self.resample_steps > 0, "command.resample_steps", self.resample_steps, "a positive integer")

    def fractions(self) -> dict[str, float]:
        """Return the fraction of the commands of each gait; jumping is the rest."""
        given = {"standing": self.standing_fraction, "walking": self.walking_fraction, "hopping": self.hopping_fraction}
        rest = 1.0 - sum(given.values())
        return given | {"jumping": rest if rest > 1e-9 else 0.0}


@settings
class CurriculumConfig:
    """Curricula of penalty scale, arm noise and speed; gates compare tracking rewards relative to their maxima.

    They move after every so many environment steps, called an iteration here, whatever the length of the learner's own.
    """

    steps: int = 24_576
    """Environment steps between two moves: 24 control steps of 1,024 robots."""
    warm_up_iterations: int = 120
    """Number of iterations before any of the three moves."""
    penalty_start: float = 0.2
    """Initial factor on the regularisation rewards."""
    penalty_growth: float = 1.002
    """Factor on the penalty scale per iteration, up to 1."""
    linear_threshold: float = 0.7
    angular_threshold: float = 0.5
    """Relative linear and angular tracking rewards of robots that move under intervention above which the noise level
    alpha rises; it falls below two thirds of either."""
    alpha_step: float = 0.01
    """Change of the noise level per decision (the paper's)."""
    alpha_interval: int = 3
    """Iterations between two decisions on alpha, so that the averages reflect the new level."""
    speed_threshold: float = 0.7
    """Relative linear tracking reward of moving robots of the agile group above which its speed grows."""
    speed_step: float = 0.02
    """Growth of the largest forward speed of the agile group per decision [m/s]."""
    speed_interval: int = 20
    """Iterations between two decisions on the speed."""
    agile_fraction: float = 0.5
    """Fraction of the robots that are in the agile group, which has higher speeds and no intervention."""
    rules: Annotated[dict[str, Callable[..., float]], tyro.conf.Suppress] = dataclasses.field(default_factory=dict)
    """Functions of a setting's present value and the `Curriculum`, which return its new value after each iteration, by
    the name of the setting, such as loads.payload; for settings written in Python."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_finite(self, "curriculum.")
        for name in ("steps", "alpha_interval", "speed_interval"):
            value = getattr(self, name)
            require(value > 0, f"curriculum.{name}", value, "a positive integer")
        for name in ("penalty_start", "penalty_growth"):
            value = getattr(self, name)
            require(value > 0.0, f"curriculum.{name}", value, "a positive number")
        for name in ("warm_up_iterations", "alpha_step", "speed_step"):
            value = getattr(self, name)
            require(value >= 0, f"curriculum.{name}", value, "0 or more")
        require(0.0 <= self.agile_fraction <= 1.0, "curriculum.agile_fraction", self.agile_fraction, "0 to 1")


@settings
class TerrainConfig:
    """Rough ground of several levels; each robot has its own level. Without roughness the ground is a plane."""

    roughness: float = 0.0
    """Half-width of the uniformly random heights of the highest level [m]; 0 for a plane. The paper: 0.02."""
    levels: int = 10
    """From a plane to the roughness, in equal steps."""
    start_level: int = 0
    """Highest level on which robots start; they are spread evenly over the levels from 0 up to it."""
    threshold: float = 0.7
    """Relative linear tracking reward from which a robot that did not fall moves one level up; a fall moves it down."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_finite(self, "terrain.")
        require(0.0 <= self.roughness < 1.0, "terrain.roughness", self.roughness, "0 to 1 m")
        require(self.levels >= 2, "terrain.levels", self.levels, "at least 2")
        require(0 <= self.start_level < self.levels, "terrain.start_level", self.start_level, "0 to levels - 1")


@settings
class RewardWeights:
    """Weights of the paper's reward table, one per row. Every reward is multiplied by the control period."""

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
        require_finite(self, "rewards.")
        for name in ("linear_velocity_tracking", "angular_velocity_tracking"):
            value = getattr(self, name)
            require(value > 0.0, f"rewards.{name}", value, "above 0: the curricula compare the reward with its maximum")


@settings
class ExtraWeights:
    """Weights of terms that the paper's table lacks; 0 switches a term off. The reasons are in docs/learned.md."""

    alive: float = 4.0
    """Constant reward while the robot is up. It keeps early returns positive, so that falling never pays."""
    body_roll_tracking: float = -10.0
    """Squared roll, which the authors' code has inside its pitch term."""
    joint_limits: float = -5.0
    """Angle of legs and waist beyond 95 % of the joint range [rad]."""
    linear_velocity_precision: float = 2.0
    """exp(-|e| / 0.25) of the horizontal velocity. It keeps a slope near zero error, where the paper's squared
    exponential is flat and small commands would be ignored."""
    linear_velocity_error: float = 0.0
    """Squared error of the horizontal velocity, up to 1 (m/s)^2. Its slope does not vanish at large errors, where both
    exponentials are flat; hopping, which falls by drifting away, needs it (-6)."""
    yaw_rate_precision: float = 1.0
    """exp(-|e| / 0.25) of the yaw rate, for the same reason as the precision of the linear velocity."""
    yaw_rate_error: float = -1.0
    """Squared error of the yaw rate, up to 4 (rad/s)^2. Its slope does not vanish under the oscillation of the stride
    and the exploration noise, which flatten the exponentials."""
    posture_precision: float = 3.0
    """Mean of exp(-|e| / 0.1) over h, p and w. With the squared errors alone, offsets of 0.1 m and 0.1 rad remained:
    compared with the velocities they cost almost nothing."""
    swing_precision: float = 2.0
    """exp(-|e| / 0.05) of the clearance of each swing foot, for the same reason."""
    velocity_bias: float = -5.0
    """Length of the error of v_x and v_y, filtered over half a second, up to 0.5 m/s. A steady error is small against
    the oscillation of a stride and hides in it: the first shipped policy walked 9 % too fast."""
    yaw_rate_bias: float = -2.0
    """Error of the yaw rate, filtered likewise, up to 1 rad/s."""
    foot_impact: float = -10.0
    """Squared excess of a sole's speed of descent over 0.3 m/s, one control step before it touches the ground, up to
    4 (m/s)^2; not in jumps and hops, which it keeps on the ground. Without it soles met the ground at up to 3 m/s."""
    contact_mismatch: float = -2.0
    """sum_i |C_i - c_i|, with c_i whether foot i is on the ground; not in standing."""
    flight_contact: float = -3.0
    """sum_i (1 - C_i) c_i in jumping and hopping. A hop at twice the clock's frequency, which is easier, touches the
    ground in every flight; with the paper's term alone it cost 0.8 a second of 9."""
    bounce_tracking: float = 0.0
    """exp(-e^2 / 0.2) of the pelvis' vertical speed against that of a flight by the clock, in jumping.
    Without it the policy bobs to the clock instead of jumping."""
    bounce_error: float = 0.0
    """Square of that error, up to 2 (m/s)^2, which has a slope where the exponential is flat."""
    unequal_support: float = -3.0
    """1 while a single foot carries the robot although both feet move in phase (standing, jumping). Without it the
    policy ran at twice the frequency instead of jumping."""

    def __post_init__(self) -> None:
        """Check the weights."""
        require_finite(self, "extra.")


@settings
class RewardTerm:
    """A reward: a function of a control step, as in `hugwbc.learned.env.rewards`, and its weight."""

    function: Callable[..., Any]
    """Maps a `Transition` and a `Body` to one number per robot, shape (n,)."""
    weight: float
    """Factor on it, besides the control period."""
    penalty: bool = False
    """Whether the curriculum of penalties scales it."""


@settings
class EnvConfig:
    """The training environment."""

    count: int = 512
    """Robots simulated at once."""
    robot: str = "h1"
    """Robot of models/h1/h1.yaml: h1 (59.3 kg), or h1-2023, the maker's earlier description (51.65 kg)."""
    drives: Literal["real", "ideal"] = "real"
    """Drives of the joints: real (torque-speed limit and friction; their delay is part of the latency), or ideal. A GPU
    has no torque-speed limit and needs ideal ones."""
    ground: Literal["firm", "soft"] = "firm"
    """Firmness of the ground. At a time step of 5 ms, firm ground is softened to what that step allows."""
    timestep: float = 0.005
    """Physics time step [s]."""
    substeps: int = 4
    """Physics steps in a control step."""
    episode_steps: int = 1000
    """Control steps after which an episode ends."""
    action_scale: float = ACTION_SCALE
    """Radians of joint target per unit of action."""
    yaw_action_factor: float = 0.4
    """Factor on the action scale of hip yaw and waist. These joints are stiff and the yaw inertia is small: at the
    common scale, their exploration noise hides the yaw rate from the reward. 1 gives the paper's."""
    yaw_damping_factor: float = 3.0
    """Factor on the damping of hip yaw and waist. With the paper's gains (1) they resonate near 2 Hz, the frequency of
    the stride."""
    starts: pathlib.Path | None = None
    """File of recorded motion in which a share of the episodes starts, instead of from a stand; a recipe's stage that
    records writes one as starts.safetensors."""
    starts_share: float = 0.7
    """Share of the episodes that start in recorded motion, among those whose gait was recorded."""
    held_foot_grace: float = 0.0
    """Time after a new command in which a hopping robot must lift its held foot [s]. From then on, and at once in an
    episode that starts in mid-hop, more than a brief touch of the ground ends the episode. 0 switches the rule off."""
    waist_rate: float = WAIST_RATE
    """Speed at which the waist's joint target follows the commanded w [rad/s]; the action is added to it. With 0 the
    action alone moves the waist, as in the paper."""
    squat_gain: float = 0.0
    """Share of the commanded height and pitch that the legs' joint targets follow by themselves
    (`hugwbc.learned.policy.leg_feed_forward`); the action is added. With 0 the action alone moves the legs, as in the
    paper."""
    swing_gain: float = 0.0
    """Share of the clock's swing, up to the commanded height l, by which the legs' joint targets lift the feet; the
    action is added. With 0 the action alone lifts them, as in the paper."""
    intervention: Literal["noise", "motion", "none"] = "noise"
    """What takes over the arms: the paper's noise, motions, or nothing."""
    motions: pathlib.Path | None = None
    """Folder of motion files (.npz) for the motion intervention; motions are generated if it is not given."""
    flip_probability: float = 0.005
    """Probability per control step that the intervention indicator I(t) flips."""
    noise_interval: int = 90
    """Control steps between two draws of the arm noise."""
    observations: tuple[str, ...] = ()
    """Observation terms (`hugwbc.learned.policy.terms.TERMS`) that the policy reads besides the paper's, by name;
    docs/how-to/add-an-observation.md."""
    command: CommandConfig = dataclasses.field(default_factory=CommandConfig)
    randomization: RandomizationConfig = dataclasses.field(default_factory=RandomizationConfig)
    rewards: RewardWeights = dataclasses.field(default_factory=RewardWeights)
    extra: ExtraWeights = dataclasses.field(default_factory=ExtraWeights)
    terms: Annotated[dict[str, RewardTerm], tyro.conf.Suppress] = dataclasses.field(default_factory=dict)
    """Further rewards by name, for settings written in Python."""
    loads: LoadConfig = dataclasses.field(default_factory=LoadConfig)
    arm_servo: ArmServoGains = dataclasses.field(default_factory=ArmServoGains)
    curriculum: CurriculumConfig = dataclasses.field(default_factory=CurriculumConfig)
    terrain: TerrainConfig = dataclasses.field(default_factory=TerrainConfig)

    def __post_init__(self) -> None:
        """Check the sizes and the robot's name."""
        load_robot(self.robot)
        further_terms(self.observations)
        require(0.0 < self.timestep <= 0.01, "env.timestep", self.timestep, "above 0, up to 0.01 s")
        for name in ("count", "substeps", "episode_steps", "noise_interval"):
            value = getattr(self, name)
            require(value > 0, f"env.{name}", value, "a positive integer")
        require(0.0 < self.action_scale < math.inf, "env.action_scale", self.action_scale, "a positive number")
        for name in ("yaw_action_factor", "yaw_damping_factor"):
            value = getattr(self, name)
            require(0.0 < value < math.inf, f"env.{name}", value, "a positive number")
        require(0.0 <= self.waist_rate < math.inf, "env.waist_rate", self.waist_rate, "0 or a positive number")
        for name in ("squat_gain", "swing_gain", "starts_share"):
            require(0.0 <= getattr(self, name) <= 1.0, f"env.{name}", getattr(self, name), "0 to 1")
        require(0.0 <= self.held_foot_grace < math.inf, "env.held_foot_grace", self.held_foot_grace, "0 or a time")
        require(0.0 <= self.flip_probability <= 1.0, "env.flip_probability", self.flip_probability, "0 to 1")
        for name in self.terms:
            if hasattr(self.rewards, name) or hasattr(self.extra, name):
                raise ConfigError(f"reward '{name}' exists; give another name", at=("terms", name))
        for name in self.curriculum.rules:
            if name.partition(".")[0] not in ADOPTED:
                raise UnknownNameError("setting for a curriculum", name, ADOPTED, at=("curriculum", "rules"))
            value_of(self, name)
        unused = self.motions is not None and self.intervention != "motion"
        require(not unused, "env.motions", self.motions, "none without env.intervention motion")

    @property
    def period(self) -> float:
        """Control period [s]."""
        return self.timestep * self.substeps

    def action_scales(self, robot: Robot) -> np.ndarray:
        """Return the radians of joint target per unit of action, shape (19,)."""
        return self._with_yaw(np.full(len(robot.joint_names), self.action_scale), self.yaw_action_factor, robot)

    def damping(self, robot: Robot) -> np.ndarray:
        """Return the damping of the joints' PD [N*m*s/rad], shape (19,)."""
        return self._with_yaw(robot.kd, self.yaw_damping_factor, robot)

    @staticmethod
    def _with_yaw(values: np.ndarray, factor: float, robot: Robot) -> np.ndarray:
        scaled = values.copy()
        scaled[robot.yaw_joints] *= factor
        return scaled


# What an environment can take over while its robots go on.
ADOPTED = ("command", "rewards", "extra", "loads", "curriculum", "squat_gain", "swing_gain", "starts_share")


def same_robots(one: EnvConfig, other: EnvConfig) -> bool:
    """Return whether the robots of one environment can go on in the other; otherwise they must be built anew."""
    kept = [field.name for field in dataclasses.fields(one) if field.name not in ADOPTED]
    hops = (one.command.hopping_fraction > 0.0) == (other.command.hopping_fraction > 0.0)
    return hops and all(getattr(one, name) == getattr(other, name) for name in kept)
