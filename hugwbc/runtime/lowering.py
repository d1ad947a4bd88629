"""Controlled way down to the knees after loss of the state or of a motor, followed by damping of the joints.

The robot does not balance. Its joints are soft and strongly damped, so that the legs carry it down slowly: it puts the
swinging foot down, folds its legs onto the knees, and leans back to where knees and toes carry it. Then the stiffness
fades. The postures were found by an evolution strategy in simulation (docs/log/faults.md).
"""

import dataclasses

import numpy as np

from hugwbc.blends import smooth_step
from hugwbc.controller import JointCommand
from hugwbc.robot import SIDES, Robot
from hugwbc.state import RobotState

_FINAL_DAMPING_TIME = 0.1  # [s], in which the damping grows when the stiffness begins to fade
_SIGNS = np.array([1.0, -1.0])  # of the left and the right joint of a pair, for outwards
_CLEAR_LOAD = 1.5  # how much faster than its share of the load a leg becomes the standing one


@dataclasses.dataclass(frozen=True)
class LegPosture:
    """Joint positions of a leg [rad]; `hip_roll` is outwards."""

    hip_pitch: float
    knee: float
    ankle: float
    hip_roll: float = 0.0


@dataclasses.dataclass(frozen=True)
class LoweringParams:
    """Settings of the way down.

    Attributes:
        plant_time, fold_time, lean_time: of the three moves [s].
        wait: between the second and the third [s].
        hold: how long the last posture is held [s].
        fade: time in which the stiffness then goes to zero [s].
        standing, swinging: of the leg with load and of the other one, at the end of the first move.
        folded, leaning: of both legs, at the end of the second and of the third move.
        planted_stride, folded_stride: part of the difference between both legs that stays in the first move, and later.
        shoulder_pitch, shoulder_roll: of the arms [rad]; the roll is outwards.
        stiffness, damping: of the joints, as multiples of the robot's own; `ankle_stiffness` and `ankle_damping` of the
            ankles.
        final_damping: of the joints from the fade on, as a multiple of the robot's own.
    """

    plant_time: float = 0.02
    fold_time: float = 0.21
    wait: float = 0.0
    lean_time: float = 0.36
    hold: float = 0.84
    fade: float = 1.0
    standing: LegPosture = LegPosture(-0.44, 1.07, -0.31, 0.12)
    swinging: LegPosture = LegPosture(-0.24, 1.10, -0.52, 0.10)
    folded: LegPosture = LegPosture(0.04, 1.98, -0.25, -0.15)
    leaning: LegPosture = LegPosture(0.5, 2.02, 0.72, -0.15)
    planted_stride: float = 0.37
    folded_stride: float = -0.16
    shoulder_pitch: float = 0.28
    shoulder_roll: float = -0.47
    stiffness: float = 0.69
    damping: float = 2.6
    ankle_stiffness: float = 0.02
    ankle_damping: float = 2.8
    final_damping: float = 6.0


class Lowering:
    """One way down; it needs encoders and the feet's loads only at its start, and no IMU."""

    def __init__(self, robot: Robot, params: LoweringParams | None = None) -> None:
        """Set up for a robot that does not go down yet."""
        self._robot, self.params = robot, params or LoweringParams()
        pair = {
            name: robot.indices([f"{side}_{name}_joint" for side in SIDES])
            for name in ("hip_pitch", "knee", "ankle", "hip_roll", "shoulder_pitch", "shoulder_roll")
        }
        self._legs = np.array([pair[field.name] for field in dataclasses.fields(LegPosture)])
        self._upright = robot.nominal.copy()
        self._upright[pair["shoulder_pitch"]] = self.params.shoulder_pitch
        self._upright[pair["shoulder_roll"]] = self.params.shoulder_roll * _SIGNS
        ankles = np.isin(np.arange(robot.kp.size), pair["ankle"])
        self._kp = robot.kp * np.where(ankles, self.params.ankle_stiffness, self.params.stiffness)
        self._kd = robot.kd * np.where(ankles, self.params.ankle_damping, self.params.damping)
        self._moves: list[tuple[float, float, np.ndarray]] = []  # when each begins and how long it takes [s], and where
        self._from = robot.nominal
        self._elapsed = 0.0

    @property
    def begun(self) -> bool:
        """Whether the robot is on its way down, or has arrived."""
        return bool(self._moves)

    def command(self, state: RobotState, period: float) -> JointCommand:
        """Return the joint command of the next period [s]; the first call begins at the joints' estimated positions."""
        params = self.params
        if not self._moves:
            self._plan(state)
        self._elapsed += period
        q = self._from
        for begin, duration, posture in self._moves:
            q = q + smooth_step((self._elapsed - begin) / duration) * (posture - q)
        begin, duration, _ = self._moves[-1]
        fading = self._elapsed - begin - duration - params.hold
        stiffness = 1.0 - smooth_step(fading / params.fade)
        growth = smooth_step(fading / _FINAL_DAMPING_TIME)
        kd = self._kd + growth * (params.final_damping * self._robot.kd - self._kd)
        zero = np.zeros_like(kd)
        return JointCommand(q=q, dq=zero, kp=stiffness * self._kp, kd=kd, tau=zero)

    def _plan(self, state: RobotState) -> None:
        """Choose the postures from the joints and the feet's loads at the beginning."""
        params, robot = self.params, self._robot
        self._from = np.where(np.isfinite(state.q), state.q, robot.nominal)
        load = np.ones(len(SIDES)) if state.foot_force is None else np.fmax(state.foot_force[:, 2], 0.0)
        share = load / load.sum() if load.sum() > 0.0 else np.full(len(SIDES), 0.5)
        standing = np.clip(_CLEAR_LOAD * (share - 0.5) + 0.5, 0.0, 1.0)
        standing_leg, swinging_leg = (np.array(dataclasses.astuple(leg)) for leg in (params.standing, params.swinging))
        planted = np.outer(standing_leg, standing) + np.outer(swinging_leg, 1.0 - standing)
        folded, leaning = (np.array([dataclasses.astuple(leg)] * 2).T for leg in (params.folded, params.leaning))
        legs = self._from[self._legs]
        stride = 0.5 * (legs - legs[:, ::-1])
        stride[-1] = 0.0  # the hips' roll is not of the stride
        times = (params.plant_time, params.fold_time, params.lean_time)
        begins = np.cumsum((0.0, params.plant_time, params.fold_time + params.wait))
        shares = (params.planted_stride, params.folded_stride, params.folded_stride)
        for begin, duration, posture, part in zip(begins, times, (planted, folded, leaning), shares, strict=True):
            q = self._upright.copy()
            posture[-1] *= _SIGNS
            q[self._legs] = posture + part * stride
            self._moves.append((float(begin), duration, np.clip(q, robot.lower, robot.upper)))
