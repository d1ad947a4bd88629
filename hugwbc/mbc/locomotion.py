"""From a filtered command to task targets and contacts in every gait."""

import math

import numpy as np

from hugwbc.gait import Gait
from hugwbc.mbc import feet
from hugwbc.mbc.command_filter import GaitState, SmoothCommand, VelocityTrim
from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.gait_plan import GaitPlan, Mode
from hugwbc.mbc.leap import Leap
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.references import References, Tick
from hugwbc.mbc.standing import Standing
from hugwbc.mbc.tasks import AngularMomentumTask, PostureTask, StanceContactTask, SwingFootTask, Task, swing_weights
from hugwbc.mbc.walking import Walking
from hugwbc.robot import SIDES, Robot, load_mirror

# Height above the ground from which a foot that should stand is lowered [m]; speed per height [1/s]; top speed [m/s].
_SETTLE_HEIGHT, _SETTLE_GAIN, _SETTLE_SPEED = 0.002, 10.0, 0.3
_LEVEL_TOLERANCE = 0.008  # [m], by which one end of a sole may be higher than the other and still carry load
_STOP_SPEED, _STOP_TURN, _STOP_STRIDE = 0.06, 0.1, 0.03  # [m/s], [rad/s], [m]: below these the robot may stop
_STRAY_SPEED, _STRAY_TIME = 0.3, 0.15  # [m/s], [s]: excess of speed that counts as a push, and its time constant
_POSITION_JUMP = 0.05  # [m], in one tick beyond the velocity: such a step of the pelvis is the estimator's, not real


class Locomotion:
    """Owns the gait plan and the tasks that depend on it.

    In every tick the ground is updated first, then the gait clock, then the references, and last the gait in progress.

    Attributes:
        plan: gait clock.
        ground: the ground as the feet have found it.
        references: heading, height and orientation of the pelvis.
        contact: whether the left and the right foot stand, shape (2,), bool.
        footholds: where the centres of the soles in the air should land, world x, y [m], shape (2, 2); NaN for others.
        walking, leap: the gaits' plans.
        momentum: task of the angular momentum.
        stance, swing, free_leg: tasks of the left and the right leg.
    """

    def __init__(self, params: ControllerParams, robot: Robot) -> None:
        self._params, self._robot = params, robot
        self.plan = GaitPlan(params.gather_time)
        self.ground = feet.Ground()
        self.references = References(params, self.plan, self.ground)
        self._standing = Standing(params, self.plan, self.references)
        self.walking = Walking(params, self.plan, self.references, self.ground)
        self.leap = Leap(params, self.plan, self.references, self._robot)
        self._trim = VelocityTrim(params)
        self.footholds = np.full((2, 2), np.nan)
        self.momentum = AngularMomentumTask(params)
        self.stance = tuple(StanceContactTask(params, side, robot) for side in SIDES)
        self.swing = tuple(SwingFootTask(params, side, robot) for side in SIDES)
        self.free_leg = tuple(self._make_free_leg(foot) for foot in range(len(SIDES)))
        self._swing_weights = {
            "flight": swing_weights(params.flight_swing_weight, robot),
            "ground": swing_weights((*params.swing_weight, *params.swing_rotation_weight), robot),
        }

    def _make_free_leg(self, foot: int) -> PostureTask:
        params, robot = self._params, self._robot
        joints = robot.legs.reshape(len(SIDES), -1)[foot]
        task = PostureTask(joints, 10.0, params.free_leg_gains)
        sign = 1.0 if foot == 0 else load_mirror(robot).joint_sign[joints]
        task.target[:] = sign * robot.leg_postures["tucked"] + 0.0
        task.weight[:] = params.free_leg_weight
        return task

    def reset(self, dynamics: Dynamics) -> None:
        """Stand where the robot is."""
        for part in (self.plan, self._trim, self.leap, self.ground, self._standing, self.walking):
            part.reset()
        self.references.reset(dynamics)
        self.contact = np.ones(2, dtype=bool)
        self.footholds[:] = np.nan
        self._position = dynamics.frame(dynamics.robot.base).position
        self._excess = 0.0

    def tasks(self) -> list[Task]:
        """Return the tasks that count in this tick."""
        self.momentum.planned = self.leap.momentum_rate
        tasks: list[Task] = [self.references.orientation, self.momentum]
        if self.plan.legs:
            # The force plan moves the centre of mass in the stance of a leap, and nothing does in flight.
            if self.leap.forces is not None:
                tasks.append(self.leap.motion)
        else:
            walks = self.plan.mode is Mode.WALKING
            tasks += [self.references.height, self.walking.travel if walks else self._standing.com]
        for foot in range(2):
            in_air = self.free_leg[foot] if self.plan.legs and foot not in self.plan.legs else self.swing[foot]
            tasks.append(self.stance[foot] if self.contact[foot] else in_air)
        return tasks

    def update(self, dynamics: Dynamics, command: SmoothCommand, dt: float) -> None:
        """Advance the plan by one tick and set every target."""
        plan, standing = self.plan, self._standing
        self.footholds[:] = np.nan
        standing.catching = max(standing.catching - dt, 0.0)
        catching = standing.catching > 0.0
        # Leaps take the ground to be level, and judge their feet by height: they land at once or not at all.
        walks = self.contact & (not plan.legs)
        self.ground.update(dynamics, walks, self.references.yaw, dt)
        if plan.mode is Mode.WALKING:
            self.walking.watch_landing(dynamics)
        lift_off = plan.advance(
            Gait.WALKING if catching else command.gait,
            command.f,
            dt,
            may_start=catching or (standing.ready and (command.posed or not command.gait.flight)),
            first_swing=standing.first_swing if catching else 0,
            may_stop=self._may_stop(dynamics, command),
            landed=self.walking.loaded,
        )
        dynamics.edge = feet.hop_edge(dynamics.robot) if len(plan.legs) == 1 else 0.0  # where the ground pushes
        self.references.update(dynamics, command, dt)
        if plan.mode is Mode.WALKING:
            self._walk(dynamics, command, dt, lift_off)
        elif plan.legs:
            self._jump(dynamics, command, dt, lift_off)
        else:
            self.contact[:] = True
            self._trim.reset()
            self._excess = 0.0
            self.leap.release()
            standing.update(dynamics)
        for foot, stance in enumerate(self.stance):
            if self.contact[foot]:
                stance.settle = self._settle_speed(dynamics, foot)
                stance.slope = float(self.ground.slopes[foot])

    def follow_jumps(self, position: np.ndarray, velocity: np.ndarray, dt: float) -> None:
        """Shift remembered world positions when the estimated position jumps.

        Args:
            position: of the pelvis as it was read, not predicted, world [m], shape (3,).
            velocity: of the pelvis, read at the same time, world [m/s], shape (3,).
            dt: time since the last tick [s].
        """
        offset = position - self._position - velocity * dt
        self._position = position
        if offset.dot(offset) < _POSITION_JUMP**2:
            return
        self.references.ground += float(offset[2])
        self.ground.shift(offset)
        for trajectory in (self.walking.trajectory, *self.leap.trajectories):
            trajectory.shift(offset)

    @property
    def turn(self) -> float:
        """Rate at which a jump turns on its standing feet [rad/s]; zero in other states."""
        stands = self.plan.on_both and self.leap.forces is not None
        return self.references.orientation.yaw_rate if stands else 0.0

    def state(self, fastest: float) -> GaitState:
        """Return the state of the legs for the command filter, on ground that allows a largest speed [m/s]."""
        walks = self.plan.mode is Mode.WALKING
        return GaitState(
            stepping=not self._standing.settled,
            running=self.plan.gait,
            # A series of hops that starts with a turn at full speed, before the foot can push against the ground, rolls
            # over: first the weight has to be over that foot.
            waiting=self.plan.mode is Mode.SHIFTING and self.plan.gait.hops,
            # Ordinary steps and starts change the speed as well, but by less.
            stray=self._excess if abs(self._excess) > _STRAY_SPEED and walks else 0.0,
            fastest=fastest,
        )

    def contact_points(self, dynamics: Dynamics) -> np.ndarray:
        """Return whether the ground may push at each contact point of the QP, shape (4,), bool.

        It always may at the lowest end of a standing foot. At the other end it may once that is about as low or the
        sole rests, since a foot that lands on its toe must not rely on its heel. At a foot that has just come down it
        may only once the foot carries weight.
        """
        pushes = []
        for foot, (carries, rests) in enumerate(zip(self.contact.tolist(), self.ground.resting.tolist(), strict=True)):
            carries = carries and (foot != self.plan.swing or self.walking.loaded)
            if rests or not carries:
                pushes += [carries, carries]
                continue
            heights = feet.end_heights(dynamics, foot)
            lowest = min(heights)
            if self.plan.legs:  # a landing presses one end into the ground, which does not lift the other one off it
                lowest = max(lowest, self.references.ground)
            pushes += [height < lowest + _LEVEL_TOLERANCE for height in heights]
        return np.array(pushes)

    def _measure(self, dynamics: Dynamics, command: SmoothCommand, dt: float) -> None:
        velocity = self.references.to_heading.dot(dynamics.frame(dynamics.robot.base).velocity[:2])
        self._trim.measure(velocity, command.velocity, dt)
        self._excess += (float(velocity[0] - command.velocity[0]) - self._excess) * min(dt / _STRAY_TIME, 1.0)

    def _walk(self, dynamics: Dynamics, command: SmoothCommand, dt: float, lift_off: bool) -> None:
        walking, swing, stance = self.walking, self.plan.swing, self.plan.stance
        assert swing is not None and stance is not None
        self._measure(dynamics, command, dt)
        if lift_off:
            walking.lift_off(dynamics)
            self._trim.end_step()
        task = self.swing[swing]
        tick = Tick(dynamics, command, command.velocity + self._trim.value, dt)
        self.footholds[swing] = walking.update(tick, task)
        task.weight = self._swing_weights["ground"]
        self.contact[stance], self.contact[swing] = True, walking.landed

    def _jump(self, dynamics: Dynamics, command: SmoothCommand, dt: float, lift_off: bool) -> None:
        plan, leap = self.plan, self.leap
        self._measure(dynamics, command, dt)
        tick = Tick(dynamics, command, command.velocity + self._trim.value, dt)
        if lift_off:
            self._trim.end_step(leap=True)
            leap.lift_off(dynamics)
            self.contact[:] = False
        if plan.airborne:
            for foot in plan.legs:
                self.footholds[foot] = leap.fly(tick, foot, self.swing[foot])
                self.swing[foot].weight = self._swing_weights["flight"]
                self.contact[foot] |= leap.lands(dynamics, foot)
        else:
            self.contact[:] = False
            self.contact[list(plan.legs)] = True
        if all(self.contact[foot] for foot in plan.legs):
            leap.push(tick)
        else:
            leap.release()

    def _may_stop(self, dynamics: Dynamics, command: SmoothCommand) -> bool:
        """Return whether the robot can stand where the current step ends: slow, and with its feet side by side."""
        if math.hypot(*command.velocity.tolist()) > _STOP_SPEED or abs(command.omega) > _STOP_TURN:
            return False
        if self.plan.legs:
            return True
        gap = dynamics.frame("left_sole").position - dynamics.frame("right_sole").position
        return abs(float(self.references.to_heading[0].dot(gap[:2]))) < _STOP_STRIDE

    def _settle_speed(self, dynamics: Dynamics, foot: int) -> float:
        """Return the downward speed of a foot that should stand [m/s].

        It goes down until it carries weight or, in a leap or without foot forces, until it is as low as the ground.
        """
        carries = None if self.plan.legs else self.ground.carries(dynamics, foot)
        if carries is not None:
            return 0.0 if carries else _SETTLE_SPEED
        height = min(feet.end_heights(dynamics, foot)) - self.references.ground
        return 0.0 if height < _SETTLE_HEIGHT else min(_SETTLE_GAIN * height, _SETTLE_SPEED)
