"""What a motion costs: mechanical power, cost of transport, use of the joints' limits, smoothness."""

import numpy as np

from hugwbc.evaluation.metrics import SETTLE_S, jitter
from hugwbc.robot import load_robot
from hugwbc.runtime.trace import RECORD_PERIOD, Trace
from hugwbc.state import GRAVITY

SHORTEST_WAY = 0.1  # [m]; below, a cost of transport means nothing


def mechanical_power(trace: Trace, settle: float = SETTLE_S) -> float:
    """Mean over time of sum_i |tau_i dq_i| [W]: braking costs as much as driving. NaN for a shorter run."""
    kept = trace.time >= settle
    if not kept.any():
        return float("nan")
    return float(np.abs(trace.torque[kept] * trace.qvel[kept, 6:]).sum(axis=1).mean())


def speed(trace: Trace, settle: float = SETTLE_S) -> float:
    """Horizontal distance of the pelvis from where it was at `settle` to the end, over the time [m/s]."""
    path = trace.qpos[trace.time >= settle, :2]
    if len(path) < 2:
        return float("nan")
    return float(np.linalg.norm(path[-1] - path[0])) / ((len(path) - 1) * RECORD_PERIOD)


def cost_of_transport(trace: Trace, mass: float, settle: float = SETTLE_S) -> float:
    """Mechanical power over weight times speed [1]; NaN below `SHORTEST_WAY` of way.

    Args:
        trace: of a walk straight ahead: its way is the distance from start to end.
        mass: of robot and payload [kg].
        settle: start that is left out [s].
    """
    pace = speed(trace, settle)
    way = pace * (trace.time[-1] - settle)
    return mechanical_power(trace, settle) / (mass * GRAVITY * pace) if way >= SHORTEST_WAY else float("nan")


def limit_use(values: np.ndarray, limit: np.ndarray) -> dict[str, float]:
    """Part of their limits that joints use: root mean square and peak of the joint that uses most.

    Args:
        values: torques or speeds, shape (samples, 19).
        limit: of the joints, in the same unit, shape (19,).
    """
    share = np.abs(values) / limit
    return {"rms": float(np.sqrt((share**2).mean(axis=0)).max()), "peak": float(share.max())}


def torque_use(trace: Trace, settle: float = SETTLE_S) -> dict[str, float] | None:
    """Use of the torque limits (`limit_use`); None for a shorter run."""
    kept = trace.time >= settle
    return limit_use(trace.torque[kept], load_robot().torque_limit) if kept.any() else None


def joint_speed_use(trace: Trace, settle: float = SETTLE_S) -> dict[str, float] | None:
    """Use of the joints' speed limits (`limit_use`); None for a shorter run."""
    kept = trace.time >= settle
    return limit_use(trace.qvel[kept, 6:], load_robot().velocity_limit) if kept.any() else None


def torque_rate(trace: Trace, settle: float = SETTLE_S) -> float:
    """Root mean square over time and joints of the torques' change from sample to sample [N*m/s]: how rough it is.

    Unlike the roughness of position targets, it compares controllers that command positions with those that command
    torques. NaN for a shorter run.
    """
    torque = trace.torque[trace.time >= settle]
    return float(np.sqrt(np.mean((np.diff(torque, axis=0) / RECORD_PERIOD) ** 2))) if len(torque) > 1 else float("nan")


def target_jerk(trace: Trace, settle: float = SETTLE_S) -> float:
    """Mean squared third difference of the commanded joint positions [rad^2/s^6]; NaN for a shorter run."""
    return jitter(trace.target[trace.time >= settle], RECORD_PERIOD)
