"""A robot side that is killed while the robot walks, at 50 random moments."""

import collections
import copy

import mujoco
import numpy as np
import pytest
from deploy_bench import H1, Pair

from hugwbc.deploy import state_machine
from hugwbc.deploy.remote import Sticks
from hugwbc.deploy.simulated_robot import Extremes
from hugwbc.mbc import WholeBodyController
from hugwbc.robot import load_robot

KILLS, AFTER = 50, 1.0  # s


class Snapshot:
    """The physics at one moment and what is on its way, to come back to."""

    def __init__(self, pair: Pair) -> None:
        simulation = pair.robot.simulation
        self._pair, self._kind = pair, mujoco.mjtState.mjSTATE_INTEGRATION
        self._state = np.empty(mujoco.mj_stateSize(simulation.model, self._kind))
        mujoco.mj_getState(simulation.model, simulation.data, self._state, self._kind)
        self._engine = {
            name: copy.copy(getattr(simulation, name))
            for name in (
                *("_pending", "_readings", "_command", "_given", "_gains", "_accelerometer", "_torque"),
                *("_imu_orientation", "_imu_velocity", "_computed"),
            )
        }
        self._bias = simulation.model.actuator_biasprm.copy()
        self._waiting = list(pair.robot._states._waiting)

    def restore(self) -> None:
        simulation = self._pair.robot.simulation
        mujoco.mj_setState(simulation.model, simulation.data, self._state, self._kind)
        simulation.model.actuator_biasprm[:] = self._bias
        mujoco.mj_forward(simulation.model, simulation.data)
        for name, value in self._engine.items():
            setattr(simulation, name, copy.copy(value))
        assert isinstance(simulation._pending, collections.deque)
        self._pair.robot._states._waiting[:] = self._waiting
        self._pair.side._endpoint.receive(0.0)


def _soon_after(snapshot: Snapshot, pair: Pair) -> np.ndarray:
    """Return positions and velocities 10 ms after a kill, and come back."""
    pair.run(pair.robot.time + 0.01, alive=lambda: False)
    simulation = pair.robot.simulation
    moved = np.concatenate((simulation.qpos, simulation.qvel))
    snapshot.restore()
    return moved


@pytest.mark.slow
def test_after_a_kill_the_robot_holds_a_command_within_all_limits(monkeypatch) -> None:
    """The robot holds the last command, the worst that it can do, and falls; the command itself is within all limits.

    When the falling robot hits the ground, joints turn faster than their limits and press into their stops, which are
    soft in MuJoCo; docs/deploy.md has the figures.
    """
    monkeypatch.setattr(state_machine, "START_TIME", 0.4)
    pair = Pair(
        WholeBodyController(load_robot()),
        "0.02 Start, 0.1 lower, 1.3 A, 1.6 release, 1.8 ly=0.5",
        source=Sticks(load_robot()),
    )
    pair.run(3.0)
    rng, fallen, most = np.random.default_rng(7), 0, []
    low, high = H1.target_range
    for _ in range(KILLS):
        pair.run(pair.robot.time + float(rng.uniform(0.02, 0.1)))
        assert not pair.robot.simulation.fallen
        snapshot = Snapshot(pair)
        pair.robot.extremes = Extremes()
        pair.run(pair.robot.time + AFTER, alive=lambda: False)
        held = pair.robot._command
        assert np.all(held.q >= low - 1e-6) and np.all(held.q <= high + 1e-6)
        assert np.all(np.abs(held.tau) <= H1.torque_limit + 1e-4)
        fallen += pair.robot.simulation.fallen
        most.append(pair.robot.extremes)
        snapshot.restore()
    speed, torque, beyond = (max(getattr(one, name) for one in most) for name in ("speed", "torque", "beyond"))
    print(f"{KILLS} kills, {fallen} falls within {AFTER} s; {speed=}, {torque=}, {beyond=}")
    assert torque <= 1.0 + 1e-9
    assert fallen > KILLS // 2, "the worst case is reached"
    assert beyond < 0.4
    assert not pair.robot.simulation.diverged
    pair.run(pair.robot.time + 0.02)
    snapshot = Snapshot(pair)
    np.testing.assert_array_equal(*(_soon_after(snapshot, pair) for _ in range(2)))
