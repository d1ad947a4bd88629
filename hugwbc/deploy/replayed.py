"""The record of a replayed deployment, for the pages that show runs: the robot side's estimates."""

from typing import Any

import numpy as np

from hugwbc.deploy.pilot import Pilot
from hugwbc.kinematics import MEASURED_NAMES
from hugwbc.robot import Robot
from hugwbc.runtime.trace import RECORD_PERIOD, Trace

_NO_TOUCH_DOWNS = (np.zeros(0), np.zeros(0))
_NO_VELOCITIES = (np.zeros((0, 3)), np.zeros((0, 3)))


class ReplayedRun:
    """A collector of estimates at `RECORD_PERIOD`.

    What only a simulation knows is missing: centres of pressure, and the errors of hands and commands. Position and yaw
    are the estimator's, which drift.
    """

    def __init__(self, robot: Robot) -> None:
        """Begin without a sample."""
        self._robot = robot
        self._rows: dict[str, list[Any]] = {}
        self._begin: float | None = None

    def add(self, pilot: Pilot) -> None:
        """Add a sample, if one is due and there is an estimate."""
        estimate = pilot.estimate
        if estimate is None or not estimate.is_usable or estimate.position is None or estimate.velocity is None:
            return
        self._begin = estimate.time if self._begin is None else self._begin
        time = estimate.time - self._begin
        if time < len(self._rows.get("time", ())) * RECORD_PERIOD - 1e-9:
            return
        force = np.zeros((2, 3)) if estimate.foot_force is None else estimate.foot_force
        row = {
            "time": time,
            "command": pilot.safe.command.array(),
            "gait": int(pilot.safe.command.gait),
            "phase": pilot.plan.phase,
            "foot_contact": pilot.estimator.contact.copy(),
            "foot_force": force.copy(),
            "foothold": pilot.plan.footholds,
            "qpos": np.concatenate((estimate.position, estimate.orientation, estimate.q)),
            "qvel": np.concatenate((estimate.velocity, estimate.angular_velocity, estimate.dq)),
            "torque": np.zeros(19) if estimate.torque is None else estimate.torque,
            "target": estimate.q if pilot.commanded is None else pilot.commanded.q,
        }
        for name, value in row.items():
            self._rows.setdefault(name, []).append(value)

    def trace(self, name: str, pilot: Pilot) -> Trace | None:
        """Return the record; None if there was no sample."""
        if not self._rows:
            return None
        rows: dict[str, Any] = {key: np.array(values) for key, values in self._rows.items()}
        count = rows["time"].size

        def unknown(*shape: int) -> np.ndarray:
            return np.full((count, *shape), np.nan)

        return Trace(
            name=name,
            **rows,
            measured=unknown(len(MEASURED_NAMES)),
            clearance=unknown(2),
            pressure_centre=unknown(2, 3),
            hand_target_world=unknown(2, 3),
            arm_target=unknown(8),
            hand_error=unknown(2),
            reachable=np.zeros((count, 2), dtype=bool),
            tick_ms=np.zeros(0),
            ik_ms=np.zeros(0),
            touch_downs=_NO_TOUCH_DOWNS,
            touch_down_velocity=_NO_VELOCITIES,
            stance_peak=_NO_TOUCH_DOWNS,
            mass=self._robot.mass,
            fell=False,
            survived_s=float(rows["time"][-1]),
            steps=count,
            safety=pilot.safe.report(),
            robot=self._robot.name,
        )
