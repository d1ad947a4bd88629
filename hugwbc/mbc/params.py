"""Every gain, weight and limit of the `qp` controller, in one place."""

import dataclasses
from typing import Annotated

from pydantic import Field

from hugwbc.commands import PAPER_LEG
from hugwbc.robot import Robot
from hugwbc.settings import Count, NotNegative, Positive, settings

_Triple = tuple[NotNegative, NotNegative, NotNegative]
_FootWeights = tuple[NotNegative, NotNegative, NotNegative, NotNegative, NotNegative]
_Gains = tuple[Positive, Positive]  # stiffness and damping, or the largest rate and the largest acceleration


@settings
class ControllerParams:
    """Gains, weights and limits of `WholeBodyController`.

    The cost of a task is weight * (acceleration error)^2, so that weights of tasks with the same unit compare directly.
    Costs are squared accelerations [m^2/s^4] or [rad^2/s^4]; weights of motions therefore have no unit. A pair called
    `gains` is stiffness [1/s^2] and damping [1/s]: both multiply errors of motion and give accelerations, not torques.

    The figures are those of an H1; `of_size` gives those of a robot with other legs or another weight.
    """

    # --- whole-body QP
    # Friction coefficient that the contact forces respect while no sole slips; below the soles' 0.8, for margin
    friction: Positive = 0.7
    torque_fraction: Positive = 0.95  # Share of every joint's torque limit that the QP may use
    max_normal_force: Positive = 2000.0  # Largest normal force of one contact point [N]
    joint_margin: NotNegative = 0.02  # Distance that is kept from a joint's position limit [rad]
    joint_brake: Positive = 400.0  # Deceleration with which a joint is assumed to stop before its limit [rad/s^2]
    joint_horizon: Positive = 0.02  # Time in which a joint speed above the admissible one is reduced to it [s]
    speed_horizon: Positive = 0.004  # Time in which a joint may reach its highest speed from below [s]
    acceleration_regularisation: Positive = 1e-3  # Weight of every generalised acceleration
    force_regularisation: Positive = 1e-5  # Weight of every component of a contact force [1/kg^2]
    qp_tolerance: Positive = 1e-5  # Absolute residual at which the QP counts as solved
    qp_max_iterations: Count = 12  # Largest number of outer iterations of one solve

    # --- tasks: weights, stiffness [1/s^2], damping [1/s]
    # Weight of a standing foot's line contact: far above all other tasks, yet soft enough for the QP to stay feasible
    # on any ground
    contact_weight: NotNegative = 2000.0
    contact_damping: NotNegative = 30.0  # Damping of the velocity of a standing foot [1/s]
    # Stiffness with which a standing sole turns to the slope of the ground and, if the ankle rolls, to level [1/s^2]
    contact_pitch_stiffness: NotNegative = 100.0
    # Weight of the pelvis's height: far above that of a swing, so that the QP never raises the pelvis to gain normal
    # force for a fast swing
    height_weight: NotNegative = 300.0
    height_gains: _Gains = (120.0, 22.0)  # Gains of the pelvis's height [1/s^2], [1/s]
    # Weights of the pelvis's roll, pitch and yaw. Roll is low: the line-shaped feet cannot hold it while a leg swings
    # fast
    orientation_weight: _Triple = (4.0, 20.0, 10.0)
    orientation_gains: _Gains = (300.0, 30.0)  # Gains of the pelvis's orientation [1/s^2], [1/s]
    com_weight: NotNegative = 300.0  # Weight of the centre of mass when standing: balance comes before posture
    travel_weight: NotNegative = 10.0  # Weight of the pelvis's motion along the heading when walking
    com_gains: _Gains = (30.0, 11.0)  # Gains of the centre of mass when standing [1/s^2], [1/s]
    swing_weight: _Triple = (40.0, 40.0, 40.0)  # Weights of a swinging foot's position, world x, y and z
    swing_gains: _Gains = (700.0, 50.0)  # Gains of that position [1/s^2], [1/s]
    # Weights of a swinging foot's pitch and yaw. Pitch is low: a high swing turns the sole where the range of the ankle
    # ends
    swing_rotation_weight: tuple[NotNegative, NotNegative] = (2.0, 10.0)
    swing_rotation_gains: _Gains = (300.0, 30.0)  # Gains of pitch and yaw [1/s^2], [1/s]
    waist_weight: NotNegative = 2.0  # Weight of the waist joint
    waist_gains: _Gains = (100.0, 20.0)  # Gains of the waist joint [1/s^2], [1/s]
    # Weight of joints that hold their nominal position, such as the roll of a waist; with the waist's gains
    held_weight: NotNegative = 20.0
    # Weight of arm joints without external control: they hold the nominal pose, but yield
    arm_weight: NotNegative = 0.5
    arm_gains: _Gains = (100.0, 20.0)  # Gains of arm joints without external control [1/s^2], [1/s]
    # Weight of arm joints under external control: a prescribed motion that the rest of the body balances
    takeover_weight: NotNegative = 20.0
    # Gains of arm joints under external control [1/s^2], [1/s]; lower if the control period is long
    takeover_gains: _Gains = (1600.0, 80.0)
    takeover_speed: Positive = 8.0  # Largest speed with which an arm joint closes a gap to an external target [rad/s]
    # Weights of the rate of the angular momentum about the world's x, y and z [1/(kg m^2)^2]
    momentum_weight: _Triple = (0.002, 0.002, 0.002)
    momentum_damping: NotNegative = 5.0  # Damping of the angular momentum without a force plan [1/s]

    # --- walking
    step_width: NotNegative = 0.20  # Distance between the centre lines of the feet when walking in place [m]
    min_foot_distance: NotNegative = 0.08  # Smallest lateral distance between the feet [m]
    # Largest lateral distance between the feet [m], which the roll of the hips and a crouch allow
    max_foot_distance: NotNegative = 0.75
    # Reach of a step along the heading, backward and forward from the stance foot [m]
    max_step: tuple[Annotated[float, Field(le=0.0)], NotNegative] = (-0.60, 0.75)
    # Shift of the centre of pressure per deviation of the divergent component of motion; above 1 the latter converges
    cop_gain: NotNegative = 1.5
    # Distance of a foothold from the stance foot beyond which the pelvis comes down as far as the legs need [m]
    long_step: NotNegative = 0.4
    # Apex of the swing of a step of `max_step` forward [m]; beyond `long_step` the apex falls towards it
    long_step_clearance: NotNegative = 0.05
    # Length between hip and ankle that a leg keeps in reserve in such a step [m]. It lands with a bent knee, since the
    # impact along a straight leg would throw the pelvis up
    leg_reserve: Positive = 0.04
    # Largest rate and acceleration with which the pelvis comes down for such a step [m/s], [m/s^2]
    crouch_rate: _Gains = (1.0, 6.0)
    # Largest rate and acceleration with which the pelvis rises again [m/s], [m/s^2]: slow, because a foot that is far
    # away still has to be lifted
    rise_rate: _Gains = (0.2, 2.0)
    max_crouch: NotNegative = 0.25  # Largest lowering of the pelvis for such a step [m]
    # Share of the frequency by which a step that cannot reach its foothold may be faster or slower; 0 keeps time
    step_timing: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.2
    # Distance by which a foothold may be missed before the step is retimed [m]
    step_timing_tolerance: NotNegative = 0.02
    # Cost of a relative change of a step's duration by 1, compared with a squared missed distance [m^2]
    step_timing_weight: NotNegative = 0.005
    swing_acceleration: Positive = 120.0  # Largest acceleration along the ground of a swing that is hurried [m/s^2]
    # Height relative to the ground at which a swing ends [m]; a little below, so that the foot touches
    landing_height: float = -0.001
    landing_speed: NotNegative = 0.05  # Downward speed at which a swing ends [m/s]
    search_speed: NotNegative = 0.4  # Downward speed of a foot that has not found the ground where it should be [m/s]
    early_contact_phase: NotNegative = 0.6  # Share of the swing after which touching the ground counts as landing
    early_contact_height: float = 0.0005  # Height of heel or toe below which a descending foot counts as landed [m]
    shift_time: NotNegative = 0.22  # Shortest shift of the weight in double support before the first step [s]
    max_shift_time: NotNegative = 0.6  # Longest shift of the weight [s]
    # Distance of the divergent component from the middle of the feet along the heading, beyond which a standing robot
    # steps to catch itself [m]
    capture_distance: NotNegative = 0.11
    # The same across the heading: distance to the centre line of the outer foot, below which the robot steps [m]
    capture_margin: NotNegative = 0.01
    capture_time: NotNegative = 1.0  # Shortest time for which the robot then steps in place [s]
    # Time of standing after the last step before the limits of walking on h are lifted [s]
    settle_time: NotNegative = 0.6
    # Share of the velocity error of a stride that is added to the velocity plan at each step
    velocity_integral: NotNegative = 0.25
    velocity_integral_bound: NotNegative = 0.15  # Bound on the velocity error of a step in that correction [m/s]
    # Change of the commanded velocity within a step beyond which the error of the step does not count [m/s]
    velocity_integral_change: NotNegative = 0.05
    max_velocity_trim: NotNegative = 0.3  # Largest correction of the velocity plan [m/s]

    # --- jumping and hopping
    # Weights of the centre of mass in a leap, which follows the force plan, world x, y and z
    motion_weight: _Triple = (10.0, 10.0, 100.0)
    # Weights of the rate of the angular momentum in a leap, which follows the force plan, about the world's x, y and z
    # [1/(kg m^2)^2]
    planned_momentum_weight: _Triple = (1.0, 1.0, 1.0)
    # Weight of the departure of every contact force from the force plan [1/kg^2]
    planned_force_weight: NotNegative = 1e-4
    # Weights of the pelvis's roll, pitch and yaw in the stance of a leap: the plan of the angular momentum comes first.
    # About the vertical axis the waist can take that momentum
    leap_orientation_weight: _Triple = (0.02, 0.02, 0.5)
    # Weight of the waist joint in a leap: if it turns, the trunk takes up the momentum that the legs need in flight
    leap_waist_weight: NotNegative = 0.2
    # Weight of joints that hold their nominal position in a leap: to hold the trunk rigidly in a push-off would take
    # more torque than they have
    leap_held_weight: NotNegative = 2.0
    # Weights of the pelvis's roll, pitch and yaw in flight. Angular momentum is conserved there, so that turning the
    # pelvis moves the legs from their places
    flight_orientation_weight: _Triple = (4.0, 6.0, 6.0)
    # Weights of a foot's x, y, z, pitch and yaw in flight, where no other foot has to bear the reaction
    flight_swing_weight: _FootWeights = (40.0, 40.0, 40.0, 2.0, 10.0)
    mpc_intervals: Count = 6  # Number of intervals of constant force in the rest of a stance
    mpc_period: Positive = 0.01  # Time between two force plans [s]
    mpc_shortest_stance: Positive = 0.03  # Time to take-off below which the plan does not become shorter [s]
    mpc_velocity_weight: NotNegative = 100.0  # Force plan: weight of the horizontal velocity at take-off [s^2/m^2]
    mpc_rise_weight: NotNegative = 1000.0  # Force plan: weight of the vertical velocity at take-off [s^2/m^2]
    mpc_height_weight: NotNegative = 10000.0  # Force plan: weight of the height at take-off [1/m^2]
    mpc_sway_weight: NotNegative = 30.0  # Force plan: weight of the horizontal velocity on the way, per time [s/m^2]
    mpc_tilt_weight: NotNegative = 20.0  # Force plan: weight of the mean squared tilt on the way [1/rad^2]
    mpc_landing_tilt_weight: NotNegative = 300.0  # Force plan: weight of the tilt at the landing [1/rad^2]
    mpc_spin_weight: NotNegative = 10.0  # Force plan: weight of the angular velocity at take-off [s^2/rad^2]
    # Force plan: weight of the forces' departure from an even vertical push, in units of the robot's weight, per time
    # [1/s]
    mpc_force_weight: NotNegative = 5.0
    gather_time: NotNegative = 0.3  # Time by which the first and the last stance of a series of leaps are longer [s]
    jump_speed: Positive = 0.85  # Share of the highest speed of a walk that jumps may have: both legs swing at once
    leap_width: NotNegative = 0.36  # Distance between the centre lines of the feet when jumping in place [m]
    # Distance by which the feet land further out per m/s that the robot leaps too fast [s]
    leap_placement: NotNegative = 0.12
    # Distance of the divergent component from the middle of the feet at which a series of jumps may start [m]
    jump_calm: NotNegative = 0.04
    hop_shift_time: Positive = 0.5  # Time in which the weight moves onto the hopping leg [s]
    # Rate at which the divergent component of motion moves to where the first hop needs it [1/s]
    hop_shift_gain: NotNegative = 12.0
    # Distance of the divergent component from the hopping foot at which the first hop may start [m]
    hop_shift_tolerance: NotNegative = 0.012
    # Fastest sideways hop towards the leg that does not hop [m/s]: the hip's roll ends at 0.43 rad
    hop_inward_speed: NotNegative = 0.33
    hop_side_rate: NotNegative = 0.5  # Largest rate of v_y in a series of hops [m/s^2]
    # Distance beyond the hopping foot that the divergent component may reach before the robot steps [m]
    hop_overshoot: NotNegative = 0.07
    # Lowering of the pelvis for a hop, and for a jump that travels fast [m]: a leg that leans must still push
    hop_lowering: NotNegative = 0.06
    jump_lowering: NotNegative = 0.1  # Largest lowering of the pelvis for a jump that travels or turns [m]
    # Speed [m/s] or rate of turning [rad/s] from which on a leap is no lower than `hop_lowering` or `jump_lowering`:
    # the legs cannot push off from a squat and travel as well
    leap_squat_speed: Positive = 0.3
    free_leg_weight: NotNegative = 2.0  # Weight of the joints of the leg that does not hop
    free_leg_gains: _Gains = (100.0, 20.0)  # Gains of these joints [1/s^2], [1/s]
    leap_depth: float = -0.26  # Lowest h at the bottom of the stance of a jump [m]
    hop_depth: float = -0.17  # Lowest h at the bottom of the stance of a hop [m]
    # Length between hip and ankle that the legs keep in reserve at the take-off of a leap [m]: what the push-off needs,
    # not scaled with the robot. An H1 has as much in its nominal pose
    leap_reserve: NotNegative = 0.0615
    leap_tuck: NotNegative = 0.95  # Largest (apex - rise of the body) f^2 of a foot in a leap [m Hz^2]

    # --- posture
    # Centre of pressure, and of mass when standing, forward of the ankles [m]: well within what the ankle torque can
    # reach
    balance_ahead: float = 0.02
    # Least distance of that point from the foremost one that the range of the ankle allows, standing and walking [m]
    balance_margin: tuple[NotNegative, NotNegative] = (0.012, 0.03)
    speed_lowering: NotNegative = 0.1  # Lowering of the pelvis per m/s of speed above `lowering_from` [s]
    # Speed above which the pelvis is lowered, so that the trailing leg does not straighten [m/s]
    lowering_from: NotNegative = 0.9
    # Share of the hips' torque limit that swinging a leg along the ground may take; the rest holds the trunk upright
    # and folds the leg. It bounds the speed of a walk
    swing_torque: Positive = 0.63
    # Distance of the highest apex below the highest swing that the legs allow (`commands.highest_swing`) [m]
    clearance_reserve: NotNegative = 0.04
    clearance_speed: NotNegative = 1.0  # Speed above which the apex is lowered [m/s]
    clearance_per_speed: NotNegative = 0.08  # Lowering of the apex that the leg reaches, per m/s above that speed [s]
    # Share of the hips' torque limit that lifting a leg may take; a swing that would take more gets a lower apex. A leg
    # that cannot follow would throw the pelvis up, whose straightened leg then lifts the foot even more slowly
    lift_torque: Positive = 0.85
    # Largest sum of what swinging and lifting a leg take of that torque, whose peaks do not coincide
    hip_torque: Positive = 1.25
    # Share of the knees' highest speed that the plan of a foot's fall may take, in place and from `fall_travel` on. A
    # foot may land late in place; while the robot travels, the body would run ahead of it
    fall_speed: tuple[Positive, Positive] = (1.3, 0.95)
    fall_travel: Positive = 0.53  # Speed from which the second share counts [m/s]
    # Share of `SWING_REACTION` that is lost per m/s above `clearance_speed` [s/m]
    swing_reaction_per_speed: NotNegative = 0.3
    # Lowest swing apex [m]; it is kept even where the height command leaves less room
    min_clearance: NotNegative = 0.04
    # Forward travel of the centre of mass from the ankle that the stance leg must allow even in place [m]
    walking_room: NotNegative = 0.045
    backward_room: NotNegative = 0.1  # Additional room per m/s of backward speed [s]

    # --- command filter: largest rates and accelerations
    velocity_rate: _Triple = (1.5, 1.5, 2.0)  # Largest rates of v_x, v_y [m/s^2] and omega [rad/s^2]
    frequency_rate: NotNegative = 2.0  # Largest rate of f [Hz/s]
    height_rate: _Gains = (0.35, 2.0)  # Largest rate and acceleration of h [m/s], [m/s^2]
    pitch_rate: _Gains = (0.8, 4.0)  # Largest rate and acceleration of p [rad/s], [rad/s^2]
    # Largest rate and acceleration of h in a series of jumps [m/s], [m/s^2]: legs that land lower than they took off
    # have less force to spare
    jump_height_rate: _Gains = (0.1, 2.0)
    hop_height_rate: _Gains = (0.05, 2.0)  # Largest rate and acceleration of h in a series of hops [m/s], [m/s^2]
    # Largest rate and acceleration of p in a series of leaps [rad/s], [rad/s^2]: the body turns on in the flight
    leap_pitch_rate: _Gains = (0.2, 4.0)
    waist_rate: _Gains = (2.0, 10.0)  # Largest rate and acceleration of w [rad/s], [rad/s^2]

    # --- forces on the hands
    # Bandwidth of the felt forces on the hands that the balance reckons with [1/s]: below the sway of the arms
    hand_force_rate: Positive = 10.0
    # Force on a hand up to which none is assumed [N]: what friction of the drives and swinging arms look like
    least_hand_force: Positive = 10.0

    # --- output
    # Stiffness of the joint PD between two ticks, as a share of the robot's nominal kp
    joint_stiffness: NotNegative = 0.1
    joint_damping: NotNegative = 0.3  # Damping of the joint PD between two ticks, as a share of the robot's nominal kd

    def of_size(self, robot: Robot) -> "ControllerParams":
        """Return the parameters for the size of a robot.

        Most lengths grow with its legs, speeds with the root of their length (at the same Froude number), forces with
        its mass; the weights of forces and angular momenta change as their units say. Values of the robot's own table
        (`Robot.qp`) are taken as they are, in the place of every value that equals its default, even if it was given.
        """
        leg, mass = robot.leg_length / PAPER_LEG, robot.mass / _MASS
        sized = {}
        for (by_leg, by_mass), names in _GROWTH.items():
            growth = leg**by_leg * mass**by_mass
            for name in names:
                value = getattr(self, name)
                sized[name] = tuple(growth * x for x in value) if isinstance(value, tuple) else growth * value
        defaults = {field.name: field.default for field in dataclasses.fields(self)}
        own = {name: value for name, value in robot.qp.items() if getattr(self, name, None) == defaults.get(name)}
        return dataclasses.replace(self, **sized | own)


_MASS = 59.338  # [kg], of the H1, for which the defaults are
# How parameters grow: powers of the leg's length and of the mass, which follow from the units.
_GROWTH = {
    (1.0, 0.0): (
        *("step_width", "min_foot_distance", "max_foot_distance", "max_step", "long_step", "long_step_clearance"),
        *("leg_reserve", "max_crouch", "capture_distance", "capture_margin", "leap_width", "jump_calm"),
        *("hop_shift_tolerance", "hop_overshoot", "hop_lowering", "jump_lowering", "leap_depth", "hop_depth"),
        *("clearance_reserve", "min_clearance", "walking_room"),
    ),
    (0.5, 0.0): (
        "lowering_from",
        "clearance_speed",
        "fall_travel",
        "hop_inward_speed",
        "max_velocity_trim",
        "velocity_integral_bound",
    ),
    (0.0, 1.0): ("max_normal_force", "least_hand_force"),
    (0.0, -2.0): ("force_regularisation", "planned_force_weight"),
    (-4.0, -2.0): ("momentum_weight", "planned_momentum_weight"),
}
