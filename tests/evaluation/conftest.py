"""Synthetic records with prescribed errors."""

import numpy as np
import pytest

from hugwbc import Command, Gait
from hugwbc.kinematics import MEASURED_NAMES
from hugwbc.runtime.safety import SafetyReport
from hugwbc.runtime.trace import Trace


def _synthetic_trace(
    command: Command | None = None,
    *,
    duration: float = 10.0,
    bias: dict[str, float] | None = None,
    frequency: float | None = None,
    apex: float | None = None,
    **fields,
) -> Trace:
    """A record that executes a command exactly, apart from the prescribed deviations.

    Feet touch down every 1 / frequency seconds, the right one half a cycle later, and each swing rises to the apex.
    """
    command = command or Command(gait=Gait.WALKING)
    frequency = command.f if frequency is None else frequency
    apex = command.l if apex is None else apex
    time = np.arange(0.0, duration, 0.02)
    n = time.size
    measured = np.stack(
        [np.full(n, getattr(command, name) + (bias or {}).get(name, 0.0)) for name in MEASURED_NAMES], axis=1
    )
    offsets = (0.0, 0.5)
    phases = [(time * frequency + offset) % 1.0 for offset in offsets]
    clearance = np.stack([apex * np.clip(np.sin(np.pi * (phase - 0.5) / 0.5), 0.0, None) for phase in phases], axis=1)
    downs = tuple(np.arange(1.0 - offset, duration * frequency) / frequency for offset in offsets)
    values = {
        "name": "synthetic",
        "time": time,
        "command": np.tile(command.array(), (n, 1)),
        "gait": np.full(n, int(command.gait)),
        "measured": measured,
        "clearance": clearance,
        "foot_contact": clearance <= 0.0,
        "phase": phases[1],
        "foot_force": np.zeros((n, 2, 3)),
        "pressure_centre": np.full((n, 2, 3), np.nan),
        "foothold": np.full((n, 2, 2), np.nan),
        "qpos": np.zeros((n, 26)),
        "qvel": np.zeros((n, 25)),
        "target": np.zeros((n, 19)),
        "hand_target_world": np.full((n, 2, 3), np.nan),
        "arm_target": np.full((n, 8), np.nan),
        "hand_error": np.full((n, 2), np.nan),
        "reachable": np.zeros((n, 2), dtype=bool),
        "torque": np.zeros((n, 19)),
        "tick_ms": np.full(n, 0.1),
        "ik_ms": np.zeros(n),
        "touch_downs": downs,
        "fell": False,
        "survived_s": duration,
        "steps": n,
        "safety": SafetyReport(ticks=n),
    }
    return Trace(**{**values, **fields})


@pytest.fixture
def synthetic_trace():
    """The function that makes synthetic records."""
    return _synthetic_trace
