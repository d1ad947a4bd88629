"""One walking step: its foothold and timing, the swing trajectory, and the landing."""

import math

import numpy as np

from hugwbc.mbc import feet
from hugwbc.mbc.command_filter import SmoothCommand
from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.footsteps import Pendulum, StepPlan, StepRequest, plan_step, time_step
from hugwbc.mbc.gait_plan import GaitPlan
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.reach import cop_reach, highest_fall, highest_lift
from hugwbc.mbc.references import References, Tick
from hugwbc.mbc.swing import BRISKNESS, SwingTrajectory
from hugwbc.mbc.tasks import PelvisTravelTask, SwingFootTask


class Walking:
    """Plans the current step again at every tick, from the measured state.

    Attributes:
        travel: task of the pelvis along the heading.
        trajectory: path of the foot in the air.
        landed: whether that foot stands.
        loaded: whether it carries weight.
        out_of_reach: number of ticks since the reset in which the foothold was out of reach.
    """

    def __init__(self, params: ControllerParams, plan: GaitPlan, references: References, ground: feet.Ground) -> None:
        """Set up for a gait plan, its references and the ground, which the caller updates first in every tick.

        A walk may retime the clock of the plan.
        """
        self._params, self._plan, self._references, self._ground = params, plan, references, ground
        self.travel = PelvisTravelTask(params)
        self.trajectory = SwingTrajectory(params)
        self.reset()

    def reset(self) -> None:
        """Forget the current step and the count of footholds out of reach."""
        self.out_of_reach = 0
        self.landed = self.loaded = False
        self._noted = False
        self._late = 0.0

    def lift_off(self, dynamics: Dynamics) -> None:
        """Start a step: the swing foot of the plan leaves the ground."""
        assert self._plan.swing is not None
        self.trajectory.start(dynamics.frame(feet.SOLES[self._plan.swing]).position)
        self.landed = self.loaded = self._noted = False
        # After a step that ended late the clock has already run on: this one has less time.
        self._late = self._plan.duration - self._plan.remaining

    def update(self, tick: Tick, task: SwingFootTask) -> np.ndarray:
        """Set the targets of the swing foot and of the pelvis's travel.

        Returns:
            Place where the centre of the swinging sole should land, world x and y [m], shape (2,).
        """
        plan, references, ground = self._plan, self._references, self._ground
        dynamics, command, _, dt = tick
        swing, stance = plan.swing, plan.stance
        assert swing is not None and stance is not None
        request = self._request(tick, swing, stance)
        pendulum = request.pendulum
        step = self._plan_step(request)
        self.out_of_reach += any(step.missed)
        # The foot lands along the heading that the robot will have then.
        duration, remaining = plan.duration, plan.remaining
        landing_yaw = references.yaw + command.omega * remaining
        foothold = feet.sole_about(step.foothold, landing_yaw, references.balance, dynamics.robot)
        elapsed = duration - remaining
        # Half-way through the step the stance foot alone carries the weight, so that it lies on the ground.
        if not self._noted and 2.0 * elapsed > duration:
            ground.note(dynamics, stance)
            self._noted = True
        standing = dynamics.frame(feet.SOLES[stance]).position
        height = float(standing[2])
        # The crouch is measured from the height without it, or it would undo itself.
        upright = references.height.target + references.crouch.depth - height
        references.crouch.prepare(dynamics, request, step, remaining, upright)
        self.trajectory.advance(
            foothold,
            self._apex(dynamics, command, foothold - standing[:2]),
            height,
            elapsed - self._late,
            remaining,
            dt,
            landing=height + ground.rise(standing, foothold),
            overdue=plan.overdue,
            briskness=BRISKNESS,
        )
        task.position, task.velocity = self.trajectory.position, self.trajectory.velocity
        task.acceleration = self.trajectory.acceleration
        task.yaw = landing_yaw
        task.pitch = feet.swing_pitch(dynamics, swing, references.to_heading, ground.slope_along(landing_yaw))
        self.travel.heading = references.yaw
        # The pelvis accelerates as the pendulum does over the planned centre of pressure: c'' = omega^2 (c - p).
        self.travel.feedforward = pendulum.omega**2 * float(references.to_heading[0].dot(pendulum.com - step.cop))
        return foothold

    def _apex(self, dynamics: Dynamics, command: SmoothCommand, step: np.ndarray) -> float:
        """Return the height of a swing that the drives can follow [m].

        A step that is hurried to catch the robot keeps its apex: its nominal duration counts, less the time that the
        step before took of it. A long step has a lower apex, since the knee has to stretch the leg in time
        (`highest_fall`).

        Args:
            dynamics: robot model at the current state.
            command: command to follow.
            step: from the stance foot to the foothold, world x and y [m], shape (2,).
        """
        params = self._params
        frequency = 0.5 / (self._plan.step_time - self._late)
        height, speed = command.h - self._references.crouch.depth, float(command.velocity[0])
        lift = highest_lift(params, height, frequency, dynamics.robot, speed=speed)
        apex = min(command.l, max(lift, params.min_clearance))
        along = float(self._references.to_heading[0].dot(step))
        fall = highest_fall(params, apex, height, frequency, along, dynamics.robot, speed=speed)
        apex = max(fall, min(apex, params.min_clearance))
        beyond = max(params.max_step[1] - params.long_step, 1e-6)  # a table may have no longer steps
        share = (math.hypot(*step.tolist()) - params.long_step) / beyond
        return apex + min(max(share, 0.0), 1.0) * (min(apex, params.long_step_clearance) - apex)

    def _request(self, tick: Tick, swing: int, stance: int) -> StepRequest:
        """Return what the current step has to achieve."""
        references = self._references
        pivot = feet.pivot(tick.dynamics, stance, references.balance)
        return StepRequest(
            pendulum=Pendulum.about(pivot, tick.dynamics, self._ground.gradient),
            velocity=tick.velocity,
            yaw_rate=tick.command.omega,
            heading=references.yaw,
            pivot_ahead=references.balance,
            swing=swing,
            step_time=self._plan.step_time,
            cop_reach=cop_reach(self._params, tick.dynamics.robot),
        )

    def _plan_step(self, request: StepRequest) -> StepPlan:
        """Decide where to step and, in a disturbed walk, when; the clock of the gait follows."""
        plan = self._plan
        remaining = plan.remaining
        step = plan_step(self._params, request, remaining)
        if self._params.step_timing <= 0.0 or remaining <= 0.0 or self.landed:
            return step
        # Retiming shifts the clock of this step only; the next one has its nominal duration again.
        elapsed = plan.duration - remaining
        chosen, step = time_step(self._params, request, step, self.trajectory, elapsed, remaining)
        if chosen != remaining:
            plan.retime(chosen)
        return step

    def watch_landing(self, dynamics: Dynamics) -> None:
        """Notice that the swing foot stands, and that it carries weight.

        A foot at its expected height stands until the step is over. If it does not carry by then, the ground is lower.
        """
        plan, params = self._plan, self._params
        swing, stance = plan.swing, plan.stance
        assert swing is not None and stance is not None
        if self.landed and self.loaded:
            return
        # Early in the step the foot is still near the ground that it left: touching it then is not a landing.
        duration = plan.duration
        if duration - plan.remaining <= params.early_contact_phase * duration:
            return
        standing, sole = (dynamics.frame(feet.SOLES[foot]).position for foot in (stance, swing))
        expected = float(standing[2]) + self._ground.rise(standing, sole)
        near = min(feet.end_heights(dynamics, swing)) - expected < params.early_contact_height
        touched = self._ground.touched(dynamics, swing)
        if touched is None:  # without foot forces, only the height of the foot and the clock tell
            self.loaded = True
            self.landed |= near
        else:
            self.loaded |= touched
            self.landed = self.loaded or (plan.remaining > 0.0 and (self.landed or near))
