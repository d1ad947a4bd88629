"""Settings of the training environment: commands, curricula, ground, rewards, physics."""

import dataclasses
import pathlib
from collections.abc import Callable
from typing import Annotated, Any, Literal

import numpy as np
import tyro
from pydantic import Field

from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.learned.config.robot_settings import LoadConfig, RandomizationConfig
from hugwbc.learned.config.schedules import value_of
from hugwbc.learned.policy.contract import Contract, History, Term
from hugwbc.learned.policy.terms import COMMAND_TERMS, FRAME_TERMS, HISTORY_FRAMES, TERMS, further_terms
from hugwbc.robot import Robot, RobotName, load_robot
from hugwbc.settings import Count, Gain, NotNegative, Positive, Share, settings


@settings
class CommandConfig:
    """How training draws commands.

    Each gait has its fraction of the time, however early robots fall in it; jumping has the rest. A robot with a load
    in its hands gets a walk in place of a hop.
    """

    standing_fraction: Share = 0.2
    """Fraction of the commands that are for standing."""
    walking_fraction: Share = 0.55
    """Fraction of the commands that are for walking."""
    hopping_fraction: Share = 0.0
    """Fraction of the commands that are for one-leg hopping, half on each leg. The paper trains it alone: standing 0.1,
    walking 0, hopping 0.9."""
    default_fraction: Share = 0.5
    """Probability that f, l, h, p or w, each by itself, is at its default instead of drawn from its range."""
    combined_fraction: Share = 0.0
    """Fraction of the commands in which all of them are drawn, whatever the probability above."""
    combined_stands: Share | None = None
    """The same for stands, which have only h, p and w; None for the same fraction."""
    zero_velocity_fraction: Share = 0.1
    """Probability of stepping in place."""
    resample_steps: Count = 300
    """Control steps after which a new command is drawn."""

    def __post_init__(self) -> None:
        """Check the sum of the fractions of gaits."""
        total = self.standing_fraction + self.walking_fraction + self.hopping_fraction
        if total > 1.0 + 1e-9:  # decimal fractions that sum to 1 may exceed it by rounding
            raise ConfigError(f"the fractions of standing, walking and hopping sum to {total:g}; give at most 1")


@settings
class CurriculumConfig:
    """Curricula of penalty scale, arm noise and speed; gates compare tracking rewards relative to their maxima.

    The curricula move once per `steps` environment steps, whatever the length of the learner's iterations; intervals
    are counted in these moves.
    """

    steps: Count = 24_576
    """Environment steps between two moves: 24 control steps of 1,024 robots."""
    warm_up_iterations: Annotated[int, Field(ge=0)] = 120
    """Number of moves at the start at which all three rest."""
    penalty_start: Positive = 0.2
    """Initial factor on the regularisation rewards."""
    penalty_growth: Positive = 1.002
    """Factor on the penalty scale per move, up to 1."""
    linear_threshold: float = 0.7
    """Relative linear tracking reward of robots that move under intervention above which the noise level alpha rises;
    it falls below two thirds of it."""
    angular_threshold: float = 0.5
    """The same for the angular tracking reward; alpha rises above both, and falls below two thirds of either."""
    alpha_step: NotNegative = 0.01
    """Change of the noise level per decision (the paper's)."""
    alpha_interval: Count = 3
    """Moves between two decisions on alpha, so that the averages reflect the new level."""
    speed_threshold: float = 0.7
    """Relative linear tracking reward of moving robots of the agile group above which its speed grows."""
    speed_step: NotNegative = 0.02
    """Growth of the largest forward speed of the agile group per decision [m/s]."""
    speed_interval: Count = 20
    """Moves between two decisions on the speed."""
    agile_fraction: Share = 0.5
    """Fraction of the robots that are in the agile group, which has higher speeds and no intervention."""
    rules: Annotated[dict[str, Callable[..., float]], tyro.conf.Suppress] = dataclasses.field(default_factory=dict)
    """Functions of a setting's present value and the `Curriculum`, which return its new value at each move, by the
    name of the setting, such as loads.payload; for settings written in Python."""


@settings
class TerrainConfig:
    """Rough ground of several levels; each robot has its own level. Without roughness the ground is a plane."""

    roughness: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Half-width of the uniformly random heights of the highest level [m]; 0 for a plane. The paper: 0.02."""
    levels: Annotated[int, Field(ge=2)] = 10
    """From a plane to the roughness, in equal steps."""
    start_level: Annotated[int, Field(ge=0)] = 0
    """Highest level on which robots start; they are spread evenly over the levels from 0 up to it."""
    threshold: float = 0.7
    """Relative linear tracking reward from which a robot that did not fall moves one level up; a fall moves it down."""

    def __post_init__(self) -> None:
        """Check the level of the start."""
        if self.start_level >= self.levels:
            raise ConfigError(f"start_level is {self.start_level}; give at most {self.levels - 1}", at=("start_level",))


@settings
class RewardWeights:
    """Weights of the paper's reward table, one per row. Every reward is multiplied by the control period.

    The two weights of velocity tracking must be positive: the curricula compare these rewards with their maxima.
    """

    linear_velocity_tracking: Positive = 2.0
    angular_velocity_tracking: Positive = 2.0
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


@settings
class ExtraWeights:
    """Weights of terms that the paper's table lacks; 0 switches a term off."""

    alive: float = 4.0
    """Constant reward while the robot is up. The sum of a step must be positive from the start, or robots fall on
    purpose; with loads and full penalties that takes about 15 (recipes)."""
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
    4 (m/s)^2; jumps and hops may fall as the clock says besides. Without it soles met the ground at up to 3 m/s."""
    contact_mismatch: float = -2.0
    """sum_i |C_i - c_i|, with c_i whether foot i is on the ground; not in standing."""
    flight_contact: float = -3.0
    """sum_i (1 - C_i) c_i in jumping and hopping. A hop at twice the clock's frequency, which is easier, touches the
    ground in every flight; with the paper's term alone it cost 0.8 a second of 9."""
    bounce_tracking: float = 0.0
    """exp(-e^2 / 0.2) of the pelvis' vertical speed against that of a flight by the clock, in jumps, and in hops while
    the held foot is up. Without it the policy bobs to the clock instead of jumping."""
    bounce_error: float = 0.0
    """Square of that error in jumps, up to 2 (m/s)^2, which has a slope where the exponential is flat."""
    unequal_support: float = -3.0
    """1 while a single foot carries the robot although both feet move in phase (standing, jumping). Without it the
    policy ran at twice the frequency instead of jumping."""


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

    count: Count = 512
    """Robots simulated at once."""
    robot: RobotName = "h1"
    """Robot: h1 (59.3 kg), h1-2023, the maker's earlier description (51.65 kg), g1, or the path of a table."""
    drives: Literal["real", "ideal"] = "real"
    """Drives of the joints: real (torque-speed limit and friction; their delay is part of the latency), or ideal."""
    ground: Literal["firm", "soft"] = "firm"
    """Firmness of the ground. At a time step of 5 ms, firm ground is softened to what that step allows."""
    timestep: Annotated[float, Field(gt=0, le=0.01)] = 0.005
    """Physics time step [s]."""
    substeps: Count = 4
    """Physics steps in a control step."""
    episode_steps: Count = 1000
    """Control steps after which an episode ends."""
    action_scale: Positive = 0.25
    """Radians of joint target per unit of action."""
    yaw_action_factor: Positive = 0.4
    """Factor on the action scale of hip yaw and waist. These joints are stiff and the yaw inertia is small: at the
    common scale, their exploration noise hides the yaw rate from the reward. 1 gives the paper's."""
    yaw_damping_factor: Positive = 3.0
    """Factor on the damping of hip yaw and waist. With the paper's gains (1) they resonate near 2 Hz, the frequency of
    the stride."""
    waist_rate: NotNegative = 2.0
    """Speed at which the waist's joint target follows the commanded w [rad/s]; the action is added to it. With 0 the
    action alone moves the waist, as in the paper."""
    squat_gain: Gain = 0.0
    """Factor of the commanded height and pitch that the legs' joint targets follow by themselves
    (`hugwbc.learned.policy.leg_feed_forward`); the action is added. With 0 the action alone moves the legs, as in the
    paper. A robot on PD joints executes less than its targets say, so a factor above 1 starts nearer to the command."""
    swing_gain: Share = 0.0
    """Share of the clock's swing, up to the commanded height l, by which the legs' joint targets lift the feet; the
    action is added. With 0 the action alone lifts them, as in the paper."""
    intervention: Literal["noise", "motion", "none"] = "noise"
    """What takes over the arms: the paper's noise, motions, or nothing."""
    motions: pathlib.Path | None = None
    """Folder of motion files (.npz, .csv) for the motion intervention; motions are generated if it is not given."""
    flip_probability: Share = 0.005
    """Probability per control step that the intervention indicator I(t) flips."""
    noise_paired: Share = 0.0
    """Share of the draws of the arm noise that are mirror-symmetric. With independent arms, a load in both hands ahead
    of a stand, which tips it forward, is hardly ever practised."""
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
    curriculum: CurriculumConfig = dataclasses.field(default_factory=CurriculumConfig)
    terrain: TerrainConfig = dataclasses.field(default_factory=TerrainConfig)

    def __post_init__(self) -> None:
        """Check what the types of the fields cannot."""
        further_terms(self.observations, load_robot(self.robot))
        for name in self.terms:
            if hasattr(self.rewards, name) or hasattr(self.extra, name):
                raise ConfigError(f"reward '{name}' exists; give another name", at=("terms", name))
        for name in self.curriculum.rules:
            if name.partition(".")[0] not in ADOPTED:
                raise UnknownNameError("setting for a curriculum", name, ADOPTED, at=("curriculum", "rules"))
            if name in READ_ONCE or not isinstance(value_of(self, name), int | float | None):
                raise ConfigError(
                    f"no rule can move '{name}'; give single numbers, other than {', '.join(READ_ONCE)}",
                    at=("curriculum", "rules"),
                )
        if self.motions is not None and self.intervention != "motion":
            raise ConfigError(
                f"motions is {self.motions}; give the intervention motion as well, or leave it out", at=("motions",)
            )

    @property
    def period(self) -> float:
        """Control period [s]."""
        return self.timestep * self.substeps

    def action_scales(self, robot: Robot) -> np.ndarray:
        """Return the radians of joint target per unit of action, shape (joints,)."""
        return self._with_yaw(np.full(len(robot.joint_names), self.action_scale), self.yaw_action_factor, robot)

    def damping(self, robot: Robot) -> np.ndarray:
        """Return the damping of the joints' PD [N*m*s/rad], shape (joints,)."""
        return self._with_yaw(robot.kd, self.yaw_damping_factor, robot)

    def contract(self) -> Contract:
        """Return the contract of a policy that is trained in this environment."""
        robot = load_robot(self.robot)
        return Contract(
            name="learned",
            robot=robot.name,
            period=self.period,
            joints=robot.joint_names,
            default_pose=tuple(robot.nominal.tolist()),
            kp=tuple(robot.kp.tolist()),
            kd=tuple(self.damping(robot).tolist()),
            action_scale=tuple(self.action_scales(robot).tolist()),
            observation=tuple(Term(name, scale=TERMS[name].scale) for name in FRAME_TERMS),
            history=History(frames=HISTORY_FRAMES),
            command=tuple(Term(name, scale=TERMS[name].scale) for name in (*COMMAND_TERMS, *self.observations)),
            waist_rate=self.waist_rate,
            squat_gain=self.squat_gain,
            swing_gain=self.swing_gain,
        )

    @staticmethod
    def _with_yaw(values: np.ndarray, factor: float, robot: Robot) -> np.ndarray:
        scaled = values.copy()
        scaled[robot.yaw_joints] *= factor
        return scaled


# Settings that an environment adopts without rebuilding its robots, and those among them that it reads only once.
ADOPTED = ("command", "rewards", "extra", "loads", "curriculum", "squat_gain", "swing_gain")
READ_ONCE = ("curriculum.steps", "curriculum.agile_fraction", "curriculum.penalty_start")


def same_robots(one: EnvConfig, other: EnvConfig) -> bool:
    """Return whether the robots of one environment can continue in the other, without being rebuilt."""
    kept = [field.name for field in dataclasses.fields(one) if field.name not in ADOPTED]
    return all(getattr(one, name) == getattr(other, name) for name in kept)
