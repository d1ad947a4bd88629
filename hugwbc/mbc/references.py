"""What all gaits refer to: heading, height of the ground and balance point, and with them the pelvis's targets."""

import math

import numpy as np

from hugwbc import rotations
from hugwbc.mbc import feet
from hugwbc.mbc.command_filter import SmoothCommand
from hugwbc.mbc.crouch import Crouch
from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.gait_plan import GaitPlan, Mode
from hugwbc.mbc.ground_plane import Ground
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.reach import balance_point
from hugwbc.mbc.tasks import PelvisHeightTask, PelvisOrientationTask

_MAX_YAW_LEAD = 0.3  # [rad], of the yaw reference before the measured yaw
_YAW_RETURN = 0.5  # [rad/s], of the reference to the feet's heading when standing
_GROUND_TIME = 0.1  # [s], smoothing of the ground height from one stance foot to the next


class References:
    """Heading, ground and balance of the plan, and the tasks of the pelvis.

    Attributes:
        yaw: heading that the robot is to have [rad].
        to_heading: from world x and y into the frame along it, shape (2, 2).
        ground: height of the ground below the pelvis, in the world [m].
        balance: nominal centre of pressure, and of mass when standing, ahead of the ankles [m].
        crouch: by which the pelvis is lower than commanded, for long steps.
        height, orientation: tasks of the pelvis.
    """

    def __init__(self, params: ControllerParams) -> None:
        self._params = params
        self.height = PelvisHeightTask(params)
        self.orientation = PelvisOrientationTask(params)
        self.crouch = Crouch(params)
        self._orientation_weights = {
            "ground": np.array(params.orientation_weight),
            "leap": np.array(params.leap_orientation_weight),
            "flight": np.array(params.flight_orientation_weight),
        }

    def reset(self, dynamics: Dynamics) -> None:
        """Begin where the robot stands."""
        self.crouch.reset()
        self.balance = self._params.balance_ahead
        self._set_yaw(_measured_yaw(dynamics))
        self.ground = min(feet.sole_height(dynamics, foot) for foot in range(2))

    def _set_yaw(self, yaw: float) -> None:
        self.yaw = yaw
        self.to_heading = rotations.rotation_z(-yaw)[:2, :2]

    def update(self, dynamics: Dynamics, command: SmoothCommand, plan: GaitPlan, ground: Ground, dt: float) -> None:
        """Follow the robot and the command for one tick.

        Args:
            dynamics: updated.
            command: to follow.
            plan: at this tick.
            ground: as the feet have found it.
            dt: [s].
        """
        self.ground += (self._below(dynamics, plan, ground) - self.ground) * min(dt / _GROUND_TIME, 1.0)
        moving = plan.mode in (Mode.WALKING, Mode.LEAPING)
        self._turn(dynamics, command.omega if moving else None, dt)
        self.crouch.advance(dt)
        height, orientation = self.height, self.orientation
        height.target = self.ground + dynamics.robot.nominal_height + command.h - self.crouch.depth
        height.rate = command.h_rate - self.crouch.rate
        if plan.mode is Mode.WALKING:
            height.rate += float(self.to_heading.dot(ground.gradient).dot(command.velocity))
        orientation.yaw = self.yaw
        orientation.yaw_rate = command.omega if moving else 0.0
        orientation.weight = self._orientation_weights["flight" if plan.airborne else "leap" if plan.legs else "ground"]
        orientation.pitch, orientation.pitch_rate = command.p, command.p_rate
        self.balance = balance_point(self._params, command.h, command.p, walking=plan.mode is not Mode.STANDING)

    def _below(self, dynamics: Dynamics, plan: GaitPlan, ground: Ground) -> float:
        """Height of the ground below the pelvis, by the feet that stand [m]; in flight what it was."""
        if plan.airborne:
            return self.ground
        if plan.stance is not None:
            sole, pelvis = dynamics.frame(feet.SOLES[plan.stance]), dynamics.frame("pelvis")
            return float(sole.position[2]) + ground.rise(sole.position, pelvis.position)
        standing = plan.legs or (0, 1)
        return sum(feet.sole_height(dynamics, foot) for foot in standing) / len(standing)

    def _turn(self, dynamics: Dynamics, omega: float | None, dt: float) -> None:
        """Turn the heading at a rate [rad/s], or without one to where the feet point; stay near the measured yaw."""
        measured = _measured_yaw(dynamics)
        if omega is not None:
            turn = omega * dt
        else:
            turn = _clip(float(rotations.wrap_angle(feet.feet_yaw(dynamics) - self.yaw)), _YAW_RETURN * dt)
        lead = float(rotations.wrap_angle(self.yaw + turn - measured))
        self._set_yaw(measured + _clip(lead, _MAX_YAW_LEAD))


def _measured_yaw(dynamics: Dynamics) -> float:
    forward = dynamics.frame("pelvis").rotation[:2, 0]
    return math.atan2(forward[1], forward[0])


def _clip(value: float, bound: float) -> float:
    return min(max(value, -bound), bound)
