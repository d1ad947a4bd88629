import dataclasses

import mujoco
import numpy as np
import pytest

from hugwbc import rotations
from hugwbc.sim import Simulation
from hugwbc.sim.hand_pull import HandPull


def test_the_force_rises_slowly_and_acts_at_both_hands():
    simulation = Simulation()
    state = simulation.reset(yaw=0.7)
    pull = HandPull(simulation, np.array([30.0, 0.0, -10.0]), 1.0, 2.0)
    pull.update(dataclasses.replace(state, time=0.9))
    assert not simulation.external_force.any()
    pull.update(dataclasses.replace(state, time=2.0))
    half = 0.25 * rotations.rotation_z(0.7) @ [30.0, 0.0, -10.0]
    assert pull.force == pytest.approx(np.stack((half, half)))
    model, data = simulation.model, simulation.data
    wanted, found = np.zeros(model.nv), np.zeros(model.nv)
    for side in ("left", "right"):
        body = model.body(f"{side}_elbow_link").id
        mujoco.mj_applyFT(model, data, half, np.zeros(3), simulation.hand_position(side), body, wanted)
        force, moment = np.split(simulation.external_force[body], 2)
        mujoco.mj_applyFT(model, data, force, moment, data.xipos[body], body, found)
    assert found == pytest.approx(wanted, abs=1e-6)
    pull.update(dataclasses.replace(state, time=9.0))
    assert pull.force == pytest.approx(np.stack((half, half)) * 2.0)
