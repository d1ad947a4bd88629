"""Weights of the rewards: the paper's table, and the terms that it lacks."""

import dataclasses

from hugwbc.learned.config.checks import require, require_finite


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
        require_finite(self, "rewards.")
        for name in ("linear_velocity_tracking", "angular_velocity_tracking"):
            value = getattr(self, name)
            require(value > 0.0, f"rewards.{name}", value, "above 0: the curricula compare the reward to its maximum")


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
    linear_velocity_error: float = 0.0
    """Squared error of the horizontal velocity, up to 1 (m/s)^2; off by default. Its slope does not vanish where both
    exponentials are flat: a hop that drifts away falls by it."""
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
        require_finite(self, "extra.")
