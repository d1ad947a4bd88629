"""Standing on both feet: balance, the shift of the weight before a first step, and when to step to avoid a fall."""

import math

import numpy as np

from hugwbc.mbc import feet
from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.footsteps import Pendulum, nominal_offset
from hugwbc.mbc.gait_plan import GaitPlan, Mode
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.references import References
from hugwbc.mbc.tasks import CentreOfMassTask

# Largest shift of the balance by forces on the hands that the feet take up by their centre of pressure; the body leans
# against the rest only. Along the heading [m], and across it as a share of half the distance of the feet.
_FEET_TAKE_ALONG, _FEET_TAKE_ACROSS = 0.03, 0.6
_SHIFT_TOLERANCE, _SHIFT_MARGIN = 0.015, 0.02  # [m], of the divergent component, and from the feet's centre lines
_MOST_PATIENCE = 4.0  # factor by which the tolerance of the first hop may grow


class Standing:
    """Sets the target of the centre of mass and watches the balance.

    Attributes:
        com: task of the centre of mass.
        ready: whether the weight is where the commanded gait can start.
        catching: remaining time for which the robot steps to catch itself [s].
        first_swing: foot that those steps start with, 0 for left, 1 for right.
    """

    def __init__(self, params: ControllerParams, plan: GaitPlan, references: References) -> None:
        """Set up for a gait plan and its references, which the caller updates first in every tick."""
        self._params, self._plan, self._references = params, plan, references
        self.com = CentreOfMassTask(params)
        self.reset()

    def reset(self) -> None:
        """Forget all pushes and shifts."""
        self.ready = False
        self.catching = 0.0
        self.first_swing = 0

    @property
    def settled(self) -> bool:
        """Whether the robot has stood long enough to have come to rest; only then may it squat deeply."""
        return self._plan.mode is Mode.STANDING and self._plan.elapsed >= self._params.settle_time

    def update(self, dynamics: Dynamics) -> None:
        """Place the centre of mass between the feet or, before a first step or hop, where that one needs it."""
        params, plan, references = self._params, self._plan, self._references
        pivots = [feet.pivot(dynamics, foot, references.balance) for foot in range(2)]
        middle = 0.5 * (pivots[0] + pivots[1])
        to_heading = references.to_heading
        between = to_heading.dot((pivots[0] - pivots[1])[:2])
        lean = self._lean(to_heading.dot(dynamics.hand_shift(middle)), abs(float(between[1]))).dot(to_heading)
        self.com.heading = references.yaw
        self.com.target = middle[:2] + lean
        self.com.feedforward = np.zeros(2)
        self.com.servo = np.ones(2)
        pendulum = Pendulum.about(middle, dynamics)
        deviation = to_heading.dot(pendulum.dcm - middle[:2])
        if plan.mode is not Mode.SHIFTING:
            # A robot with an unknown load on one side never gets that close: after a while it is ready all the same.
            self.ready = math.hypot(*deviation.tolist()) < params.jump_calm or self.settled
            self._watch_balance(deviation, between)
        elif plan.gait.alternates:
            self._shift_for_a_step(pivots, pendulum)
        else:
            # The weight goes over the hopping foot and may pass it a little.
            self._watch_balance(deviation, between + np.array([0.0, 2.0 * params.hop_overshoot]))
            foot, outwards = (0, to_heading[1]) if plan.gait.feet == (0,) else (1, -to_heading[1])
            edge = pivots[foot][:2] + feet.hop_edge(dynamics.robot) * outwards
            self._shift_onto(edge, middle[:2], pendulum)
            self.com.target = self.com.target + lean

    @staticmethod
    def _lean(shift: np.ndarray, distance: float) -> np.ndarray:
        """Return the shift of the centre of mass against hand forces, heading frame [m], shape (2,).

        A leg without ankle roll that leans sideways stands on the edge of its sole, so that the feet take as much as
        they can.

        Args:
            shift: of the balance by these forces, heading frame [m], shape (2,).
            distance: of the feet across the heading [m].
        """
        room = np.array([_FEET_TAKE_ALONG, _FEET_TAKE_ACROSS * 0.5 * distance])
        return np.minimum(np.maximum(shift, -room), room) - shift

    def _shift_for_a_step(self, pivots: list[np.ndarray], pendulum: Pendulum) -> None:
        """Move the divergent component to where the first step of a walk, of the left foot, starts.

        A constant centre of pressure p takes xi to xi_T = p + (xi - p) e^{omega T} in the time T that is left.
        Solved for p, with xi_T the offset of the periodic gait from the right foot, that is the feedback. The centre of
        mass then follows the pendulum over p, without a servo.
        """
        params, plan, to_heading = self._params, self._plan, self._references.to_heading
        left, right = ((to_heading @ pivot[:2])[1] for pivot in pivots)
        width = max(params.step_width, params.min_foot_distance)
        wanted = right + nominal_offset(0.0, 0.0, plan.step_time, pendulum.omega, width, 1).imag
        dcm, com = (to_heading @ pendulum.dcm)[1], (to_heading @ pendulum.com)[1]
        growth = np.exp(pendulum.omega * max(params.shift_time - plan.elapsed, 0.05))
        cop = np.clip((wanted - growth * dcm) / (1.0 - growth), right + _SHIFT_MARGIN, left - _SHIFT_MARGIN)
        self._swing_over(cop, com, pendulum)
        arrived = plan.elapsed >= params.shift_time and abs(dcm - wanted) < _SHIFT_TOLERANCE
        self.ready = bool(arrived or plan.elapsed >= params.max_shift_time)

    def _shift_onto(self, pivot: np.ndarray, middle: np.ndarray, pendulum: Pendulum) -> None:
        r"""Move the weight over the hopping foot.

        Along the heading the centre of mass is pulled there. Across it, the foot is too narrow to correct anything in
        the hop, so that the divergent component must be exactly over the contact. It follows a ramp by feedback,
        :math:`\dot\xi^* = \dot\xi_d + k (\xi_d - \xi)`, through the centre of pressure
        :math:`p = \xi - \dot\xi^* / \omega`.

        Args:
            pivot: where that foot will push, world x and y [m], shape (2,).
            middle: point between the feet, world x and y [m], shape (2,).
            pendulum: robot as a pendulum about the middle of the feet.
        """
        params, to_heading, duration = self._params, self._references.to_heading, self._params.hop_shift_time
        share = min(self._plan.elapsed / duration, 1.0)
        self.com.target = middle + share * (pivot - middle)
        ramp = (pivot - middle) / duration if share < 1.0 else np.zeros(2)
        rate = to_heading[1].dot(ramp + params.hop_shift_gain * (self.com.target - pendulum.dcm))
        cop = to_heading[1].dot(pendulum.dcm) - rate / pendulum.omega
        self._swing_over(cop, to_heading[1].dot(pendulum.com), pendulum)
        gap = np.abs(to_heading.dot(pendulum.dcm - pivot)).max()
        # The tolerance grows with time, because an estimated position may never quite arrive.
        patience = max(self._plan.elapsed / duration - 2.0, 1.0)
        self.ready = share >= 1.0 and gap < params.hop_shift_tolerance * min(patience, _MOST_PATIENCE)

    def _swing_over(self, cop: float, com: float, pendulum: Pendulum) -> None:
        """Let the centre of mass follow the pendulum across the heading: no servo, a centre of pressure [m]."""
        self.com.feedforward[1] = pendulum.omega**2 * (com - cop)
        self.com.servo[1] = 0.0

    def _watch_balance(self, deviation: np.ndarray, between_feet: np.ndarray) -> None:
        """Start stepping when the divergent component leaves what two standing feet can hold.

        Outside the support area no centre of pressure can bring it back (the capture point of Pratt et al., Humanoids
        2006): the only way not to fall is a step.

        Args:
            deviation: divergent component relative to the middle of the feet, heading frame [m], shape (2,).
            between_feet: vector from the right to the left foot, heading frame [m], shape (2,).
        """
        across = 0.5 * abs(between_feet[1]) - self._params.capture_margin
        if abs(deviation[0]) > self._params.capture_distance or abs(deviation[1]) > across:
            self.catching = self._params.capture_time
            # Pushed to the left, the left foot carries: the right one comes along first, then the left one steps out.
            self.first_swing = 1 if deviation[1] > 0.0 else 0
