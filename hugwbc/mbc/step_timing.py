"""When to step: the end of a step moves where its foothold cannot be reached in time."""

import math
from collections.abc import Callable

from hugwbc.mbc.footsteps import StepPlan
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.swing import SwingTrajectory

_CHOICES = 4  # of a shorter duration, and as many of a longer one
_PEAK = 5.77  # acceleration of a quintic from rest to rest over a distance of 1 in a time of 1
_SHORTEST = 0.06  # [s], to the end of a step; a foot needs that to come down


def time_step(
    params: ControllerParams,
    plan_at: Callable[[float], StepPlan],
    step: StepPlan,
    swing: SwingTrajectory,
    step_time: float,
    elapsed: float,
    remaining: float,
) -> tuple[float, StepPlan]:
    r"""The time to the end of the step with which the robot comes closest to its gait, and the step that is then taken.

    A pushed robot's divergent component :math:`\xi` may leave the places from which the next stance foot can catch
    it: that foot comes no closer to the other one, no further away and no faster than the legs allow. What it misses
    by depends on when it lands, since :math:`\xi` grows as :math:`e^{\omega t}`. As Khadiv et al. (Walking control
    based on step timing adaptation, IEEE T-RO 2020) and Griffin et al. (Walking stabilization using step timing and
    location adjustment, IROS 2017) do, the duration d of the step is a second control beside its place, here

    .. math:: \min_d \; \max(|e(d)| - e_0, 0)^2 + w\,(d / T - 1)^2 , \quad 1 / (1 + a) \le d / T \le 1 / (1 - a)

    with e the distance sideways between the wanted foothold and the nearest one within reach, and what the swing foot
    falls short of that. Found among a few durations, fixed from the beginning of the step, so that it does not flutter.
    As long as the foothold is within reach sideways, d = T.

    Args:
        params: a, e_0, w and the speed of a swing.
        plan_at: the step if it ends in a time [s].
        step: that for `remaining`.
        swing: where the foot in the air is, and how fast.
        step_time: T [s].
        elapsed: since the step began [s].
        remaining: to its end, as decided before [s].
    """
    share = params.step_timing
    if remaining < _SHORTEST:
        return remaining, step
    changed = abs(elapsed + remaining - step_time) > 1e-9
    if not changed and abs(step.missed[1]) <= params.step_timing_tolerance:
        return remaining, step
    lowest, best = math.inf, (remaining, step)
    for choice in range(-_CHOICES, _CHOICES + 1):
        pace = 1.0 - share * choice / _CHOICES
        left = step_time / pace - elapsed
        if left < _SHORTEST:
            continue
        plan = plan_at(left)
        missed = abs(plan.missed[1]) + _short(params, plan, swing, left)
        excess = max(missed - params.step_timing_tolerance, 0.0)
        cost = excess**2 + params.step_timing_weight * (1.0 / pace - 1.0) ** 2
        if cost < lowest:
            lowest, best = cost, (left, plan)
    return best


def _short(params: ControllerParams, step: StepPlan, swing: SwingTrajectory, left: float) -> float:
    """Distance by which a swing foot that is accelerated as fast as it may be ends short of the foothold [m].

    A quintic from rest to rest over a distance D in a time t accelerates by at most 5.77 D / t^2; what speed the foot
    has already takes it half as far as it would without braking.
    """
    x, y = (step.foothold - swing.position[:2] - 0.5 * left * swing.velocity[:2]).tolist()
    return max(math.hypot(x, y) - params.swing_acceleration * left**2 / _PEAK, 0.0)
