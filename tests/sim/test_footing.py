"""Contacts of the soles on a height field, against heights that are looked up by hand."""

import mujoco
import numpy as np
import pytest
import torch

from hugwbc import JointCommand, load_robot
from hugwbc.sim import HeightField, Simulation, rough_terrain
from hugwbc.sim.batch import BatchSimulation
from hugwbc.sim.footing import FOOT_CONTACT_BIT, Footing

ROBOT = load_robot()
HOLD = JointCommand.position(ROBOT, ROBOT.nominal)
ROUGH = rough_terrain(0.02, np.random.default_rng(5))


def press(simulation: Simulation, xy: np.ndarray, yaw: float, depth: float) -> dict[str, tuple[float, np.ndarray]]:
    """Stand the robot up, press it into the ground [m], and return distance and normal of every sole contact."""
    simulation.reset(xy=(float(xy[0]), float(xy[1])), yaw=yaw)
    simulation.data.qpos[2] -= depth + 0.003
    mujoco.mj_forward(simulation.model, simulation.data)
    simulation._place_feet(simulation._footing)
    mujoco.mj_forward(simulation.model, simulation.data)
    contacts = {}
    for i in range(simulation.data.ncon):
        contact = simulation.data.contact[i]
        name = simulation.model.geom(contact.geom[1]).name
        if "toe" in name or "heel" in name:
            assert name not in contacts, "one contact for each sphere"
            contacts[name] = (contact.dist, contact.frame[:3].copy())
    return contacts


@pytest.mark.parametrize("depth", [0.002, 0.02, 0.04])
def test_deep_contacts_push_up_wherever_the_grid_s_edges_are(depth: float) -> None:
    level = np.zeros((81, 81))
    level[0, 0] = 1e-6
    simulation, rng = Simulation(terrain=HeightField(level, (16.0, 16.0))), np.random.default_rng(0)
    for _ in range(40):
        contacts = press(simulation, rng.uniform(-4.0, 4.0, 2), rng.uniform(-3.0, 3.0), depth)
        assert len(contacts) == 8
        for distance, normal in contacts.values():
            np.testing.assert_allclose(normal, [0.0, 0.0, 1.0], atol=1e-9)
            # The nominal pose is level to a millimetre.
            assert distance == pytest.approx(-depth, abs=1.5e-3)


def test_every_sphere_meets_the_ground_at_its_own_place() -> None:
    simulation, plane, rng = Simulation(terrain=ROUGH), Simulation(), np.random.default_rng(1)
    spheres = np.flatnonzero(simulation.model.geom_conaffinity == FOOT_CONTACT_BIT)
    for _ in range(20):
        xy, yaw = rng.uniform(-4.0, 4.0, 2), float(rng.uniform(-3.0, 3.0))
        contacts = press(simulation, xy, yaw, 0.03)
        # Where the spheres of the unchanged model are, in the same pose.
        plane.data.qpos[:] = simulation.data.qpos
        mujoco.mj_forward(plane.model, plane.data)
        assert len(contacts) == 8
        for index in spheres:
            name = simulation.model.geom(index).name
            point = plane.data.geom(name).xpos
            bottom = point[2] - plane.model.geom(name).size[0]
            expected = bottom - float(ROUGH.height_at(point[:2]))
            assert contacts[name][0] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("yaw", [0.0, 0.5])
def test_on_a_slope_the_soles_lie_flat_and_the_ground_pushes_along_its_normal(yaw: float) -> None:
    slope = 0.1
    simulation = Simulation(terrain=rough_terrain(0.0, np.random.default_rng(0), slope=slope))
    contacts = press(simulation, np.array([2.0, -1.0]), yaw, 0.03)
    assert len(contacts) == 8
    for distance, normal in contacts.values():
        np.testing.assert_allclose(normal, [-np.sin(slope), 0.0, np.cos(slope)], atol=1e-6)
        # Up to 3 cm less the width of the stance on the slope, across which the legs do not turn the soles.
        assert -0.045 < distance < 0.0
    along = [float(contacts[f"left_{end}_left"][0]) for end in ("heel", "toe")]
    assert along[0] == pytest.approx(along[1], abs=2e-3)


def test_on_a_slope_the_robot_starts_on_the_ground_and_stays_there() -> None:
    slope = 0.1
    simulation = Simulation(terrain=rough_terrain(0.0, np.random.default_rng(0), slope=slope))
    state = simulation.reset(xy=(3.0, 0.0))
    height = state.position[2]
    assert height - 3.0 * np.tan(slope) == pytest.approx(0.98, abs=0.02)
    state = simulation.step(HOLD, 0.1)
    assert np.abs(state.velocity).max() < 0.3
    assert state.foot_force[:, 2].sum() == pytest.approx(ROBOT.mass * 9.81, rel=0.05)
    assert set(simulation.links_on_ground) == set(ROBOT.foot_links)


def test_one_robot_and_many_stand_on_the_same_ground() -> None:
    one, many = Simulation(terrain=ROUGH, timestep=0.005), BatchSimulation(1, terrain=ROUGH, robot=load_robot())
    one.reset(xy=(1.0, 0.5))
    many.qpos[0] = many.tensor(one.data.qpos)
    many.ctrl[:] = many.tensor(ROBOT.nominal)
    many.forward(torch.tensor([0]))
    for _ in range(15):
        one.step(HOLD, 0.005)
        many.step(1)
    np.testing.assert_allclose(many.qpos[0], one.data.qpos, atol=1e-3)
    plain = Simulation(timestep=0.005)
    plain.reset(xy=(1.0, 0.5))
    for _ in range(15):
        plain.step(HOLD, 0.005)
    assert np.abs(plain.data.qpos[3:] - one.data.qpos[3:]).max() > 5e-3, "the ground makes a difference"


def test_a_robot_that_is_nowhere_has_finite_feet() -> None:
    simulation = Simulation(terrain=ROUGH)
    footing = Footing(simulation.model, ROUGH)
    xpos, xmat = simulation.data.xpos.copy(), simulation.data.xmat.copy()
    xpos[:], xmat[:] = np.nan, np.inf
    assert np.isfinite(footing.positions(xpos, xmat)).all()
