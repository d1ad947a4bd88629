"""References of all gaits: heading, ground height, balance point and the pelvis's targets."""

import math
from typing import NamedTuple

import numpy as np

from hugwbc import rotations
from hugwbc.mbc import feet
from hugwbc.mbc.command_filter import SmoothCommand, approach
from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.footsteps import StepPlan, StepRequest
from hugwbc.mbc.gait_plan import GaitPlan, Mode
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.reach import balance_point, leap_rise
from hugwbc.mbc.tasks import PelvisHeightTask, PelvisOrientationTask

_MAX_YAW_LEAD = 0.3  # [rad], largest lead of the yaw reference over the measured yaw
_YAW_RETURN = 0.5  # [rad/s], rate at which the reference returns to the feet's heading when standing
_GROUND_TIME = 0.1  # [s], time constant of the ground height from one stance foot to the next


class Tick(NamedTuple):
    """The inputs of a gait in one tick of the controller."""

    dynamics: Dynamics  # robot model at the current state
    command: SmoothCommand  # command to follow
    velocity: np.ndarray  # planned velocity, the command's with the trim's correction, heading frame [m/s], shape (2,)
    dt: float  # time since the last tick [s]


class References:
    """Heading, ground height and balance point of the plan, and the tasks of the pelvis.

    Attributes:
        yaw: heading that the robot should have [rad].
        to_heading: rotation from world x and y into the frame along that heading, shape (2, 2).
        ground: height of the ground below the pelvis, in the world [m].
        balance: nominal centre of pressure, and of mass when standing, ahead of the ankles [m].
        crouch: lowering of the pelvis for long steps.
        height, orientation: tasks of the pelvis.
    """

    def __init__(self, params: ControllerParams, plan: GaitPlan, ground: feet.Ground) -> None:
        """Set up for a gait plan and the ground, which the caller updates first in every tick."""
        self._params, self._plan, self._ground = params, plan, ground
        self.height = PelvisHeightTask(params)
        self.orientation = PelvisOrientationTask(params)
        self.crouch = Crouch(params)
        self._orientation_weights = {
            "ground": np.array(params.orientation_weight),
            "leap": np.array(params.leap_orientation_weight),
            "flight": np.array(params.flight_orientation_weight),
        }

    def reset(self, dynamics: Dynamics) -> None:
        """Start where the robot stands."""
        self.crouch.reset()
        self.balance = self._params.balance_ahead
        self._set_yaw(_measured_yaw(dynamics))
        self.ground = min(feet.sole_height(dynamics, foot) for foot in range(2))

    def _set_yaw(self, yaw: float) -> None:
        self.yaw = yaw
        self.to_heading = rotations.rotation_z(-yaw)[:2, :2]

    def update(self, dynamics: Dynamics, command: SmoothCommand, dt: float) -> None:
        """Follow the robot and the command for one tick."""
        plan = self._plan
        self.ground += (self._below(dynamics) - self.ground) * min(dt / _GROUND_TIME, 1.0)
        moving = plan.mode in (Mode.WALKING, Mode.LEAPING)
        self._turn(dynamics, command.omega if moving else None, dt)
        self.crouch.advance(dt)
        height, orientation = self.height, self.orientation
        height.target = self.ground + dynamics.robot.nominal_height + command.h - self.crouch.depth
        height.rate = command.h_rate - self.crouch.rate
        if plan.mode is Mode.WALKING:
            # On a slope the ground below the pelvis rises as the robot walks; without the rate the height would lag.
            height.rate += float(self.to_heading.dot(self._ground.gradient).dot(command.velocity))
        orientation.yaw = self.yaw
        orientation.yaw_rate = command.omega if moving else 0.0
        orientation.weight = self._orientation_weights["flight" if plan.airborne else "leap" if plan.legs else "ground"]
        orientation.pitch, orientation.pitch_rate = command.p, command.p_rate
        walks = plan.mode is not Mode.STANDING
        # In its stance a jump sinks by this much on average: its ankles must not reach the end of their range there.
        sinking = 2.0 / 3.0 * leap_rise(command.f) if plan.on_both else 0.0
        self.balance = balance_point(self._params, command.h - sinking, command.p, walking=walks, robot=dynamics.robot)

    def _below(self, dynamics: Dynamics) -> float:
        """Return the height of the ground below the pelvis [m] by the standing feet; in flight, the last one."""
        plan, ground = self._plan, self._ground
        if plan.airborne:
            return self.ground
        if plan.stance is not None:
            sole, pelvis = dynamics.frame(feet.SOLES[plan.stance]), dynamics.frame(dynamics.robot.base)
            return float(sole.position[2]) + ground.rise(sole.position, pelvis.position)
        standing = plan.legs or (0, 1)
        return sum(feet.sole_height(dynamics, foot) for foot in standing) / len(standing)

    def _turn(self, dynamics: Dynamics, omega: float | None, dt: float) -> None:
        """Turn the heading at a rate [rad/s], or without one towards where the feet point.

        The heading stays near the measured yaw: otherwise it would run away from a robot that cannot turn as fast.
        """
        measured = _measured_yaw(dynamics)
        if omega is not None:
            turn = omega * dt
        else:
            turn = _clip(float(rotations.wrap_angle(feet.feet_yaw(dynamics) - self.yaw)), _YAW_RETURN * dt)
        lead = float(rotations.wrap_angle(self.yaw + turn - measured))
        self._set_yaw(measured + _clip(lead, _MAX_YAW_LEAD))


class Crouch:
    """Lowering of the pelvis by which both legs reach the ground at the end of a long step.

    A pushed robot steps further than its legs reach from the commanded height: the foot would come down late, and the
    straight trailing leg could not be lifted. Steps within the ranges of the commands need no crouch.

    Attributes:
        depth: distance of the pelvis below the commanded height [m].
        rate: rate of the depth [m/s].
    """

    def __init__(self, params: ControllerParams) -> None:
        self._params = params
        self.reset()

    def reset(self) -> None:
        """Stand upright."""
        self.depth = self.rate = 0.0
        self._needed = 0.0

    def advance(self, dt: float) -> None:
        """Lower to the depth requested by `prepare` since the last call, otherwise rise slowly."""
        params = self._params
        limits = params.crouch_rate if self._needed > self.depth else params.rise_rate
        if self._needed or self.depth or self.rate:
            self.depth, self.rate = approach(self.depth, self.rate, self._needed, limits, dt)
        self._needed = 0.0

    def prepare(
        self, dynamics: Dynamics, request: StepRequest, step: StepPlan, remaining: float, height: float
    ) -> None:
        """Determine the depth that a step needs.

        Args:
            dynamics: robot model at the current state.
            request: step to take.
            step: its plan.
            remaining: time to the end of the step [s].
            height: height of the pelvis above the stance sole without a crouch [m].
        """
        pendulum, swing = request.pendulum, request.swing
        x, y = (step.foothold - pendulum.pivot).tolist()
        if math.hypot(x, y) <= self._params.long_step:
            return
        pelvis = dynamics.position(dynamics.robot.base)
        # The hips travel with the centre of mass until the foot comes down; a leg's length then bounds their height.
        travel = pendulum.com_after(step.cop, remaining) - pendulum.com
        longest = dynamics.robot.leg_length - self._params.leg_reserve
        for foot, pivot in ((1 - swing, pendulum.pivot), (swing, step.foothold)):
            hip = dynamics.position(dynamics.robot.moved["hip_pitch"][foot])
            above = height + float(hip[2] - pelvis[2]) - dynamics.robot.sole_depth
            offset = hip[:2] + travel - pivot
            allowed = math.sqrt(max(longest**2 - float(offset.dot(offset)), 0.0))
            self._needed = max(self._needed, above - allowed)
        self._needed = min(self._needed, self._params.max_crouch)


def _measured_yaw(dynamics: Dynamics) -> float:
    forward = dynamics.frame(dynamics.robot.base).rotation[:2, 0]
    return math.atan2(forward[1], forward[0])


def _clip(value: float, bound: float) -> float:
    return min(max(value, -bound), bound)
