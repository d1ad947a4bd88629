"""Settings of the inverse kinematics."""

from hugwbc.settings import Positive, PositiveShare, settings


@settings
class ArmIKConfig:
    """Settings of the inverse kinematics.

    Attributes:
        limit_margin: distance kept from the joint position limits [rad].
        speed_fraction: share of the joint velocity limits that the solution may use; half leaves the joint's controller
            room to catch up after a disturbance.
        acceleration: highest acceleration of a joint [rad/s^2].
        hand_speed: highest speed of a hand towards its target, in addition to the target's own speed [m/s].
        hand_deceleration: deceleration with which a hand can stop at its target [m/s^2].
        posture_weight: weight of the pull towards the nominal posture, relative to 1 for the hands [m^2/rad^2]. It is
            small, because it leaves an error in the hands (below 0.5 mm with the default).
        pointing_weight: weight of the elbow positions that make the forearms point as asked, relative to 1 for the
            hands. In a conflict, the hand is off its target by a hundredth of the elbow's error.
        orientation_weight: weight of the hands' orientations, where targets give none, relative to 1 for their
            positions [m^2/rad^2].
        turn_speed: highest speed at which a hand turns to its orientation [rad/s].
        turn_deceleration: deceleration with which it can stop there [rad/s^2].
        grip_weight: weight of the relative position of hands that hold one object.
        collision_weight: weight of the distances between links, which may be violated if there is no other way.
        collision_margin: distance kept between links [m].
        collision_trigger: distance below which links are kept apart [m].
        collision_deceleration: deceleration with which a hand can stop before its forearm touches something [m/s^2].
        touch_speed: speed of a hand whose forearm is next to something [m/s].
        damping: lambda for hands on target [m^2/rad^2].
        tolerance: distance within which a hand counts as on target [m].
        detour_gain: how much nearer another posture must bring a stalled hand for a detour [m].
        detour_speed: highest joint speed on a detour [rad/s]; the hand is no faster than `hand_speed`.
    """

    limit_margin: Positive = 0.02
    speed_fraction: PositiveShare = 0.5
    acceleration: Positive = 60.0
    hand_speed: Positive = 1.5
    hand_deceleration: Positive = 6.0
    posture_weight: Positive = 1e-5
    pointing_weight: Positive = 1e-2
    orientation_weight: Positive = 0.03
    turn_speed: Positive = 6.0
    turn_deceleration: Positive = 150.0
    grip_weight: Positive = 100.0
    collision_weight: Positive = 1e3
    collision_margin: Positive = 0.01
    collision_trigger: Positive = 0.05
    collision_deceleration: Positive = 15.0
    touch_speed: Positive = 0.4
    damping: Positive = 1e-3
    tolerance: Positive = 0.005
    detour_gain: Positive = 0.02
    detour_speed: Positive = 4.0
