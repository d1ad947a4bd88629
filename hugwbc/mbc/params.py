"""Every gain, weight and limit of the model-based controller, in one place."""

import dataclasses
import math

from hugwbc.errors import ConfigError

# Divisors and bounds, which mean nothing at 0 or below it.
_POSITIVE = (
    *("friction", "torque_fraction", "max_normal_force", "speed_fraction", "joint_brake", "joint_horizon"),
    *("acceleration_regularisation", "force_regularisation", "qp_tolerance", "qp_max_iterations", "takeover_speed"),
    *("leg_length", "swing_acceleration", "mpc_intervals", "mpc_period", "mpc_shortest_stance", "hop_shift_time"),
    # Of pairs the largest rate and the largest rate of it,
    *("height_rate", "pitch_rate", "waist_rate", "crouch_rate", "rise_rate"),
    # and stiffness and damping, whose ratio is the speed at which a gap is closed.
    *("waist_gains", "arm_gains", "takeover_gains", "free_leg_gains"),
)


@dataclasses.dataclass(frozen=True)
class ControllerParams:
    """Numbers of the whole-body controller.

    A task's cost is weight * (acceleration error)^2, so weights of tasks with the same unit compare directly. Gains are
    natural: stiffness in 1/s^2, damping in 1/s, and multiply errors, not torques.
    """

    # --- whole-body QP
    friction: float = 0.7
    """Friction coefficient that the contact forces respect; below the soles' 0.8, for margin."""
    torque_fraction: float = 0.95
    """Share of every joint's torque limit that the QP may use."""
    max_normal_force: float = 2000.0
    """Largest normal force of one contact point [N]."""
    joint_margin: float = 0.02
    """Distance to a joint's position limit that is kept [rad]."""
    speed_fraction: float = 1.6
    """Share of every joint's speed limit that may be used. Above 1: the high swings of the command range need it, and
    the simulation, like the learned policy's, does not limit speed. Choose 1 for a machine that does."""
    joint_brake: float = 400.0
    """Deceleration with which a joint is assumed to stop before its limit [rad/s^2]."""
    joint_horizon: float = 0.02
    """Time in which a joint speed above the admissible one is taken back [s]."""
    acceleration_regularisation: float = 1e-3
    """Weight on every generalised acceleration."""
    force_regularisation: float = 1e-5
    """Weight on every contact force component [1/kg^2]."""
    qp_tolerance: float = 1e-5
    """Absolute residual at which the QP counts as solved."""
    qp_max_iterations: int = 25
    """Bound on outer iterations of one solve."""

    # --- tasks: weights, stiffness [1/s^2], damping [1/s]
    contact_weight: float = 2000.0
    contact_damping: float = 30.0
    contact_pitch_stiffness: float = 100.0
    height_weight: float = 300.0
    """Dominates, so that the QP never raises the pelvis to buy normal force for a fast swing."""
    height_gains: tuple[float, float] = (120.0, 22.0)
    orientation_weight: tuple[float, float, float] = (4.0, 20.0, 10.0)
    """Roll, pitch and yaw. Low roll: the line-shaped feet cannot hold it while a leg swings fast."""
    orientation_gains: tuple[float, float] = (300.0, 30.0)
    com_weight: float = 300.0
    """Standing: balance comes before posture."""
    travel_weight: float = 10.0
    """Walking: the pelvis along the heading."""
    travel_damping: float = 0.0
    com_gains: tuple[float, float] = (30.0, 11.0)
    swing_weight: tuple[float, float, float] = (40.0, 40.0, 10.0)
    swing_gains: tuple[float, float] = (700.0, 50.0)
    swing_rotation_weight: tuple[float, float] = (2.0, 10.0)
    """Pitch and yaw. Low pitch: a high swing turns the sole where the ankle ends."""
    swing_rotation_gains: tuple[float, float] = (300.0, 30.0)
    waist_weight: float = 2.0
    waist_gains: tuple[float, float] = (100.0, 20.0)
    arm_weight: float = 0.5
    arm_gains: tuple[float, float] = (100.0, 20.0)
    takeover_weight: float = 20.0
    """Weight of arm joints under external control: prescribed motion, which the rest of the body balances."""
    takeover_gains: tuple[float, float] = (1600.0, 80.0)
    takeover_speed: float = 8.0
    """Largest speed with which an arm joint closes a gap to an external target [rad/s]."""
    momentum_weight: tuple[float, float, float] = (0.002, 0.002, 0.002)
    """Angular momentum about the centre of mass: roll, pitch, yaw [1/(kg m^2)^2]."""
    momentum_damping: float = 5.0

    # --- walking
    step_width: float = 0.20
    """Distance between the two feet's centre lines when walking in place [m]."""
    min_foot_distance: float = 0.08
    """Smallest lateral distance between the feet [m]."""
    max_foot_distance: float = 0.75
    """Largest one [m]: what the hips' roll allows, and a crouch."""
    max_step: tuple[float, float] = (-0.60, 0.75)
    """Reach of a step along the heading, from the stance foot [m]."""
    cop_reach: float = 0.065
    """Largest distance of the centre of pressure from the ankle, along the foot [m]: what the ankle torque holds."""
    cop_gain: float = 1.5
    """Shift of the centre of pressure per deviation of the divergent component of motion; above 1 it converges."""
    long_step: float = 0.4
    """Distance from the stance foot of a foothold for which the pelvis comes down, as far as the legs need [m]."""
    leg_length: float = 0.785
    """Distance between hip and ankle that a leg is not to exceed then [m]; straight it is 0.8."""
    crouch_rate: tuple[float, float] = (1.0, 6.0)
    """Change of the pelvis's height for it [m/s], [m/s^2]."""
    rise_rate: tuple[float, float] = (0.2, 2.0)
    """The same on the way back: a foot that is far away still has to be lifted."""
    max_crouch: float = 0.25
    """Largest such change [m]."""
    step_timing: float = 0.2
    """Share of the frequency by which a step that cannot reach its foothold may be faster or slower; 0 keeps time."""
    step_timing_tolerance: float = 0.02
    """Distance by which a foothold may be missed before that [m]."""
    step_timing_weight: float = 0.005
    """Cost of a change of the step's duration by its whole length, beside that of a missed foothold [m^2]."""
    swing_acceleration: float = 120.0
    """Largest acceleration along the ground of a swing that is hurried [m/s^2]."""
    landing_height: float = -0.001
    """Height below the ground at which a swing ends, so that it ends on it [m]."""
    landing_speed: float = 0.05
    """Downward speed at which a swing ends [m/s]."""
    search_speed: float = 0.4
    """Downward speed of a foot that has not found the ground where it should be [m/s]."""
    early_contact_phase: float = 0.6
    """Share of the swing after which touching the ground counts as landing."""
    early_contact_height: float = 0.0005
    """Height of heel or toe below which a descending foot counts as landed [m]."""
    shift_time: float = 0.22
    """Shortest weight shift in double support before the first step [s]."""
    max_shift_time: float = 0.6
    """Longest weight shift [s]."""
    capture_distance: float = 0.11
    """Standing: distance of the divergent component from the middle of the feet, along the heading, beyond which the
    robot steps to catch itself [m]."""
    capture_margin: float = 0.01
    """The same across: how far inside the outer foot it may come [m]."""
    capture_time: float = 1.0
    """How long it then steps in place, at least [s]."""
    settle_time: float = 0.6
    """Standing time after the last step before the limits of walking on h are lifted [s]."""
    velocity_integral: float = 0.25
    """Share of the velocity error of a stride that is added to the velocity plan at each step."""
    velocity_integral_bound: float = 0.15
    """Largest velocity error of a step that counts there [m/s]."""
    velocity_integral_change: float = 0.05
    """Change of the commanded velocity within a step beyond which the step's error does not count [m/s]."""
    max_velocity_trim: float = 0.3
    """Bound on that correction [m/s]."""

    # --- jumping and hopping
    motion_weight: tuple[float, float, float] = (10.0, 10.0, 100.0)
    """Leaping: the centre of mass as the force plan moves it, along the world's axes."""
    planned_momentum_weight: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Leaping: angular momentum as the force plan moves it: roll, pitch, yaw [1/(kg m^2)^2]."""
    planned_force_weight: float = 1e-4
    """Weight on the departure of every contact force from the force plan [1/kg^2]."""
    leap_orientation_weight: tuple[float, float, float] = (0.02, 0.02, 0.02)
    """Pelvis in the stance of a leap: the plan of the angular momentum comes first."""
    flight_orientation_weight: tuple[float, float, float] = (4.0, 6.0, 6.0)
    """Pelvis in flight, where angular momentum is conserved: turning it costs the legs their places."""
    flight_swing_weight: tuple[float, float, float, float, float] = (40.0, 40.0, 40.0, 2.0, 10.0)
    """Feet in flight, where no foot has to bear the reaction: x, y, z, pitch and yaw."""
    mpc_intervals: int = 6
    """Intervals of constant force in a stance."""
    mpc_period: float = 0.01
    """Time between two force plans [s]."""
    mpc_shortest_stance: float = 0.03
    """Time to take-off below which the plan does not shrink [s]."""
    mpc_velocity_weight: float = 100.0
    """Weights of the force plan, per squared m/s, m, rad, rad/s: horizontal velocity at take-off,"""
    mpc_rise_weight: float = 1000.0
    """vertical velocity at take-off,"""
    mpc_height_weight: float = 10000.0
    """height at take-off,"""
    mpc_sway_weight: float = 30.0
    """horizontal velocity on the way,"""
    mpc_tilt_weight: float = 20.0
    """tilt on the way,"""
    mpc_landing_tilt_weight: float = 300.0
    """tilt at the landing,"""
    mpc_spin_weight: float = 10.0
    """angular velocity at take-off,"""
    mpc_force_weight: float = 5.0
    """and departure of the forces from an even vertical push, in units of the robot's weight, per time."""
    gather_time: float = 0.3
    """By which the first and the last stance of a series of leaps are longer [s]."""
    leap_width: float = 0.36
    """Distance between the feet's centre lines when jumping in place [m]."""
    leap_placement: float = 0.12
    """Distance by which the feet land further out per m/s that the robot leaps too fast [s]."""
    hop_placement: float = 1.0
    """Share of the distance between foot and centre of mass that takes out what a hop has too much of."""
    jump_calm: float = 0.04
    """Distance of the divergent component from the middle of the feet at which a series of jumps may begin [m]."""
    hop_shift_time: float = 0.5
    """Time in which the weight moves onto the hopping leg [s]."""
    hop_shift_tolerance: float = 0.03
    """Distance of the weight from the hopping foot at which the first hop may begin [m]."""
    hop_overshoot: float = 0.07
    """Distance beyond the hopping foot that the divergent component may reach before the robot steps [m]."""
    hop_lowering: float = 0.06
    """Lowering of the pelvis for a hop: its leg leans, and must still reach the ground [m]."""
    free_leg_weight: float = 2.0
    free_leg_gains: tuple[float, float] = (100.0, 20.0)
    free_leg_posture: tuple[float, ...] = (0.0, 0.0, -1.0, 1.9, -0.82)
    """Hip yaw, roll, pitch, knee and ankle of the leg that does not hop [rad]."""
    leap_depth: float = -0.26
    """Lowest h at the bottom of the stance of a leap [m]."""
    hop_depth: float = -0.19
    """The same for a hop [m]."""
    leap_tuck: float = 1.5
    """Largest (apex - rise of the body) f^2 of a foot in a leap [m Hz^2]."""

    # --- posture
    balance_ahead: float = 0.02
    """Centre of pressure, and of mass when standing, forward of the ankles [m]: in the middle of what the ankle torque
    can reach."""
    balance_margin: tuple[float, float] = (0.012, 0.03)
    """Distance of that point from the foremost one that the ankle's range allows, standing and walking [m]."""
    speed_lowering: float = 0.05
    """Lowering of the pelvis per m/s of forward speed above `lowering_from` [m / (m/s)]."""
    lowering_from: float = 0.9
    """Speed above which the pelvis is lowered, so that the trailing leg does not straighten [m/s]."""
    clearance_at_nominal: float = 0.31
    """Highest sole clearance that knee and ankle allow at h = 0 [m]; it shrinks with h one to one."""
    clearance_speed: float = 1.0
    """Speed above which the apex is lowered [m/s]."""
    clearance_per_speed: float = 0.08
    """Lowering of the apex that the leg reaches, per speed above that [m / (m/s)]."""
    swing_reaction: float = 1.9
    """Largest l f^2 of a swing [m Hz^2]; the feet slip beyond."""
    swing_reaction_per_speed: float = 0.3
    """Share of that which is lost per speed above `clearance_speed` [1 / (m/s)]."""
    min_clearance: float = 0.04
    """Lowest swing apex [m]; it is kept even where the height command leaves less."""
    walking_room: float = 0.045
    """Forward travel of the centre of mass from the ankle that the stance leg must allow even in place [m]."""
    backward_room: float = 0.1
    """Further room per backward speed [s]."""

    # --- command filter: largest rate and largest rate of the rate
    velocity_rate: tuple[float, float, float] = (1.5, 1.5, 2.0)
    """Change of v_x, v_y [m/s^2] and omega [rad/s^2]."""
    frequency_rate: float = 2.0
    """Change of f [Hz/s]."""
    height_rate: tuple[float, float] = (0.35, 2.0)
    """Change of h [m/s], [m/s^2]."""
    pitch_rate: tuple[float, float] = (0.8, 4.0)
    """Change of p [rad/s], [rad/s^2]."""
    waist_rate: tuple[float, float] = (2.0, 10.0)
    """Change of w [rad/s], [rad/s^2]."""

    # --- output
    joint_stiffness: float = 0.1
    """Stiffness of the joint PD between two ticks, as a share of the robot's nominal kp."""
    joint_damping: float = 0.3
    """Damping of the joint PD between two ticks, as a share of the robot's nominal kd."""
    hold_time: float = 0.06
    """How long the last good command is held when no new one can be found, before the joints are only damped [s]."""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not all(map(math.isfinite, value if isinstance(value, tuple) else (value,))):
                raise ConfigError(f"ControllerParams.{field.name} is {value}; give finite numbers")
        for name in _POSITIVE:
            value = getattr(self, name)
            several = isinstance(value, tuple)
            if not all(number > 0 for number in (value if several else (value,))):
                raise ConfigError(
                    f"ControllerParams.{name} is {value}; give {'numbers' if several else 'a number'} above 0"
                )
        if not 0.0 <= self.step_timing < 1.0:
            raise ConfigError(f"ControllerParams.step_timing is {self.step_timing}; give a share from 0 to below 1")
