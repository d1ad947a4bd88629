"""Controlled way down to the knees after loss of the state or of a motor, followed by damping of the joints.

The robot does not balance. Its joints are soft and strongly damped, so that the legs carry it down slowly: it puts the
swinging foot down, folds its legs onto the knees, and leans back to where knees and toes carry it. Then the stiffness
fades. The postures were found by an evolution strategy for an H1 in simulation (docs/log/faults.md). They are angles,
and stiffness and damping are relative to the robot's own: a G1, whose legs have the same proportions, kneels likewise.
"""

import numpy as np

from hugwbc.controller import JointCommand
from hugwbc.numeric import smooth_step
from hugwbc.robot import SIDES, Robot, load_mirror
from hugwbc.state import RobotState

_PLANT_TIME, _FOLD_TIME, _LEAN_TIME = 0.02, 0.21, 0.36  # [s], of the three moves
_HOLD, _FADE = 0.84, 1.0  # [s], how long the last posture is held, and how long the stiffness then takes to zero
_FINAL_DAMPING_TIME = 0.1  # [s], in which the damping grows when the stiffness begins to fade
# Joint positions of a leg [rad]: hip's pitch, knee, ankle, and hip's roll, which is outwards.
_STANDING = np.array([-0.44, 1.07, -0.31, 0.12])  # the leg with load, at the end of the first move
_SWINGING = np.array([-0.24, 1.10, -0.52, 0.10])  # the other one
_FOLDED = np.array([0.04, 1.98, -0.25, -0.15])  # both legs, at the end of the second move
LEANING = np.array([0.5, 2.02, 0.72, -0.15])  # and of the third
_PLANTED_STRIDE, _FOLDED_STRIDE = 0.37, -0.16  # share of the legs' difference that stays in the first move, and later
_SHOULDER_PITCH, _SHOULDER_ROLL = 0.28, -0.47  # [rad]; the roll is outwards
# Of the joints, and of the ankles, as multiples of the robot's own; the last damping holds from the fade on.
_STIFFNESS, _ANKLE_STIFFNESS = 0.69, 0.02
_DAMPING, _ANKLE_DAMPING, _FINAL_DAMPING = 2.6, 2.8, 6.0
_CLEAR_LOAD = 1.5  # how much faster than its share of the load a leg becomes the standing one


class Lowering:
    """One way down. It needs no IMU, and encoders and the feet's loads only at its start."""

    def __init__(self, robot: Robot) -> None:
        """Set up for a robot that does not go down yet."""
        self._robot = robot
        self._legs = np.array([robot.pair(part) for part in ("hip_pitch", "knee", "ankle_pitch", "hip_roll")])
        self._upright = robot.nominal.copy()
        self._signs = load_mirror(robot).joint_sign  # rolls may turn about opposite axes on the right
        for part, angle in (("shoulder_pitch", _SHOULDER_PITCH), ("shoulder_roll", _SHOULDER_ROLL)):
            left, right = robot.pair(part)
            self._upright[left], self._upright[right] = angle, self._signs[right] * angle
        ankles = np.isin(np.arange(robot.kp.size), robot.pair("ankle_pitch"))
        self._kp = robot.kp * np.where(ankles, _ANKLE_STIFFNESS, _STIFFNESS)
        self._kd = robot.kd * np.where(ankles, _ANKLE_DAMPING, _DAMPING)
        self.reset()

    def reset(self) -> None:
        """Forget the way down: the robot stands again."""
        self._moves: list[tuple[float, float, np.ndarray]] = []  # when each begins and how long it takes [s], and where
        self._from, self._elapsed = self._robot.nominal, 0.0

    @property
    def begun(self) -> bool:
        """Whether the robot is on its way down, or has arrived."""
        return bool(self._moves)

    def command(self, state: RobotState, period: float) -> JointCommand:
        """Return the joint command of the next period [s]; the first call begins at the joints' estimated positions."""
        if not self._moves:
            self._plan(state)
        self._elapsed += period
        q = self._from
        for begin, duration, posture in self._moves:
            q = q + smooth_step((self._elapsed - begin) / duration) * (posture - q)
        begin, duration, _ = self._moves[-1]
        fading = self._elapsed - begin - duration - _HOLD
        stiffness = 1.0 - smooth_step(fading / _FADE)
        growth = smooth_step(fading / _FINAL_DAMPING_TIME)
        kd = self._kd + growth * (_FINAL_DAMPING * self._robot.kd - self._kd)
        zero = np.zeros_like(kd)
        return JointCommand(q=q, dq=zero, kp=stiffness * self._kp, kd=kd, tau=zero)

    def _plan(self, state: RobotState) -> None:
        """Choose the postures from the joints and the feet's loads at the beginning."""
        robot = self._robot
        self._from = np.where(np.isfinite(state.q), state.q, robot.nominal)
        load = np.ones(len(SIDES)) if state.foot_force is None else np.fmax(state.foot_force[:, 2], 0.0)
        share = load / load.sum() if load.sum() > 0.0 else np.full(len(SIDES), 0.5)
        standing = np.clip(_CLEAR_LOAD * (share - 0.5) + 0.5, 0.0, 1.0)
        planted = np.outer(_STANDING, standing) + np.outer(_SWINGING, 1.0 - standing)
        folded, leaning = (np.array([leg, leg]).T for leg in (_FOLDED, LEANING))
        legs = self._from[self._legs]
        stride = 0.5 * (legs - legs[:, ::-1])
        stride[-1] = 0.0  # the hips' roll is not of the stride
        times = (_PLANT_TIME, _FOLD_TIME, _LEAN_TIME)
        begins = np.cumsum((0.0, _PLANT_TIME, _FOLD_TIME))
        shares = (_PLANTED_STRIDE, _FOLDED_STRIDE, _FOLDED_STRIDE)
        for begin, duration, posture, part in zip(begins, times, (planted, folded, leaning), shares, strict=True):
            q = self._upright.copy()
            posture[-1, 1] *= self._signs[self._legs[-1, 1]]  # outwards on the right
            q[self._legs] = posture + part * stride
            self._moves.append((float(begin), duration, np.clip(q, robot.lower, robot.upper)))
