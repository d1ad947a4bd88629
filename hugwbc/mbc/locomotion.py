"""From a smooth command to task targets and contacts: standing, shifting weight, walking and leaping."""

import functools
import math

import numpy as np

from hugwbc import rotations
from hugwbc.gait import Gait
from hugwbc.mbc.command_filter import SmoothCommand
from hugwbc.mbc.crouch import Crouch
from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.footsteps import Pendulum, StepPlan, nominal_offset, plan_step
from hugwbc.mbc.gait_plan import GaitPlan, Mode
from hugwbc.mbc.ground import Ground
from hugwbc.mbc.leap import Leap
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.qp import CONTACT_POINTS
from hugwbc.mbc.reach import balance_point, toe_down
from hugwbc.mbc.step_timing import time_step
from hugwbc.mbc.swing import SwingTrajectory
from hugwbc.mbc.tasks import (
    AngularMomentumTask,
    CentreOfMassTask,
    PelvisHeightTask,
    PelvisOrientationTask,
    PelvisTravelTask,
    PostureTask,
    StanceContactTask,
    SwingFootTask,
    Task,
)
from hugwbc.mbc.velocity_trim import VelocityTrim
from hugwbc.robot import SIDES, load_robot

_SOLES = tuple(f"{side}_sole" for side in SIDES)
_SHANKS = tuple(f"{side}_knee_link" for side in SIDES)
_ENDS = tuple(tuple(CONTACT_POINTS[2 * foot : 2 * foot + 2]) for foot in range(len(SIDES)))  # heel and toe of each foot
_SOLE_MIDDLE = sum(load_robot().sole_x) / 2.0  # [m], ahead of the ankle
_MAX_YAW_LEAD = 0.3  # [rad], of the yaw reference before the measured yaw
_YAW_RETURN = 0.5  # [rad/s], of the reference to the feet's heading when standing
_GROUND_TIME = 0.1  # [s], smoothing of the ground height from one stance foot to the next
_POSITION_JUMP = (
    0.05  # [m], of the pelvis within a tick, beyond what its velocity explains: the position's, not the robot's
)
_SETTLE_HEIGHT, _SETTLE_GAIN, _SETTLE_SPEED = 0.002, 10.0, 0.3  # [m], [1/s], [m/s]
_LEVEL_TOLERANCE = 0.008  # [m], by which one end of a sole may be higher and still carry load
_STOP_SPEED, _STOP_TURN, _STOP_STRIDE = 0.06, 0.1, 0.03  # [m/s], [rad/s], [m]
_SHIFT_TOLERANCE, _SHIFT_MARGIN = 0.015, 0.02  # [m]


class Locomotion:
    """Owns the gait plan, the foot trajectories and the targets of the tasks that depend on them.

    Attributes:
        plan: the gait clock.
        ground: as the feet have found it.
        contact: whether the left and the right foot stand, shape (2,), bool.
        footholds: where the soles' centres of the feet in the air are to land, world [m], shape (2, 2); NaN for the
            others.
        height, orientation, momentum, com, travel, stance, swing: tasks.
        out_of_reach: ticks since the reset in which the foothold of a walk was out of reach.
    """

    def __init__(self, params: ControllerParams) -> None:
        self._params = params
        self.plan = GaitPlan(params.gather_time)
        self.height = PelvisHeightTask(params)
        self.orientation = PelvisOrientationTask(params)
        self.com = CentreOfMassTask(params)
        self.momentum = AngularMomentumTask(params)
        self.travel = PelvisTravelTask(params)
        self.stance = tuple(StanceContactTask(params, side) for side in SIDES)
        self.swing = tuple(SwingFootTask(params, side) for side in SIDES)
        self.free_leg = tuple(self._make_free_leg(side) for side in SIDES)
        self.ground = Ground()
        self._trajectory = SwingTrajectory(params)
        self._trim = VelocityTrim(params)
        self._leap = Leap(params)
        self._crouch = Crouch(params)
        self._swing_weights = {
            "flight": np.array(params.flight_swing_weight),
            "ground": np.array([*params.swing_weight, *params.swing_rotation_weight]),
        }
        self._orientation_weights = {
            "ground": np.array(params.orientation_weight),
            "leap": np.array(params.leap_orientation_weight),
            "flight": np.array(params.flight_orientation_weight),
        }

    def _make_free_leg(self, side: str) -> PostureTask:
        robot, params = load_robot(), self._params
        joints = robot.indices(
            [f"{side}_{part}_joint" for part in ("hip_yaw", "hip_roll", "hip_pitch", "knee", "ankle")]
        )
        task = PostureTask(f"{side} free leg", joints, 10.0)
        task.target[:] = params.free_leg_posture
        task.stiffness[:], task.damping[:] = params.free_leg_gains
        task.weight[:] = params.free_leg_weight
        return task

    def reset(self, dynamics: Dynamics) -> None:
        """Stand where the robot is."""
        self.plan.reset()
        self._trim.reset()
        self._leap.reset()
        self.contact = np.ones(2, dtype=bool)
        self.footholds = np.full((2, 2), np.nan)
        self.out_of_reach = 0
        self._landed = self._loaded = False
        self._noted = False
        self.ground.reset()
        self._shifted = False
        self._crouch.reset()
        self._catching = 0.0
        self._catching_swing = 0
        self._balance = self._params.balance_ahead
        self._set_yaw(self._measured_yaw(dynamics))
        self._ground = min(self._height(dynamics, foot) for foot in range(2))
        self._position = dynamics.frame("pelvis").position

    def _set_yaw(self, yaw: float) -> None:
        """Set the heading that the robot is to have."""
        self._yaw = yaw
        self._to_heading = rotations.rotation_z(-yaw)[:2, :2]

    def tasks(self) -> list[Task]:
        """The tasks that count at this tick."""
        self.momentum.planned = self._leap.momentum_rate
        tasks: list[Task] = [self.orientation, self.momentum]
        if self.plan.legs:
            if self.planned_forces is not None:
                tasks.append(self._leap.motion)
        else:
            tasks += [self.height, self.travel if self.plan.mode is Mode.WALKING else self.com]
        for foot in range(2):
            in_air = self.free_leg[foot] if self.plan.legs and foot not in self.plan.legs else self.swing[foot]
            tasks.append(self.stance[foot] if self.contact[foot] else in_air)
        return tasks

    def update(self, dynamics: Dynamics, command: SmoothCommand, dt: float) -> None:
        """Advance the plan by one tick and set every target."""
        self.footholds[:] = np.nan
        self._follow_jumps(dynamics, dt)
        self._catching = max(self._catching - dt, 0.0)
        catching = self._catching > 0.0
        # A leap's feet are judged by their place: they land at once, or not at all.
        walks = self.contact & (not self.plan.legs)
        self.ground.update(dynamics, walks, self._yaw, dt)
        if self.plan.mode is Mode.WALKING:
            self._watch_landing(dynamics)
        lift_off = self.plan.advance(
            Gait.WALKING if catching else command.gait,
            command.f,
            dt,
            may_start=self._shifted or catching,
            first_swing=self._catching_swing if catching else 0,
            may_stop=self._may_stop(dynamics, command),
            landed=self._loaded,
        )
        # The leg of a hop leans inwards by 0.2 rad, and the foot with it.
        dynamics.edge = float(dynamics.robot.sole_y[1]) if len(self.plan.legs) == 1 else 0.0
        self._update_references(dynamics, command, dt)
        if self.plan.mode is Mode.WALKING:
            self._walk(dynamics, command, dt, lift_off)
        elif self.plan.legs:
            self._jump(dynamics, command, dt, lift_off)
        else:
            self.contact[:] = True
            self._trim.reset()
            self._leap.fly()
            self._stand(dynamics, command)
        for foot, stance in enumerate(self.stance):
            if self.contact[foot]:
                stance.settle = self._settle_speed(dynamics, foot)
                stance.slope = float(self.ground.slopes[foot])

    def _follow_jumps(self, dynamics: Dynamics, dt: float) -> None:
        """Where the position jumps, as an estimator's may, all that is remembered in the world jumps along."""
        pelvis = dynamics.frame("pelvis")
        offset = pelvis.position - self._position - pelvis.velocity[:3] * dt
        self._position = pelvis.position
        if offset.dot(offset) < _POSITION_JUMP**2:
            return
        self._ground += float(offset[2])
        self.ground.shift(offset)
        for trajectory in (self._trajectory, *self._leap.trajectories):
            trajectory.shift(offset)

    @property
    def foothold(self) -> np.ndarray | None:
        """The foothold of the only foot in the air, world [m], shape (2,); None if none or both are."""
        planned = self.footholds[np.isfinite(self.footholds[:, 0])]
        return planned[0] if len(planned) == 1 else None

    @property
    def failed_plans(self) -> int:
        """Force plans since the reset that were not solved."""
        return self._leap.failures

    @property
    def planned_forces(self) -> np.ndarray | None:
        """Contact forces of the force plan [N], shape (4, 3); None without one."""
        return self._leap.forces

    @property
    def settled(self) -> bool:
        """Whether the robot stands, and has stood long enough to have come to rest: only then may it squat deeply."""
        return self.plan.mode is Mode.STANDING and self.plan.elapsed >= self._params.settle_time

    @property
    def waiting(self) -> bool:
        """Whether the weight is still on its way onto the leg that is to hop.

        A series that begins with a turn at full speed, before the foot has anything to push against, rolls over.
        """
        return self.plan.mode is Mode.SHIFTING and self.plan.gait.hops

    def contact_points(self, dynamics: Dynamics) -> np.ndarray:
        """Whether the ground may push at each of the QP's contact points, shape (4,), bool.

        The lowest end of a standing foot always, the other end once it is about as low or the sole rests: a foot that
        lands on its toe first must not count on its heel. A foot that has just come down, not before it carries.
        """
        pushes = []
        for foot, (carries, rests) in enumerate(zip(self.contact.tolist(), self.ground.resting.tolist(), strict=True)):
            carries = carries and (foot != self.plan.swing or self._loaded)
            if rests or not carries:
                pushes += [carries, carries]
                continue
            heights = [float(dynamics.point(end)[2]) for end in _ENDS[foot]]
            lowest = min(heights)
            if self.plan.legs:  # a landing presses one end into the ground: the other end is not in the air for that
                lowest = max(lowest, self._ground)
            pushes += [height < lowest + _LEVEL_TOLERANCE for height in heights]
        return np.array(pushes)

    def _update_references(self, dynamics: Dynamics, command: SmoothCommand, dt: float) -> None:
        stance = self.plan.stance
        if self.plan.airborne:
            ground = self._ground
        elif stance is not None:
            sole, pelvis = dynamics.frame(_SOLES[stance]), dynamics.frame("pelvis")
            ground = float(sole.position[2]) + self.ground.rise(sole.position, pelvis.position)
        else:
            standing = self.plan.legs or (0, 1)
            ground = sum(self._height(dynamics, foot) for foot in standing) / len(standing)
        self._ground += (ground - self._ground) * min(dt / _GROUND_TIME, 1.0)
        yaw = self._measured_yaw(dynamics)
        moving = self.plan.mode in (Mode.WALKING, Mode.LEAPING)
        if moving:
            turn = command.omega * dt
        else:
            turn = _clip(float(rotations.wrap_angle(self._feet_yaw(dynamics) - self._yaw)), _YAW_RETURN * dt)
        self._set_yaw(yaw + _clip(float(rotations.wrap_angle(self._yaw + turn - yaw)), _MAX_YAW_LEAD))
        self._crouch.advance(dt)
        self.height.target = self._ground + dynamics.robot.nominal_height + command.h - self._crouch.depth
        self.height.rate = command.h_rate - self._crouch.rate
        if self.plan.mode is Mode.WALKING:
            self.height.rate += float(self._to_heading.dot(self.ground.gradient).dot(command.velocity))
        self.orientation.yaw = self.com.heading = self._yaw
        self.orientation.yaw_rate = command.omega if moving else 0.0
        self.orientation.weight = self._orientation_weights[
            "flight" if self.plan.airborne else "leap" if self.plan.legs else "ground"
        ]
        self._balance = balance_point(self._params, command.h, command.p, walking=self.plan.mode is not Mode.STANDING)
        self.orientation.pitch, self.orientation.pitch_rate = command.p, command.p_rate

    def _stand(self, dynamics: Dynamics, command: SmoothCommand) -> None:
        """Centre of mass between the feet; before the first step, across to where that step needs it."""
        params = self._params
        pivots = [self._pivot(dynamics, foot) for foot in range(2)]
        middle = 0.5 * (pivots[0] + pivots[1])
        self.com.target = middle[:2]
        self.com.feedforward = np.zeros(2)
        self.com.servo = np.ones(2)
        pendulum = Pendulum.about(middle, dynamics)
        to_heading = self._to_heading
        deviation, between = to_heading.dot(pendulum.dcm - middle[:2]), to_heading.dot((pivots[0] - pivots[1])[:2])
        if self.plan.mode is not Mode.SHIFTING:
            # A robot that is loaded to one side, unknown to the plan, never gets nearer.
            self._shifted = math.hypot(*deviation.tolist()) < params.jump_calm or self.settled
            self._watch_balance(deviation, between)
            return
        if self.plan.gait is not Gait.WALKING:
            # The weight is to come over the outer foot, and may pass it a little.
            self._watch_balance(deviation, between + np.array([0.0, 2.0 * params.hop_overshoot]))
            self._shift_onto(pivots[0 if self.plan.gait is Gait.HOPPING_LEFT else 1][:2], middle[:2], pendulum)
            return
        left, right = ((to_heading @ pivot[:2])[1] for pivot in pivots)
        width = max(params.step_width, params.min_foot_distance)
        wanted = right + nominal_offset(np.zeros(2), 0.0, self.plan.step_time, pendulum.omega, width, 1)[1]
        dcm, com = (to_heading @ pendulum.dcm)[1], (to_heading @ pendulum.com)[1]
        growth = np.exp(pendulum.omega * max(params.shift_time - self.plan.elapsed, 0.05))
        cop = np.clip((wanted - growth * dcm) / (1.0 - growth), right + _SHIFT_MARGIN, left - _SHIFT_MARGIN)
        self.com.feedforward[1] = pendulum.omega**2 * (com - cop)
        self.com.servo[1] = 0.0
        arrived = self.plan.elapsed >= params.shift_time and abs(dcm - wanted) < _SHIFT_TOLERANCE
        self._shifted = bool(arrived or self.plan.elapsed >= params.max_shift_time)

    def _shift_onto(self, pivot: np.ndarray, middle: np.ndarray, pendulum: Pendulum) -> None:
        """Move the centre of mass over the foot that is to hop."""
        share = min(self.plan.elapsed / self._params.hop_shift_time, 1.0)
        self.com.target = middle + share * (pivot - middle)
        gaps = (float(np.linalg.norm(point - pivot)) for point in (pendulum.com, pendulum.dcm))
        # With time the demands fall: an estimated position may never quite arrive.
        patience = max(self.plan.elapsed / self._params.hop_shift_time - 2.0, 1.0)
        self._shifted = share >= 1.0 and max(gaps) < self._params.hop_shift_tolerance * min(patience, 2.0)

    def _watch_balance(self, deviation: np.ndarray, between_feet: np.ndarray) -> None:
        """Start stepping when the divergent component leaves what two standing feet can hold.

        Args:
            deviation: of the divergent component from the middle of the feet, heading frame [m], shape (2,).
            between_feet: from the right to the left foot, heading frame [m], shape (2,).
        """
        across = 0.5 * abs(between_feet[1]) - self._params.capture_margin
        if abs(deviation[0]) > self._params.capture_distance or abs(deviation[1]) > across:
            self._catching = self._params.capture_time
            # Pushed to the left, stand on the left foot and bring the right one along; the next left step goes out.
            self._catching_swing = 1 if deviation[1] > 0.0 else 0

    def _walk(self, dynamics: Dynamics, command: SmoothCommand, dt: float, lift_off: bool) -> None:
        plan = self.plan
        swing, stance = plan.swing, plan.stance
        assert swing is not None and stance is not None
        self._trim.measure(self._to_heading.dot(dynamics.frame("pelvis").velocity[:2]), command.velocity, dt)
        if lift_off:
            self._trajectory.start(dynamics.frame(_SOLES[swing]).position)
            self._landed = self._loaded = self._noted = False
            self._trim.end_step()
        pendulum = Pendulum.about(self._pivot(dynamics, stance), dynamics, self.ground.gradient)
        step = self._plan_step(command, pendulum, swing)
        self.out_of_reach += any(step.missed)
        landing_yaw = self._yaw + command.omega * plan.remaining
        ahead = _SOLE_MIDDLE - self._balance
        foothold = step.foothold + np.array([ahead * math.cos(landing_yaw), ahead * math.sin(landing_yaw)])
        self.footholds[swing] = foothold
        elapsed = plan.duration - plan.remaining
        if not self._noted and 2.0 * elapsed > plan.duration:
            self.ground.note(dynamics, stance)
            self._noted = True
        standing = dynamics.frame(_SOLES[stance]).position
        height = float(standing[2])
        upright = self.height.target + self._crouch.depth - height
        self._crouch.prepare(dynamics, pendulum, step, swing, plan.remaining, upright)
        self._trajectory.advance(
            foothold,
            command.l,
            height,
            elapsed,
            plan.remaining,
            dt,
            landing=height + self.ground.rise(standing, foothold),
            overdue=plan.overdue,
        )
        self.contact[stance], self.contact[swing] = True, self._landed

        task = self.swing[swing]
        task.position, task.velocity = self._trajectory.position, self._trajectory.velocity
        task.acceleration = self._trajectory.acceleration
        task.weight = self._swing_weights["ground"]
        task.yaw = landing_yaw
        task.pitch = self._toe_down(dynamics, swing, self.ground.slope_along(landing_yaw))
        self.travel.heading, self.travel.speed = self._yaw, float(command.velocity[0])
        self.travel.feedforward = pendulum.omega**2 * float(self._to_heading[0].dot(pendulum.com - step.cop))

    def _plan_step(self, command: SmoothCommand, pendulum: Pendulum, swing: int) -> StepPlan:
        """Where to step, and in a disturbed walk when; the gait's clock follows."""
        plan = self.plan
        plan_at = functools.partial(
            plan_step,
            self._params,
            pendulum,
            command.velocity + self._trim.value,
            command.omega,
            self._yaw,
            self._balance,
            swing,
            plan.step_time,
        )
        remaining = plan.remaining
        step = plan_at(remaining)
        if self._params.step_timing <= 0.0 or remaining <= 0.0 or self._landed:
            return step
        elapsed = plan.duration - remaining
        chosen, step = time_step(self._params, plan_at, step, self._trajectory, plan.step_time, elapsed, remaining)
        if chosen != remaining:
            plan.retime(chosen)
        return step

    def _watch_landing(self, dynamics: Dynamics) -> None:
        """Notice that the swing foot of a walk stands, and that it carries.

        At its expected height it stands, until the step is over: if it does not carry then, the ground is lower.
        """
        plan, params = self.plan, self._params
        swing, stance = plan.swing, plan.stance
        assert swing is not None and stance is not None
        early = plan.duration - plan.remaining <= params.early_contact_phase * plan.duration
        if early or (self._landed and self._loaded):
            return
        standing, sole = (dynamics.frame(_SOLES[foot]).position for foot in (stance, swing))
        expected = float(standing[2]) + self.ground.rise(standing, sole)
        near = self._lowest(dynamics, swing) - expected < params.early_contact_height
        touched = self.ground.touched(dynamics, swing)
        if touched is None:  # only its height tells, and the clock
            self._loaded = True
            self._landed |= near
        else:
            self._loaded |= touched
            self._landed = self._loaded or (plan.remaining > 0.0 and (self._landed or near))

    def _jump(self, dynamics: Dynamics, command: SmoothCommand, dt: float, lift_off: bool) -> None:
        plan, leap = self.plan, self._leap
        self._trim.measure(self._to_heading.dot(dynamics.frame("pelvis").velocity[:2]), command.velocity, dt)
        velocity = command.velocity + self._trim.value
        if lift_off:
            self._trim.end_step()
            for foot in plan.legs:
                leap.trajectories[foot].start(dynamics.frame(_SOLES[foot]).position)
            self.contact[:] = False
        if plan.airborne:
            elapsed = plan.step_time - plan.remaining
            for foot in plan.legs:
                self._fly(dynamics, command, foot, velocity, elapsed, dt)
        else:
            self.contact[:] = False
            self.contact[list(plan.legs)] = True
        if all(self.contact[foot] for foot in plan.legs):
            leap.push(dynamics, command, plan, self.orientation, velocity, self.height.target, dt)
        else:
            leap.fly()

    def _fly(
        self, dynamics: Dynamics, command: SmoothCommand, foot: int, velocity: np.ndarray, elapsed: float, dt: float
    ) -> None:
        """Path of a foot in flight."""
        plan, trajectory, task = self.plan, self._leap.trajectories[foot], self.swing[foot]
        yaw = self._leap.landing_yaw(command, plan, self._yaw)
        pivot = self._leap.foothold(dynamics, command, plan, self._yaw, velocity, foot, self._ground)
        ahead = _SOLE_MIDDLE - self._balance
        self.footholds[foot] = pivot + rotations.rotation_z(yaw)[:2, 0] * ahead
        trajectory.advance(self.footholds[foot], command.l, self._ground, elapsed, plan.remaining, dt)
        if elapsed > self._params.early_contact_phase * plan.step_time:
            self.contact[foot] |= self._lowest(dynamics, foot) - self._ground < self._params.early_contact_height
        task.position, task.velocity = trajectory.position, trajectory.velocity
        task.acceleration = trajectory.acceleration
        task.yaw, task.pitch = yaw, self._toe_down(dynamics, foot)
        task.weight = self._swing_weights["flight"]

    def _may_stop(self, dynamics: Dynamics, command: SmoothCommand) -> bool:
        if math.hypot(*command.velocity.tolist()) > _STOP_SPEED or abs(command.omega) > _STOP_TURN:
            return False
        if self.plan.legs:
            return True
        gap = dynamics.frame("left_sole").position - dynamics.frame("right_sole").position
        return abs(float(self._to_heading[0].dot(gap[:2]))) < _STOP_STRIDE

    def _pivot(self, dynamics: Dynamics, foot: int) -> np.ndarray:
        """Nominal centre of pressure of a foot, in the world [m], shape (3,)."""
        sole = dynamics.frame(_SOLES[foot])
        x, y = sole.rotation[:2, 0].tolist()
        ahead = (self._balance - _SOLE_MIDDLE) / max(math.hypot(x, y), 1e-6)
        return sole.position + np.array([ahead * x, ahead * y, 0.0])

    def _settle_speed(self, dynamics: Dynamics, foot: int) -> float:
        touched = None if self.plan.legs else self.ground.touched(dynamics, foot)
        if touched is not None:
            return 0.0 if touched else _SETTLE_SPEED
        height = self._lowest(dynamics, foot) - self._ground
        return 0.0 if height < _SETTLE_HEIGHT else min(_SETTLE_GAIN * height, _SETTLE_SPEED)

    @staticmethod
    def _lowest(dynamics: Dynamics, foot: int) -> float:
        return min(float(dynamics.point(end)[2]) for end in _ENDS[foot])

    @staticmethod
    def _height(dynamics: Dynamics, foot: int) -> float:
        return float(dynamics.frame(_SOLES[foot]).position[2])

    def _toe_down(self, dynamics: Dynamics, foot: int, slope: float = 0.0) -> float:
        """Pitch of the swing foot's sole over ground of a slope along it [rad]."""
        lean = math.asin(_clip(-float(dynamics.rotation(_SHANKS[foot])[2, 0]), 1.0))
        return toe_down(lean, float(self._to_heading[1].dot(dynamics.velocity(_SHANKS[foot])[3:5])), slope)

    @staticmethod
    def _measured_yaw(dynamics: Dynamics) -> float:
        forward = dynamics.frame("pelvis").rotation[:2, 0]
        return math.atan2(forward[1], forward[0])

    @staticmethod
    def _feet_yaw(dynamics: Dynamics) -> float:
        left, right = (dynamics.frame(sole).rotation for sole in _SOLES)
        return math.atan2(left[1, 0] + right[1, 0], left[0, 0] + right[0, 0])


def _clip(value: float, bound: float) -> float:
    return min(max(value, -bound), bound)
