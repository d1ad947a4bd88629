"""Settings of the inverse kinematics."""

import dataclasses

import numpy as np

from hugwbc.errors import ConfigError


@dataclasses.dataclass(frozen=True)
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

    limit_margin: float = 0.02
    speed_fraction: float = 0.5
    acceleration: float = 60.0
    hand_speed: float = 1.5
    hand_deceleration: float = 6.0
    posture_weight: float = 1e-5
    pointing_weight: float = 1e-2
    grip_weight: float = 100.0
    collision_weight: float = 1e3
    collision_margin: float = 0.01
    collision_trigger: float = 0.05
    collision_deceleration: float = 15.0
    touch_speed: float = 0.4
    damping: float = 1e-3
    tolerance: float = 0.005
    detour_gain: float = 0.02
    detour_speed: float = 4.0

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not 0.0 < value < np.inf:
                raise ConfigError(f"ArmIKConfig.{field.name} is {value}; give a finite number above 0")
        if self.speed_fraction > 1.0:
            raise ConfigError(f"ArmIKConfig.speed_fraction is {self.speed_fraction}; give a fraction up to 1")
