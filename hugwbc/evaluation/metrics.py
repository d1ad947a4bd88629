"""Figures of a run from its trace: tracking errors, feet, impacts, hands, effort and computing time.

The tracking errors are those of the HugWBC paper (Xue et al., RSS 2025): the mean L1 error of every command, for the
foot commands f and l over gait cycles, for the others over the samples of the record. The paper does not say whether
the start of an episode counts. Here episodes start from a stand, and the first `SETTLE_S` seconds, in which the robot
gets going, are left out.
"""

import itertools
from collections.abc import Sequence

import numpy as np

from hugwbc.commands import COMMAND_NAMES, MEASURED_NAMES
from hugwbc.gait import Gait
from hugwbc.kinematics import Kinematics
from hugwbc.robot import SIDES, load_robot
from hugwbc.runtime.trace import RECORD_PERIOD, Trace
from hugwbc.state import GRAVITY, RobotState

SETTLE_S = 1.0  # [s]
CREEP_SPEED = 0.002  # [m/s], below which a foot on the ground counts as standing still
ARRIVED = 0.05  # [m]; a hand that came this close to its target has arrived
JUMP = 0.1  # [m]; a target that moves by more between two samples is a new one, to which the hand has to travel
SHORTEST_WAY = 0.1  # [m]; the cost of transport of a shorter path has no meaning
_MEASURED_COLUMNS = [COMMAND_NAMES.index(name) for name in MEASURED_NAMES]
_F, _L = COMMAND_NAMES.index("f"), COMMAND_NAMES.index("l")


# Tracking


def command_errors(trace: Trace) -> np.ndarray:
    """Return the absolute errors of v_x, v_y, omega, h, p and w at every sample, shape (T, 6)."""
    return np.abs(trace.command[:, _MEASURED_COLUMNS] - trace.measured)


def tracking_errors(trace: Trace, settle: float = SETTLE_S) -> dict[str, float]:
    """Return the mean absolute error of v_x, v_y, omega, h, p and w over the record's samples from `settle` [s] on.

    Every error is NaN if the run ended before.
    """
    kept = trace.time >= settle
    if not kept.any():
        return dict.fromkeys(MEASURED_NAMES, float("nan"))
    return dict(zip(MEASURED_NAMES, command_errors(trace)[kept].mean(axis=0).tolist(), strict=True))


def executed_means(trace: Trace, settle: float = SETTLE_S) -> dict[str, float]:
    """Return the mean executed value of each of the eight commands after `settle` [s], by name.

    That of f is the frequency of a foot's touch-downs, that of l the mean of the highest sole clearances of the swings.
    All are NaN if the robot fell or knelt down, or the run ended before `settle`; f and l also without complete cycles.
    """
    kept, missing = trace.time >= settle, float("nan")
    if trace.down or not kept.any():
        return dict.fromkeys((*MEASURED_NAMES, "f", "l"), missing)
    means = dict(zip(MEASURED_NAMES, trace.measured[kept].mean(axis=0).tolist(), strict=True))
    feet = _stepping(trace, settle)
    downs = [times for times in (touch_downs(trace, foot, settle) for foot in feet) if times.size > 1]
    heights = [height for foot in feet for height in swings(trace, foot, settle)[1]]
    frequencies = [(times.size - 1) / (times[-1] - times[0]) for times in downs]
    return means | {
        "f": float(np.mean(frequencies)) if frequencies else missing,
        "l": float(np.mean(heights)) if heights else missing,
    }


def touch_downs(trace: Trace, foot: int, settle: float = SETTLE_S) -> np.ndarray:
    """Return the times of touch-down of a foot after `settle` [s], shape (number of steps,)."""
    times = trace.touch_downs[foot]
    return times[(times >= settle) & (times <= trace.survived_s)]


def frequency_error(trace: Trace, settle: float = SETTLE_S) -> float:
    """Return E_f [Hz]: the mean over complete gait cycles of both feet of |f - 1 / (touch-down to touch-down)|.

    A cycle that a foot misses before its first or after its last step has frequency 0. So has a foot that should step
    but has no complete cycle, unless the robot went down too early for one. NaN without any of these, as in a stand.
    """
    errors: list[float] = []
    for foot in _stepping(trace, settle):
        downs, (missed, _) = touch_downs(trace, foot, settle), _missed(trace, foot, settle)
        ends, measured = np.r_[downs[1:], missed], np.r_[1.0 / np.diff(downs), 0.0 * missed]
        if not ends.size and _had_time(trace, settle):
            ends, measured = trace.time[-1:], np.zeros(1)
        errors.extend(np.abs(_at(trace, ends, _F) - measured))
    return float(np.mean(errors)) if errors else float("nan")


def swing_height_error(trace: Trace, settle: float = SETTLE_S) -> float:
    """Return E_l [m]: the mean over complete gait cycles of both feet of |l - highest sole clearance of the cycle|.

    Cycles that a foot misses before its first or after its last step count with their highest clearance. A foot that
    should step but has no complete cycle, though time for one, counts with its highest clearance after `settle`.
    """
    errors: list[float] = []
    for foot in _stepping(trace, settle):
        ends, highest = np.hstack((swings(trace, foot, settle), _missed(trace, foot, settle)))
        if not ends.size and _had_time(trace, settle):
            ends, highest = trace.time[-1:], trace.clearance[trace.time >= settle, foot].max(keepdims=True)
        errors.extend(np.abs(_at(trace, ends, _L) - highest))
    return float(np.mean(errors)) if errors else float("nan")


def swings(trace: Trace, foot: int, settle: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the end [s] and the highest sole clearance [m] of every complete gait cycle of a foot after `settle`."""
    return _highest(trace, foot, list(itertools.pairwise(touch_downs(trace, foot, settle))))


def _missed(trace: Trace, foot: int, settle: float) -> tuple[np.ndarray, np.ndarray]:
    """Return end [s] and highest sole clearance [m] of the cycles that a foot misses before and after all its steps.

    In a gap without a touch-down that holds n >= 2 whole commanded periods, all but the last of these are missed.
    """
    downs, cycles = touch_downs(trace, foot, settle), []
    for begin, end in [(settle, downs[0]), (downs[-1], trace.survived_s)] if downs.size else []:
        period = 1.0 / float(_at(trace, end, _F))
        cycles += [(begin + i * period, begin + (i + 1) * period) for i in range(int((end - begin) / period) - 1)]
    return _highest(trace, foot, cycles)


def _highest(trace: Trace, foot: int, cycles: Sequence[tuple[float, float]]) -> tuple[np.ndarray, np.ndarray]:
    kept = [(trace.time >= begin) & (trace.time <= end) for begin, end in cycles]
    return np.array([end for _, end in cycles]), np.array([trace.clearance[cycle, foot].max() for cycle in kept])


def _stepping(trace: Trace, settle: float) -> tuple[int, ...]:
    """Return the feet that should step after `settle`; none if the run ended before."""
    if not np.any(trace.time >= settle):
        return ()
    return Gait(int(trace.gait[-1])).feet


def _had_time(trace: Trace, settle: float) -> bool:
    """Return whether the robot never went down, or was up for two cycles after `settle`, which hold a complete one."""
    return not trace.down or trace.survived_s - settle >= 2.0 / float(_at(trace, trace.survived_s, _F))


def _at(trace: Trace, times: np.ndarray | float, column: int) -> np.ndarray:
    """Return a column of the command at some times."""
    index = np.clip(np.searchsorted(trace.time, times, side="right") - 1, 0, trace.time.size - 1)
    return trace.command[index, column]


# Feet


def held_foot_contact(trace: Trace, settle: float = SETTLE_S) -> float:
    """Return the fraction of the time after `settle` in which the held leg of a hop touched the ground.

    The tracking errors do not distinguish a hop from a jump on both feet; this does. NaN for other gaits.
    """
    gait, kept = Gait(int(trace.gait[-1])), trace.time >= settle
    if not gait.hops or not kept.any():
        return float("nan")
    (hopping_foot,) = gait.feet
    return float(trace.foot_contact[kept, 1 - hopping_foot].mean())


def foot_travel(trace: Trace, settle: float = SETTLE_S) -> tuple[float, float]:
    """Return the summed length of both soles' horizontal paths after `settle`, and the creep in it [m].

    The sum is the paper's foot displacement. Creep is the part in which a foot on the ground moved more slowly than
    `CREEP_SPEED`. MuJoCo's friction is viscous up to its limit: a foot that stands still creeps under any horizontal
    load, under an H1 at about 0.2 mm/s for each newton. On a real floor it would not move. Both are NaN if the run
    ended before.
    """
    kept = trace.time >= settle
    if not kept.any():
        return float("nan"), float("nan")
    soles = places(trace, [f"{side}_sole" for side in SIDES], kept)[..., :2]
    steps = np.linalg.norm(np.diff(soles, axis=0), axis=2)
    planted = trace.foot_contact[kept][1:]
    return float(steps.sum()), float(steps[planted & (steps < CREEP_SPEED * RECORD_PERIOD)].sum())


def places(trace: Trace, frames: Sequence[str], kept: np.ndarray) -> np.ndarray:
    """Return where frames of `Kinematics.position` were in the world [m], shape (samples, frames, 3).

    `kept` says at which samples of the record, shape (T,), bool.
    """
    kinematics = Kinematics(load_robot(trace.robot))
    found = np.empty((np.count_nonzero(kept), len(frames), 3))
    for row, qpos in zip(found, trace.qpos[kept], strict=True):
        q = qpos[7:]
        kinematics.update(RobotState(q, np.zeros_like(q), qpos[3:7], np.zeros(3), qpos[:3]))
        row[:] = [kinematics.position(frame) for frame in frames]
    return found


# Impacts


def impact(trace: Trace, settle: float = SETTLE_S) -> dict[str, float]:
    """Return how hard both feet came down after `settle` [s]; empty without a touch-down.

    - `speed_median`: of the vertical speed of the sole's centre in the physics step before a touch-down [m/s].
    - `peak_mean`: of the largest vertical ground reaction in the stance after a touch-down, in weights of the robot
      without payload: a robot at rest on one foot has 1.
    """
    velocities, peaks = [], []
    for foot, times in enumerate(trace.touch_downs):
        kept = np.isin(times, touch_downs(trace, foot, settle))
        velocities.append(trace.touch_down_velocity[foot][kept])
        peaks.append(trace.stance_peak[foot][kept])
    velocity, peak = np.concatenate(velocities), np.concatenate(peaks) / (trace.mass * GRAVITY)
    if not peak.size:
        return {}
    return {"speed_median": float(np.median(np.abs(velocity[:, 2]))), "peak_mean": float(peak.mean())}


# Hands


def hand_errors(error: np.ndarray, reachable: np.ndarray) -> dict[str, float | None]:
    """Return the hand errors over all samples of one or more runs, the approach to the first target included.

    `mean` and `p95` are distances to the targets that the inverse kinematics calls reachable [m], and judge the
    controller that follows it; `reachable_fraction` is the part of targets that are. None where there was none.

    Args:
        error: distance of the left and the right hand to its target [m], shape (samples, 2); NaN without a target.
        reachable: whether the inverse kinematics calls each target reachable, shape (samples, 2), bool.
    """
    targeted = np.isfinite(error)
    counted = targeted & reachable
    return {
        "mean": _mean(error[counted]),
        "p95": _p95(error[counted]),
        "reachable_fraction": _mean(reachable[targeted].astype(float)),
    }


def hand_travel(trace: Trace, kept: np.ndarray | None = None) -> dict[str, float | None]:
    """Return the hands' errors on the way to their targets and once there, over the samples `kept`, shape (T,), bool.

    A hand travels to a new target until it is within `ARRIVED` of it for the first time; from then on it has arrived.

    - `travelling`: mean error before arrival [m]; `arrived`, `arrived_p95`: mean and 95th percentile after it [m].
    - `travel_time`: time that the hands travelled, mean of those that have a target at some time [s].
    """
    there, error = arrived(trace), trace.hand_error
    counts = np.isfinite(error) & (np.ones(len(there), dtype=bool) if kept is None else kept)[:, None]
    away, near = counts & ~there, counts & there
    period = float(np.median(np.diff(trace.time))) if len(trace.time) > 1 else 0.0
    return {
        "travelling": _mean(error[away]),
        "arrived": _mean(error[near]),
        "arrived_p95": _p95(error[near]),
        "travel_time": float(away.sum()) / max(int(counts.any(axis=0).sum()), 1) * period,
    }


def hand_acceleration(hands: np.ndarray) -> float:
    """Return the root mean square of the hands' acceleration [m/s^2]; NaN for fewer than three samples.

    Positions (T, 2, 3) are in the world [m], one sample every `RECORD_PERIOD`.
    """
    if len(hands) < 3:
        return float("nan")
    acceleration = np.diff(hands, n=2, axis=0) / RECORD_PERIOD**2
    return float(np.sqrt((acceleration**2).sum(axis=2).mean()))


def arrived(trace: Trace) -> np.ndarray:
    """Return whether each hand had arrived at its present target, shape (T, 2), bool; False without a target."""
    found = np.zeros(trace.hand_error.shape, dtype=bool)
    for side in range(2):
        error, target = trace.hand_error[:, side], trace.hand_target_world[:, side]
        there = False
        for sample in range(len(error)):
            jumped = sample and np.linalg.norm(target[sample] - target[sample - 1]) > JUMP
            there = bool(np.isfinite(error[sample]) and ((there and not jumped) or error[sample] <= ARRIVED))
            found[sample, side] = there
    return found


def _p95(values: np.ndarray) -> float | None:
    return float(np.percentile(values, 95)) if values.size else None


def _mean(values: np.ndarray) -> float | None:
    return float(values.mean()) if values.size else None


# Effort


def mechanical_power(trace: Trace, settle: float = SETTLE_S) -> float:
    """Return the mean over time of sum_i |tau_i dq_i| at the physics steps [W]: braking costs as much as driving.

    NaN if the run ended before `settle`.
    """
    kept = trace.time >= settle
    return float(trace.power[kept].mean()) if kept.any() else float("nan")


def speed(trace: Trace, settle: float = SETTLE_S) -> float:
    """Return the straight horizontal distance of the pelvis from `settle` to the end, over the time between [m/s]."""
    path = trace.qpos[trace.time >= settle, :2]
    if len(path) < 2:
        return float("nan")
    return float(np.linalg.norm(path[-1] - path[0])) / ((len(path) - 1) * RECORD_PERIOD)


def cost_of_transport(trace: Trace, mass: float, settle: float = SETTLE_S) -> float:
    """Return mechanical power / (mass * g * speed), dimensionless; NaN for a path below `SHORTEST_WAY`.

    The walk must be straight: the distance from start to end counts as its path. The mass [kg] includes a payload.
    """
    pace = speed(trace, settle)
    way = pace * (trace.time[-1] - settle)
    return mechanical_power(trace, settle) / (mass * GRAVITY * pace) if way >= SHORTEST_WAY else float("nan")


# Computing time


def percentiles(milliseconds: np.ndarray) -> dict[str, float | None]:
    """Return the median and the 99th percentile of the times of calls [ms]; None if there was no call."""
    if not milliseconds.size:
        return {"p50": None, "p99": None}
    p50, p99 = np.percentile(milliseconds, (50, 99)).tolist()
    return {"p50": p50, "p99": p99}
