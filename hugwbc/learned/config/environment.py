"""Settings of the training environment: commands, randomisation, curricula, ground, rewards, robots."""

import dataclasses
import math
import pathlib
from typing import Literal

import numpy as np

from hugwbc.learned import ACTION_SCALE, WAIST_RATE
from hugwbc.learned.config.checks import require, require_finite
from hugwbc.robot import Robot, load_robot

_FASTEST_HOP = 5.0  # [Hz], at which a control step is a tenth of a cycle


@dataclasses.dataclass(frozen=True)
class CommandConfig:
    """How training draws commands. Gaits are drawn in the fractions below; the rest is jumping."""

    standing_fraction: float = 0.2
    """Fraction of the commands that are for standing."""
    walking_fraction: float = 0.55
    """Fraction of the commands that are for walking."""
    hopping_fraction: float = 0.0
    """Fraction of the commands that are for one-leg hopping, half on each leg. The paper trains it alone: standing 0.1,
    walking 0, hopping 0.9."""
    hopping_frequency: tuple[float, float] = (2.0, 2.0)
    """Range of f while hopping [Hz]; a trained policy is asked for 2. Policies find a rhythm near 4 by themselves, so a
    training that starts there and lowers the range keeps them in step with the clock."""
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
        low, high = self.hopping_frequency
        require(
            0.0 < low <= high <= _FASTEST_HOP,
            "command.hopping_frequency",
            (low, high),
            f"0 < low <= high <= {_FASTEST_HOP:g}",
        )
        require(self.resample_steps > 0, "command.resample_steps", self.resample_steps, "a positive integer")

    def fractions(self) -> dict[str, float]:
        """Return the fraction of the commands of each gait; jumping is the rest."""
        given = {"standing": self.standing_fraction, "walking": self.walking_fraction, "hopping": self.hopping_fraction}
        rest = 1.0 - sum(given.values())
        return given | {"jumping": rest if rest > 1e-9 else 0.0}


@dataclasses.dataclass(frozen=True)
class RandomizationConfig:
    """Model parameters of each robot, drawn once, and disturbances. Factors multiply the nominal value."""

    friction: tuple[float, float] = (0.4, 1.5)
    """Sliding friction of the robot's geometry."""
    mass: tuple[float, float] = (0.84, 1.06)
    """Factor on the masses and inertias of all links together. From 59.3 kg it reaches the 51.65 kg of the earlier
    description with room below."""
    torso_mass: tuple[float, float] = (-1.0, 3.0)
    """Mass added to the torso, which has 18 kg [kg]."""
    torso_centre: float = 0.03
    """Half-width of the shift of the torso's centre of mass along each axis [m]."""
    gains: tuple[float, float] = (0.9, 1.1)
    """Factor on the stiffness of each joint and, independently, on its damping."""
    link_mass: tuple[float, float] = (0.9, 1.1)
    """Factor on the mass and inertia of each link by itself (the authors: 0.8 to 1.2)."""
    link_centre: float = 0.01
    """Half-width of the shift of each link's centre of mass along each axis [m] (the authors: 0.01)."""
    strength: tuple[float, float] = (0.9, 1.1)
    """Factor on the torque of each joint before its limit applies (the authors: 0.8 to 1.2)."""
    offset: float = 0.01
    """Half-width of the error of each joint's position target [rad] (the authors: 0.02)."""
    drive_friction: tuple[float, float] = (0.5, 1.5)
    """Factor on the Coulomb and viscous friction of each real drive."""
    latency: tuple[float, float] = (0.0, 0.02)
    """Time from an action to its effect [s], one value per robot, rounded to physics steps. It stands for the age of
    the readings, which is 10 ms in the arena, and for the delay of the drives, which is 2 ms."""
    push_velocity: float = 0.5
    """Half-width of a push, which changes the horizontal velocity of the pelvis [m/s]."""
    push_interval: int = 400
    """Mean number of control steps between two pushes of a robot."""
    noise: float = 0.0
    """Scale of the paper's observation noise; 1 is the paper's (angular velocity 0.2, gravity 0.05, q 0.01, dq 1.5)."""
    sensing: tuple[float, float] = (0.0, 1.5)
    """Factor on the sensor errors of the arena (`hugwbc.sim.sensors.ROBOT`: noise, biases and offsets of encoders,
    joint speeds, gyro and attitude), one value per robot; 0 for the true state."""

    @classmethod
    def off(cls, friction: float = 0.8) -> "RandomizationConfig":
        """Return settings under which all robots are as described, sense their true state and are never pushed.

        Args:
            friction: sliding friction of all robots.
        """
        one = (1.0, 1.0)
        none = (0.0, 0.0)
        return cls(
            friction=(friction, friction),
            mass=one,
            torso_mass=none,
            torso_centre=0.0,
            gains=one,
            link_mass=one,
            link_centre=0.0,
            strength=one,
            offset=0.0,
            drive_friction=one,
            latency=none,
            push_velocity=0.0,
            sensing=none,
        )

    def __post_init__(self) -> None:
        """Check the ranges."""
        may_vanish = ("latency", "drive_friction", "sensing")
        for name in ("friction", "gains", "mass", "link_mass", "strength", *may_vanish):
            low, high = getattr(self, name)
            least = "at least 0" if name in may_vanish else "above 0"
            valid = low >= 0.0 if name in may_vanish else low > 0.0
            require(valid and low <= high < math.inf, f"randomization.{name}", (low, high), f"low and high, {least}")
        low, high = self.torso_mass
        require(-10.0 <= low <= high < math.inf, "randomization.torso_mass", (low, high), "low and high, at least -10")
        for name in ("torso_centre", "push_velocity", "noise", "link_centre", "offset"):
            value = getattr(self, name)
            require(0.0 <= value < math.inf, f"randomization.{name}", value, "0 or a positive number")
        require(self.push_interval >= 1, "randomization.push_interval", self.push_interval, "at least 1")


@dataclasses.dataclass(frozen=True)
class LoadConfig:
    """What hands carry and what pulls and pushes the robot; the largest values, from which training draws downwards.

    Robots of the agile group and hopping ones carry nothing and are not pulled. A schedule makes a curriculum of it.
    """

    payload: float = 0.0
    """Largest mass in each hand [kg], drawn for each hand at the start of an episode."""
    hand_force: float = 0.0
    """Largest force on each hand, in any direction [N]. It acts on either or both hands and begins at once."""
    trunk_force: float = 0.0
    """Largest horizontal force on the trunk [N]."""
    loaded_share: float = 0.7
    """Share of the episodes with a payload."""
    hand_interval: float = 5.0
    """Mean time between the end of a force on the hands and the next one [s]."""
    hand_time: tuple[float, float] = (0.2, 5.0)
    """Shortest and longest time for which a force on the hands acts [s]."""
    trunk_interval: float = 8.0
    """Mean time between the end of a force on the trunk and the next one [s]."""
    trunk_time: tuple[float, float] = (0.2, 1.2)
    """Shortest and longest time for which a force on the trunk acts [s]."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_finite(self, "loads.")
        for name in ("payload", "hand_force", "trunk_force"):
            require(getattr(self, name) >= 0.0, f"loads.{name}", getattr(self, name), "0 or a positive number")
        for name in ("hand_interval", "trunk_interval"):
            require(getattr(self, name) > 0.0, f"loads.{name}", getattr(self, name), "a positive time")
        for name in ("hand_time", "trunk_time"):
            low, high = getattr(self, name)
            require(0.0 < low <= high, f"loads.{name}", (low, high), "shortest and longest, above 0")
        require(0.0 <= self.loaded_share <= 1.0, "loads.loaded_share", self.loaded_share, "0 to 1")


@dataclasses.dataclass(frozen=True)
class ArmServoGains:
    """Gains of the arms while they are under external control.

    They are those of the arm servo that moves them when a policy runs, whose stiffness the maker's teleoperation of the
    H1 has. Its feed-forward torque is left out: the sag without it is 2 degrees, and the pelvis bears the same weight.
    """

    stiffness: float = 140.0
    """Of every arm joint [N*m/rad]."""
    shoulder_damping: float = 10.0
    """Of shoulder pitch and roll [N*m*s/rad]."""
    distal_damping: float = 3.0
    """Of shoulder yaw and elbow [N*m*s/rad]."""

    def __post_init__(self) -> None:
        """Check the gains."""
        require_finite(self, "arm_servo.")
        for name, value in vars(self).items():
            require(value >= 0.0, f"arm_servo.{name}", value, "0 or a positive number")

    def of(self, robot: Robot) -> tuple[np.ndarray, np.ndarray]:
        """Return stiffness and damping of the arm joints of a robot, shape (8,) each."""
        distal = np.array([name.endswith(("shoulder_yaw_joint", "elbow_joint")) for name in robot.arm_names])
        stiffness = np.full(distal.shape, self.stiffness)
        return stiffness, np.where(distal, self.distal_damping, self.shoulder_damping)


@dataclasses.dataclass(frozen=True)
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
    speed: Literal["range", "grid"] = "range"
    """How the speeds of the agile group grow: as one range, or by the paper's grid-adaptive rule, which opens a cell of
    the (v_x, omega) plane when its neighbours are tracked well."""
    speed_angular_threshold: float = 0.4
    """Relative angular tracking reward that a command on the grid needs to pass, in addition to the linear one."""
    speed_threshold: float = 0.7
    """Relative linear tracking reward of moving robots of the agile group above which its speed grows."""
    speed_step: float = 0.02
    """Growth of the largest forward speed of the agile group per decision [m/s]."""
    speed_interval: int = 20
    """Iterations between two decisions on the speed."""
    agile_fraction: float = 0.5
    """Fraction of the robots that are in the agile group, which has higher speeds and no intervention."""

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


@dataclasses.dataclass(frozen=True)
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
    mastered: float = 0.0
    """Mean level, as a fraction of the highest, below which the curricula of noise and speed wait. The paper has them
    wait until the hardest ground is mastered; 0 moves all curricula at once."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_finite(self, "terrain.")
        require(0.0 <= self.roughness < 1.0, "terrain.roughness", self.roughness, "0 to 1 m")
        require(self.levels >= 2, "terrain.levels", self.levels, "at least 2")
        require(0 <= self.start_level < self.levels, "terrain.start_level", self.start_level, "0 to levels - 1")
        require(0.0 <= self.mastered <= 1.0, "terrain.mastered", self.mastered, "0 to 1")


@dataclasses.dataclass(frozen=True)
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


@dataclasses.dataclass(frozen=True)
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
    4 (m/s)^2. Without it soles met the ground at up to 3 m/s."""
    contact_mismatch: float = -2.0
    """sum_i |C_i - c_i|, with c_i whether foot i is on the ground; not in standing."""
    flight_contact: float = -3.0
    """sum_i (1 - C_i) c_i in jumping and hopping. A hop at twice the clock's frequency, which is easier, touches the
    ground in every flight; with the paper's term alone it cost 0.8 a second of 9."""
    unequal_support: float = -3.0
    """1 while a single foot carries the robot although both feet move in phase (standing, jumping). Without it the
    policy ran at twice the frequency instead of jumping."""

    def __post_init__(self) -> None:
        """Check the weights."""
        require_finite(self, "extra.")


@dataclasses.dataclass(frozen=True)
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
    """File of recorded motion in which a share of the episodes starts, instead of from a stand; `hugwbc imitate` writes
    one as starts.safetensors."""
    starts_share: float = 0.7
    """Share of the episodes that start in recorded motion, among those whose gait was recorded."""
    held_foot_grace: float = 0.0
    """Time after a new command in which a hopping robot must lift its held foot [s]. From then on, and at once in an
    episode that starts in mid-hop, more than a brief touch of the ground ends the episode. 0 switches the rule off."""
    waist_rate: float = WAIST_RATE
    """Speed at which the waist's joint target follows the commanded w [rad/s]; the action is added to it. With 0 the
    action alone moves the waist, as in the paper."""
    intervention: Literal["noise", "motion", "none"] = "noise"
    """What takes over the arms: the paper's noise, motions, or nothing."""
    motions: pathlib.Path | None = None
    """Folder of motion files (.npz) for the motion intervention; motions are generated if it is not given."""
    flip_probability: float = 0.005
    """Probability per control step that the intervention indicator I(t) flips."""
    noise_interval: int = 90
    """Control steps between two draws of the arm noise."""
    command: CommandConfig = dataclasses.field(default_factory=CommandConfig)
    randomization: RandomizationConfig = dataclasses.field(default_factory=RandomizationConfig)
    rewards: RewardWeights = dataclasses.field(default_factory=RewardWeights)
    extra: ExtraWeights = dataclasses.field(default_factory=ExtraWeights)
    loads: LoadConfig = dataclasses.field(default_factory=LoadConfig)
    arm_servo: ArmServoGains = dataclasses.field(default_factory=ArmServoGains)
    curriculum: CurriculumConfig = dataclasses.field(default_factory=CurriculumConfig)
    terrain: TerrainConfig = dataclasses.field(default_factory=TerrainConfig)

    def __post_init__(self) -> None:
        """Check the sizes and the robot's name."""
        load_robot(self.robot)
        require(0.0 < self.timestep <= 0.01, "env.timestep", self.timestep, "above 0, up to 0.01 s")
        for name in ("count", "substeps", "episode_steps", "noise_interval"):
            value = getattr(self, name)
            require(value > 0, f"env.{name}", value, "a positive integer")
        require(0.0 < self.action_scale < math.inf, "env.action_scale", self.action_scale, "a positive number")
        for name in ("yaw_action_factor", "yaw_damping_factor"):
            value = getattr(self, name)
            require(0.0 < value < math.inf, f"env.{name}", value, "a positive number")
        require(0.0 <= self.waist_rate < math.inf, "env.waist_rate", self.waist_rate, "0 or a positive number")
        require(0.0 <= self.starts_share <= 1.0, "env.starts_share", self.starts_share, "0 to 1")
        require(0.0 <= self.held_foot_grace < math.inf, "env.held_foot_grace", self.held_foot_grace, "0 or a time")
        require(0.0 <= self.flip_probability <= 1.0, "env.flip_probability", self.flip_probability, "0 to 1")
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
