import math

import mujoco
import numpy as np
import pytest

from hugwbc import JointCommand, load_robot
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.sim import Disturber, Force, Simulation

ROBOT = load_robot()
HOLD = JointCommand.position(ROBOT, ROBOT.nominal)


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return Simulation()


def applied(simulation: Simulation, disturber: Disturber, t: float, link: str = "torso_link") -> np.ndarray:
    disturber.update(t, simulation.data.qpos, simulation.data.xfrc_applied)
    return simulation.data.xfrc_applied[simulation.model.body(link).id].copy()


def test_forces_begin_end_and_add_up(simulation):
    simulation.reset()
    forces = (Force((10.0, 0.0, 0.0), start=0.1, duration=0.2), Force((1.0, 2.0, 3.0), start=0.2))
    disturber = Disturber(simulation.link_names, (*forces, Force((0.0, 5.0, 0.0), start=0.2, link="pelvis")))
    wanted = {0.0: (0, 0, 0), 0.098: (0, 0, 0), 0.1: (10, 0, 0), 0.2: (11, 2, 3), 0.298: (11, 2, 3), 0.3: (1, 2, 3)}
    for t, force in {**wanted, 99.0: (1, 2, 3)}.items():
        np.testing.assert_array_equal(applied(simulation, disturber, t), [*force, 0, 0, 0])
    np.testing.assert_array_equal(applied(simulation, disturber, 99.0, "pelvis"), [0, 5, 0, 0, 0, 0])
    assert not disturber.update(99.1, simulation.data.qpos, simulation.data.xfrc_applied), "nothing changes any more"


def test_a_force_in_the_heading_frame_keeps_the_heading_of_its_start(simulation):
    simulation.reset(yaw=math.pi / 2)
    disturber = Disturber(simulation.link_names, (Force((10.0, 0.0, 4.0), frame="heading"),))
    np.testing.assert_allclose(applied(simulation, disturber, 0.0)[:3], [0.0, 10.0, 4.0], atol=1e-9)
    simulation.reset(yaw=0.0)
    assert not disturber.update(0.1, simulation.data.qpos, simulation.data.xfrc_applied), "it does not turn later"
    disturber.reset()
    np.testing.assert_allclose(applied(simulation, disturber, 0.0)[:3], [10.0, 0.0, 4.0], atol=1e-9)


def test_the_momentum_is_force_times_time(simulation):
    """In the air, 100 N for 0.1 s give the robot 10 Ns."""
    simulation.reset()
    simulation.data.qpos[2] += 5.0
    disturber = Disturber(simulation.link_names, (Force((100.0, -50.0, 0.0), start=0.05, duration=0.1, link="pelvis"),))
    for step in range(100):
        disturber.update(step * 0.002, simulation.data.qpos, simulation.data.xfrc_applied)
        simulation.step(HOLD, 0.002)
    mujoco.mj_subtreeVel(simulation.model, simulation.data)
    momentum = simulation.data.subtree_linvel[1] * simulation.model.body_mass.sum()
    np.testing.assert_allclose(momentum[:2], [10.0, -5.0], rtol=0.01)


@pytest.mark.parametrize(
    ("values", "message"),
    [({"vector": (1.0, math.nan, 0.0)}, "vector.1"), ({"start": -1.0}, "start"), ({"duration": 0.0}, "duration")],
)
def test_bad_forces_are_refused(values, message):
    with pytest.raises(ConfigError, match=message):
        Force(**{"vector": (1.0, 0.0, 0.0), **values})


def test_unknown_names_are_refused(simulation):
    with pytest.raises(UnknownNameError, match="Did you mean 'torso_link'"):
        Disturber(simulation.link_names, (Force((1.0, 0.0, 0.0), link="torso"),))
    with pytest.raises(UnknownNameError, match="Did you mean 'world'"):
        Force((1.0, 0.0, 0.0), frame="wrld")
