import dataclasses
import math

import mujoco
import numpy as np
import pytest

from hugwbc import rotations
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.sim import Disturber, Force, Simulation
from hugwbc.sim.forces import HandPull


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return Simulation()


def applied(simulation: Simulation, disturber: Disturber, t: float, link: str = "torso_link") -> np.ndarray:
    disturber.update(t, simulation.data.qpos, simulation.data.xfrc_applied)
    return simulation.data.xfrc_applied[simulation.model.body(link).id].copy()


def test_forces_begin_end_and_add_up(simulation):
    simulation.reset()
    forces = (Force((10.0, 0.0, 0.0), start=0.1, duration=0.2), Force((1.0, 2.0, 3.0), start=0.2))
    disturber = Disturber(
        simulation.link_names, "torso_link", (*forces, Force((0.0, 5.0, 0.0), start=0.2, link="pelvis"))
    )
    wanted = {0.0: (0, 0, 0), 0.098: (0, 0, 0), 0.1: (10, 0, 0), 0.2: (11, 2, 3), 0.298: (11, 2, 3), 0.3: (1, 2, 3)}
    for t, force in {**wanted, 99.0: (1, 2, 3)}.items():
        np.testing.assert_array_equal(applied(simulation, disturber, t), [*force, 0, 0, 0])
    np.testing.assert_array_equal(applied(simulation, disturber, 99.0, "pelvis"), [0, 5, 0, 0, 0, 0])


def test_a_force_in_the_heading_frame_keeps_the_heading_of_its_start(simulation):
    simulation.reset(yaw=math.pi / 2)
    forces = (Force((10.0, 0.0, 4.0), frame="heading"), Force((0.0, 0.0, 1.0), start=0.1))
    disturber = Disturber(simulation.link_names, "torso_link", forces)
    np.testing.assert_allclose(applied(simulation, disturber, 0.0)[:3], [0.0, 10.0, 4.0], atol=1e-9)
    simulation.data.qpos[3:7] = [1.0, 0.0, 0.0, 0.0]  # the robot turns meanwhile
    np.testing.assert_allclose(applied(simulation, disturber, 0.1)[:3], [0.0, 10.0, 5.0], atol=1e-9)


def test_unknown_names_are_refused(simulation):
    with pytest.raises(UnknownNameError, match="Did you mean 'torso_link'"):
        Disturber(simulation.link_names, "torso_link", (Force((1.0, 0.0, 0.0), link="torso"),))
    with pytest.raises(UnknownNameError, match="Did you mean 'world'"):
        Force((1.0, 0.0, 0.0), frame="wrld")


@pytest.mark.parametrize("forces", [Force((1.0, 0.0, 0.0)), [(1.0, 0.0, 0.0)]])
def test_what_is_no_sequence_of_forces_is_refused(simulation, forces):
    with pytest.raises(ConfigError, match=r"give a sequence of Force, such as \[Force"):
        Disturber(simulation.link_names, "torso_link", forces)


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
