"""Tracking errors as the paper defines them, hand errors and timings, from the record of a run.

The paper reports the mean L1 error of every command: foot commands (f, l) over complete gait cycles, the others over
control steps. It does not say whether the start of an episode counts. Here episodes start from a stand, and the first
`SETTLE_S` seconds, in which the robot gets going, are left out.
"""

import dataclasses
import itertools

import numpy as np

from hugwbc.commands import COMMAND_NAMES
from hugwbc.gait import Gait
from hugwbc.kinematics import MEASURED_NAMES, Kinematics
from hugwbc.robot import SIDES
from hugwbc.runtime.trace import RECORD_PERIOD, Trace
from hugwbc.state import RobotState

SETTLE_S = 1.0  # [s]
CREEP_SPEED = 0.002  # [m/s] up to which a foot on the ground counts as standing firm
_MEASURED_COLUMNS = [COMMAND_NAMES.index(name) for name in MEASURED_NAMES]
_F, _L = COMMAND_NAMES.index("f"), COMMAND_NAMES.index("l")


def tracking_errors(trace: Trace, settle: float = SETTLE_S) -> dict[str, float]:
    """Mean absolute error of v_x, v_y, omega, h, p and w over the control steps after `settle` [s].

    NaN for every name if the robot did not last that long.
    """
    kept = trace.time >= settle
    if not kept.any():
        return dict.fromkeys(MEASURED_NAMES, float("nan"))
    errors = np.abs(trace.command[kept][:, _MEASURED_COLUMNS] - trace.measured[kept])
    return dict(zip(MEASURED_NAMES, errors.mean(axis=0).tolist(), strict=True))


def stepping_feet(gait: Gait) -> tuple[int, ...]:
    """Which feet (0 left, 1 right) step in a gait; the flying leg of a hop does not."""
    return {Gait.STANDING: (), Gait.HOPPING_LEFT: (0,), Gait.HOPPING_RIGHT: (1,)}.get(gait, (0, 1))


def touch_downs(trace: Trace, foot: int, settle: float = SETTLE_S) -> np.ndarray:
    """Times of touch-down of a foot after `settle` [s], shape (number of steps,)."""
    times = trace.touch_downs[foot]
    return times[(times >= settle) & (times <= trace.survived_s)]


def frequency_error(trace: Trace, settle: float = SETTLE_S) -> float:
    """E_f: mean over complete gait cycles of both feet of |f - 1 / (time from touch-down to touch-down)| [Hz].

    A foot without a complete cycle, though its gait steps, has frequency 0. NaN if no foot should step.
    """
    errors: list[float] = []
    for foot in _stepping(trace, settle):
        downs = touch_downs(trace, foot, settle)
        commanded = _at(trace, downs[1:], _F) if downs.size > 1 else trace.command[-1:, _F]
        measured = 1.0 / np.diff(downs) if downs.size > 1 else np.zeros(1)
        errors.extend(np.abs(commanded - measured))
    return float(np.mean(errors)) if errors else float("nan")


def swing_height_error(trace: Trace, settle: float = SETTLE_S) -> float:
    """E_l: mean over complete gait cycles of both feet of |l - highest sole clearance of the cycle| [m].

    A foot without a complete cycle, though its gait steps, is judged by its highest clearance of all.
    """
    errors: list[float] = []
    for foot in _stepping(trace, settle):
        downs = touch_downs(trace, foot, settle)
        if downs.size < 2:
            kept = trace.time >= settle
            errors.append(abs(float(trace.command[-1, _L] - trace.clearance[kept, foot].max())))
        for begin, end in itertools.pairwise(downs):
            cycle = (trace.time >= begin) & (trace.time <= end)
            errors.append(abs(float(_at(trace, np.array([end]), _L)[0] - trace.clearance[cycle, foot].max())))
    return float(np.mean(errors)) if errors else float("nan")


def held_foot_contact(trace: Trace, settle: float = SETTLE_S) -> float:
    """Fraction of the time after `settle` in which the held leg of a hop touched the ground; NaN for other gaits.

    The tracking errors do not tell a hop from a jump on both feet; this does.
    """
    gait, kept = Gait(int(trace.gait[-1])), trace.time >= settle
    if not gait.hops or not kept.any():
        return float("nan")
    (hopping_foot,) = stepping_feet(gait)
    return float(trace.foot_contact[kept, 1 - hopping_foot].mean())


def foot_travel(trace: Trace, settle: float = SETTLE_S) -> float:
    """Length of the horizontal paths of both soles after `settle`, added up [m] (the paper's foot displacement).

    NaN if the robot did not last that long.
    """
    steps = _sole_steps(trace, settle)
    return float("nan") if steps is None else float(steps.sum())


def foot_creep(trace: Trace, settle: float = SETTLE_S) -> float:
    """The part of `foot_travel` in which a foot on the ground moved more slowly than `CREEP_SPEED` [m].

    MuJoCo's friction is a viscous one up to its limit: a foot that stands firm creeps under any horizontal load, at
    about 0.2 mm/s for each newton under an H1. A floor would not let it.
    """
    steps = _sole_steps(trace, settle)
    if steps is None:
        return float("nan")
    planted = trace.foot_contact[trace.time >= settle][1:]
    return float(steps[planted & (steps < CREEP_SPEED * RECORD_PERIOD)].sum())


def _sole_steps(trace: Trace, settle: float) -> np.ndarray | None:
    """Horizontal distance that each sole moves between two samples after `settle` [m], shape (samples - 1, 2)."""
    kept = trace.qpos[trace.time >= settle]
    if not kept.size:
        return None
    kinematics = Kinematics()
    paths = np.empty((len(kept), len(SIDES), 2))
    for row, qpos in zip(paths, kept, strict=True):
        state = RobotState(
            q=qpos[7:], dq=np.zeros(19), orientation=qpos[3:7], angular_velocity=np.zeros(3), position=qpos[:3]
        )
        kinematics.update(state)
        row[:] = [kinematics.position(f"{side}_sole")[:2] for side in SIDES]
    return np.linalg.norm(np.diff(paths, axis=0), axis=2)


def _stepping(trace: Trace, settle: float) -> tuple[int, ...]:
    """The feet that should step after `settle`; none if the robot did not last that long."""
    if not np.any(trace.time >= settle):
        return ()
    return stepping_feet(Gait(int(trace.gait[-1])))


def _at(trace: Trace, times: np.ndarray, column: int) -> np.ndarray:
    index = np.clip(np.searchsorted(trace.time, times, side="right") - 1, 0, trace.time.size - 1)
    return trace.command[index, column]


@dataclasses.dataclass(frozen=True)
class HandErrors:
    """Distance of the hands to their targets [m]; None where there was no such target.

    What the inverse kinematics calls out of reach may be so, or a dead end of its own: the figures with `all_` judge
    it, the others whoever follows it.

    Attributes:
        mean: of both hands, of the targets that the inverse kinematics calls reachable.
        p95: 95th percentile of the same.
        left, right: mean of each hand, of the same.
        reachable_fraction: part of all samples in which it calls the target reachable.
        all_mean, all_p95: of all targets of both hands.
    """

    mean: float | None
    p95: float | None
    left: float | None
    right: float | None
    reachable_fraction: float | None
    all_mean: float | None
    all_p95: float | None


def hand_errors(error: np.ndarray, reachable: np.ndarray) -> HandErrors:
    """Hand errors of a run or of several, over all samples, take-over included.

    Args:
        error: distance of the left and the right hand to its target [m]; NaN where there is none; shape (samples, 2).
        reachable: whether the inverse kinematics calls each target reachable, shape (samples, 2), bool.
    """
    wanted = np.isfinite(error)
    counted = wanted & reachable
    left, right = (_mean(error[counted[:, side], side]) for side in (0, 1))
    return HandErrors(
        mean=_mean(error[counted]),
        p95=_p95(error[counted]),
        left=left,
        right=right,
        reachable_fraction=_mean(reachable[wanted].astype(float)),
        all_mean=_mean(error[wanted]),
        all_p95=_p95(error[wanted]),
    )


def _p95(values: np.ndarray) -> float | None:
    return float(np.percentile(values, 95)) if values.size else None


def _mean(values: np.ndarray) -> float | None:
    return float(values.mean()) if values.size else None


def percentiles(milliseconds: np.ndarray) -> dict[str, float | None]:
    """Median and 99th percentile of the times of calls [ms]; None if there was no call."""
    if not milliseconds.size:
        return {"p50": None, "p99": None}
    p50, p99 = np.percentile(milliseconds, (50, 99)).tolist()
    return {"p50": p50, "p99": p99}


def jitter(positions: np.ndarray, dt: float) -> float:
    """Mean squared jerk of joint positions, shape (samples, joints), `dt` [s] apart [rad^2/s^6].

    NaN samples are left out; NaN if no four samples in a row are known.
    """
    jerk = np.diff(positions, n=3, axis=0) / dt**3
    known = jerk[np.isfinite(jerk)]
    return float(np.mean(known**2)) if known.size else float("nan")
