"""The hoist of a simulated robot."""

import mujoco
import numpy as np
import pytest

from hugwbc import JointCommand
from hugwbc.deploy.hoist import LIFTED, LOWERED, Hoist
from hugwbc.sim import Simulation
from hugwbc.state import GRAVITY


@pytest.fixture
def simulation() -> Simulation:
    return Simulation()


def run(simulation: Simulation, hoist: Hoist, seconds: float, *, stiff: bool = True) -> None:
    command = JointCommand.position(simulation.robot, simulation.robot.nominal)
    zero = np.zeros(19)
    limp = JointCommand(q=zero, dq=zero, kp=zero, kd=zero, tau=zero)
    for _ in range(round(seconds / simulation.timestep)):
        hoist.update()
        simulation.step(command if stiff else limp, simulation.timestep)


def test_it_lifts_a_limp_robot_and_carries_its_weight(simulation) -> None:
    before = float(simulation.qpos[2])
    hoist = Hoist(simulation)
    run(simulation, hoist, 3.0, stiff=False)
    weight = simulation.robot.mass * GRAVITY
    assert hoist.tension == pytest.approx(weight, rel=0.05)
    assert simulation.qpos[2] - before == pytest.approx(LIFTED, abs=0.03)
    foot_force = simulation.state().foot_force
    assert foot_force is not None and abs(foot_force[:, 2].sum()) < 1.0, "the feet may touch each other"
    assert abs(float(simulation.qpos[3])) > 0.95, "upright"


def test_a_lowered_robot_carries_most_of_its_weight_itself(simulation) -> None:
    hoist = Hoist(simulation, 0.0)
    hoist.lower()
    run(simulation, hoist, 1.2)
    foot_force = simulation.state().foot_force
    assert foot_force is not None
    assert foot_force[:, 2].sum() > 0.5 * simulation.robot.mass * GRAVITY
    assert not simulation.fallen
    assert hoist.height == pytest.approx(LOWERED)


def test_a_rope_never_pushes_and_lets_go(simulation) -> None:
    hoist = Hoist(simulation, 0.0)
    simulation.data.qpos[2] += 0.3  # nearer to the pulley: slack
    mujoco.mj_forward(simulation.model, simulation.data)
    hoist.update()
    assert hoist.tension == 0.0
    hoist = Hoist(simulation, 0.1)
    run(simulation, hoist, 0.2)
    assert hoist.tension > 100.0
    hoist.release()
    hoist.update()
    assert hoist.tension == 0.0 and not np.any(simulation.external_force)
