"""A step of a walk: where it goes and when it ends, the path of the foot in the air, and whether that has landed."""

import functools

import numpy as np

from hugwbc.mbc import feet
from hugwbc.mbc.command_filter import SmoothCommand
from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.footsteps import Pendulum, StepPlan, plan_step
from hugwbc.mbc.gait_plan import GaitPlan
from hugwbc.mbc.ground_plane import Ground
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.references import References
from hugwbc.mbc.step_timing import time_step
from hugwbc.mbc.swing import SwingTrajectory
from hugwbc.mbc.tasks import PelvisTravelTask, SwingFootTask


class Walking:
    """Plans the step that is under way, anew at every tick.

    Attributes:
        travel: task of the pelvis along the heading.
        trajectory: of the foot in the air.
        landed: whether that foot stands.
        loaded: whether it carries.
        out_of_reach: ticks since the reset in which the foothold was out of reach.
    """

    def __init__(self, params: ControllerParams, plan: GaitPlan, references: References, ground: Ground) -> None:
        """Set up for a plan, its references and the ground, which others update; the plan's clock is retimed here."""
        self._params, self._plan, self._references, self._ground = params, plan, references, ground
        self.travel = PelvisTravelTask(params)
        self.trajectory = SwingTrajectory(params)
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self.out_of_reach = 0
        self.landed = self.loaded = False
        self._noted = False

    def lift_off(self, dynamics: Dynamics) -> None:
        """Begin a step: the plan's swing foot leaves the ground."""
        assert self._plan.swing is not None
        self.trajectory.start(dynamics.frame(feet.SOLES[self._plan.swing]).position)
        self.landed = self.loaded = self._noted = False

    def update(
        self, dynamics: Dynamics, command: SmoothCommand, velocity: np.ndarray, task: SwingFootTask, dt: float
    ) -> np.ndarray:
        """Set the targets of the swing foot and of the pelvis's travel; where the sole's centre is to land, shape (2,).

        Args:
            dynamics: updated.
            command: to follow.
            velocity: planned velocity, heading frame [m/s], shape (2,).
            task: of the swing foot.
            dt: [s].
        """
        plan, references, ground = self._plan, self._references, self._ground
        swing, stance = plan.swing, plan.stance
        assert swing is not None and stance is not None
        pendulum = Pendulum.about(feet.pivot(dynamics, stance, references.balance), dynamics, ground.gradient)
        step = self._plan_step(command, velocity, pendulum, swing)
        self.out_of_reach += any(step.missed)
        landing_yaw = references.yaw + command.omega * plan.remaining
        foothold = feet.sole_about(step.foothold, landing_yaw, references.balance)
        elapsed = plan.duration - plan.remaining
        if not self._noted and 2.0 * elapsed > plan.duration:
            ground.note(dynamics, stance)
            self._noted = True
        standing = dynamics.frame(feet.SOLES[stance]).position
        height = float(standing[2])
        upright = references.height.target + references.crouch.depth - height
        references.crouch.prepare(dynamics, pendulum, step, swing, plan.remaining, upright)
        self.trajectory.advance(
            foothold,
            command.l,
            height,
            elapsed,
            plan.remaining,
            dt,
            landing=height + ground.rise(standing, foothold),
            overdue=plan.overdue,
        )
        task.position, task.velocity = self.trajectory.position, self.trajectory.velocity
        task.acceleration = self.trajectory.acceleration
        task.yaw = landing_yaw
        task.pitch = feet.swing_pitch(dynamics, swing, references.to_heading, ground.slope_along(landing_yaw))
        self.travel.heading, self.travel.speed = references.yaw, float(command.velocity[0])
        self.travel.feedforward = pendulum.omega**2 * float(references.to_heading[0].dot(pendulum.com - step.cop))
        return foothold

    def _plan_step(self, command: SmoothCommand, velocity: np.ndarray, pendulum: Pendulum, swing: int) -> StepPlan:
        """Where to step, and in a disturbed walk when; the gait's clock follows."""
        plan, references = self._plan, self._references
        plan_at = functools.partial(
            plan_step,
            self._params,
            pendulum,
            velocity,
            command.omega,
            references.yaw,
            references.balance,
            swing,
            plan.step_time,
        )
        remaining = plan.remaining
        step = plan_at(remaining)
        if self._params.step_timing <= 0.0 or remaining <= 0.0 or self.landed:
            return step
        elapsed = plan.duration - remaining
        chosen, step = time_step(self._params, plan_at, step, self.trajectory, plan.step_time, elapsed, remaining)
        if chosen != remaining:
            plan.retime(chosen)
        return step

    def watch_landing(self, dynamics: Dynamics) -> None:
        """Notice that the swing foot stands, and that it carries.

        At its expected height it stands, until the step is over: if it does not carry then, the ground is lower.
        """
        plan, params = self._plan, self._params
        swing, stance = plan.swing, plan.stance
        assert swing is not None and stance is not None
        early = plan.duration - plan.remaining <= params.early_contact_phase * plan.duration
        if early or (self.landed and self.loaded):
            return
        standing, sole = (dynamics.frame(feet.SOLES[foot]).position for foot in (stance, swing))
        expected = float(standing[2]) + self._ground.rise(standing, sole)
        near = min(feet.end_heights(dynamics, swing)) - expected < params.early_contact_height
        touched = self._ground.touched(dynamics, swing)
        if touched is None:  # only its height tells, and the clock
            self.loaded = True
            self.landed |= near
        else:
            self.loaded |= touched
            self.landed = self.loaded or (plan.remaining > 0.0 and (self.landed or near))
