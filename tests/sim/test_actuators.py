"""Drives: torque-speed limit, friction, reflected inertia and delay, for one robot and for many."""

import mujoco
import numpy as np
import pytest

from hugwbc import Command, JointCommand, load_robot
from hugwbc.runtime.loop import ControlLoop
from hugwbc.sim import Actuators, Simulation
from hugwbc.sim.actuators import TorqueSpeedLimit
from hugwbc.sim.batch import BatchSimulation
from hugwbc.sim.robot_model import load_model

ROBOT = load_robot("h1")  # whose drives have the inertia that the limit needs
HOLD = JointCommand.position(ROBOT, ROBOT.nominal)
ZERO = np.zeros(19)
NO_DELAY = Actuators(delay=0.0)


def torque(tau: np.ndarray) -> JointCommand:
    return JointCommand(ZERO, ZERO, ZERO, ZERO, tau)


def floating(actuators: Actuators) -> Simulation:
    """Robot in free space: no gravity, no ground within reach."""
    simulation = Simulation(robot=ROBOT, actuators=actuators)
    simulation.model.opt.gravity[:] = 0.0
    simulation.reset()
    simulation.data.qpos[2] = 5.0
    mujoco.mj_forward(simulation.model, simulation.data)
    return simulation


def test_the_torque_falls_from_the_corner_speed_to_zero_at_the_highest_speed() -> None:
    limit, force_range = TorqueSpeedLimit(ROBOT, ROBOT.torque_limit), np.zeros((19, 2))
    top, corner, full = ROBOT.velocity_limit, ROBOT.corner_speed, ROBOT.torque_limit
    between = 0.5 * (corner + top)
    for speed, driving in ((ZERO, full), (corner, full), (between, 0.5 * full), (top, ZERO), (3 * top, ZERO)):
        limit.write(speed, force_range)
        np.testing.assert_allclose(force_range[:, 1], driving, atol=1e-9)
        np.testing.assert_allclose(force_range[:, 0], -full, atol=1e-9, err_msg="braking has the full torque")
        limit.write(-speed, force_range)
        np.testing.assert_allclose(force_range[:, 0], -driving, atol=1e-9)
        np.testing.assert_allclose(force_range[:, 1], full, atol=1e-9)


def test_speeds_that_are_not_numbers_leave_a_finite_range() -> None:
    force_range = np.zeros((19, 2))
    TorqueSpeedLimit(ROBOT, ROBOT.torque_limit).write(np.full(19, np.nan), force_range)
    assert np.isfinite(force_range).all()


def test_the_simulation_limits_the_torque_by_the_speed_that_it_begins_a_step_with() -> None:
    simulation = floating(Actuators(friction=0.0, delay=0.0))
    knee = ROBOT.index("left_knee_joint")
    rng, beyond = np.random.default_rng(0), 0
    for _ in range(200):
        tau = 2.0 * ROBOT.torque_limit * rng.choice([-1.0, 1.0], 19)
        force_range, before = np.zeros((19, 2)), simulation.data.qvel[6:].copy()
        TorqueSpeedLimit(ROBOT, ROBOT.torque_limit).write(before, force_range)
        simulation.step(torque(tau), 0.002)
        np.testing.assert_allclose(simulation.torque, np.clip(tau, force_range[:, 0], force_range[:, 1]), atol=1e-9)
        beyond += int(np.sum(np.abs(before) > ROBOT.corner_speed))
    assert beyond > 20
    # However long a torque drives a joint, it never gets much beyond its highest speed.
    simulation = floating(Actuators(friction=0.0, delay=0.0))
    simulation.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    push = np.where(np.arange(19) == knee, 300.0, 0.0)
    speeds = [simulation.step(torque(push), 0.002).dq[knee] for _ in range(100)]
    assert 0.8 * ROBOT.velocity_limit[knee] < max(speeds) < 1.05 * ROBOT.velocity_limit[knee]


def test_ideal_drives_have_no_speed_limit_friction_or_delay() -> None:
    simulation = floating(Actuators.ideal())
    simulation.data.qvel[6:] = 3.0 * ROBOT.velocity_limit
    simulation.step(torque(ROBOT.torque_limit), 0.002)
    np.testing.assert_allclose(simulation.torque, ROBOT.torque_limit)
    assert not simulation.model.dof_frictionloss.any()
    np.testing.assert_array_equal(simulation.model.dof_damping[6:], ROBOT.damping)


def test_friction_holds_a_joint_against_a_smaller_torque() -> None:
    for actuators, moves in ((Actuators.ideal(), True), (NO_DELAY, False)):
        simulation = floating(actuators)
        start = simulation.state().q
        for _ in range(50):
            simulation.step(torque(0.5 * ROBOT.friction), 0.002)
        assert bool(np.abs(simulation.state().q - start).max() > 0.05) is moves


def driven_by_torques(timestep: float) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Robot with real drives in free space, whose control inputs are joint torques."""
    model = load_model(timestep, robot=ROBOT, actuators=Actuators())
    model.opt.gravity[:] = 0.0
    model.actuator_gainprm[:, 0], model.actuator_biasprm[:] = 1.0, 0.0
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qpos[2] = 5.0
    return model, data


@pytest.mark.parametrize(("timestep", "creep"), [(0.002, 0.001), (0.005, 0.002)])
def test_a_joint_that_sticks_does_not_creep(timestep: float, creep: float) -> None:
    model, data = driven_by_torques(timestep)
    data.ctrl[:] = np.where(np.arange(19) % 2, 0.9, -0.9) * ROBOT.friction
    for _ in range(round(1.0 / timestep)):
        mujoco.mj_step(model, data)
    assert np.abs(data.qvel[6:]).max() < creep


@pytest.mark.parametrize("timestep", [0.002, 0.005])
def test_the_solver_converges_with_friction(timestep: float) -> None:
    model, data = driven_by_torques(timestep)
    rng, off = np.random.default_rng(0), []
    iterations = model.opt.iterations, model.opt.ls_iterations, model.opt.tolerance
    for step in range(400):
        if step % 10 == 0:
            data.ctrl[:] = 0.2 * ROBOT.torque_limit * rng.uniform(-1.0, 1.0, 19)
        model.opt.iterations, model.opt.ls_iterations, model.opt.tolerance = 200, 200, 1e-14
        mujoco.mj_forward(model, data)
        exact = data.qacc.copy()
        data.qacc_warmstart[:] = 0.0
        model.opt.iterations, model.opt.ls_iterations, model.opt.tolerance = iterations
        mujoco.mj_step(model, data)
        off.append(np.abs(data.qacc - exact).max() / np.abs(exact).max())
    assert np.quantile(off, 0.99) < 1e-6


def test_friction_takes_energy_out_and_never_puts_any_in() -> None:
    simulation = floating(NO_DELAY)
    simulation.data.qvel[6:] = np.random.default_rng(0).uniform(-2.0, 2.0, 19)
    energies = []
    for _ in range(500):
        simulation.step(torque(ZERO), 0.002)
        momentum = np.zeros(25)
        mujoco.mj_mulM(simulation.model, simulation.data, momentum, simulation.data.qvel)
        energies.append(0.5 * momentum @ simulation.data.qvel)
    assert np.diff(energies).max() < 1e-3 * energies[0]
    assert np.abs(simulation.data.qvel[6:]).max() < 0.01, "after a second every joint stands still"


def test_reflected_inertia_adds_to_the_mass_matrix() -> None:
    diagonals = []
    for factor in (0.5, 1.0, 2.0):
        model = load_model(0.002, robot=ROBOT, actuators=Actuators(armature=factor))
        data, matrix = mujoco.MjData(model), np.zeros((25, 25))
        mujoco.mj_resetDataKeyframe(model, data, 0)
        mujoco.mj_forward(model, data)
        for column, unit in zip(matrix, np.eye(25), strict=True):
            mujoco.mj_mulM(model, data, column, unit)
        diagonals.append(np.diag(matrix)[6:])
    np.testing.assert_allclose(diagonals[1] - diagonals[0], 0.5 * ROBOT.armature)
    np.testing.assert_allclose(diagonals[2] - diagonals[1], ROBOT.armature)


def test_what_is_told_of_the_drives_is_what_they_are() -> None:
    told = Actuators(friction=0.5, armature=2.0, delay=0.01).known_robot(ROBOT)
    speed = np.linspace(-3.0, 3.0, 19)
    np.testing.assert_allclose(told.friction_torque(speed), 0.5 * ROBOT.friction_torque(speed))
    np.testing.assert_allclose(told.armature, 2.0 * ROBOT.armature)
    assert told.command_delay == 0.01 and Actuators().known_robot(ROBOT) is ROBOT
    frictionless = Simulation(actuators=Actuators(friction=0.0))
    loop = ControlLoop("qp", Command(), frictionless)
    assert loop.control.guard.controller.robot is frictionless.known_robot
    assert not frictionless.known_robot.friction.any() and frictionless.known_robot.command_delay == 0.002


@pytest.mark.parametrize(("delay", "steps"), [(0.0, 0), (0.0005, 1), (None, 1), (0.006, 3)])
def test_a_command_acts_after_the_delay(delay: float | None, steps: int) -> None:
    simulation = floating(Actuators(torque_speed=False, friction=0.0, delay=delay))
    simulation.step(torque(ZERO), 0.002)
    seen = []
    for _ in range(6):
        simulation.step(torque(np.ones(19)), 0.002)
        seen.append(float(simulation.torque[0]))
    assert seen == [0.0] * steps + [1.0] * (6 - steps)


def test_the_first_command_after_a_reset_acts_at_once() -> None:
    simulation = Simulation(robot=ROBOT, actuators=Actuators())
    for _ in range(2):
        simulation.reset()
        simulation.step(torque(np.ones(19)), 0.002)
        np.testing.assert_allclose(simulation.torque, 1.0)


def test_many_robots_have_the_same_drives_as_one() -> None:
    """The same steps as one simulation, to the rounding of its extra forward pass."""
    one = Simulation(timestep=0.005, actuators=NO_DELAY)
    many = BatchSimulation(2, actuators=NO_DELAY, robot=load_robot())
    one.reset()
    rng, limited = np.random.default_rng(0), 0
    for _ in range(20):
        target = ROBOT.nominal + 0.5 * rng.standard_normal(19)
        one.step(JointCommand.position(ROBOT, target), 0.02)
        many.ctrl[:] = many.tensor(target)
        many.step(4)
        limited += int(np.sum(np.abs(many.qvel[0, 6:].numpy()) > ROBOT.corner_speed))
        np.testing.assert_allclose(many.qpos[0], one.data.qpos, atol=1e-6)
    assert limited > 0
    np.testing.assert_array_equal(many.qpos[0], many.qpos[1])


def test_every_robot_of_a_batch_can_have_drives_of_its_own() -> None:
    """What a training varies: friction, damping and inertia of single robots."""
    batch = BatchSimulation(3, actuators=NO_DELAY, robot=load_robot())
    for field, factor in (("dof_frictionloss", 3.0), ("dof_damping", 2.0), ("dof_armature", 1.5)):
        batch.expand(field)[1, 6:] *= factor
    batch.set_const()
    for _ in range(5):
        batch.ctrl[:] = batch.tensor(ROBOT.nominal + 0.2)
        assert not batch.step(4).any()
    np.testing.assert_array_equal(batch.qpos[0], batch.qpos[2])
    assert (batch.qpos[1] - batch.qpos[0]).abs().max() > 1e-3


def test_the_solver_converges_on_a_standing_robot_with_real_drives() -> None:
    """Friction of 19 joints and the contacts of two feet together; short of convergence, the ankles shake."""
    simulation = Simulation()
    model, steps = simulation.model, []
    for _ in range(100):
        simulation.step(HOLD, simulation.timestep)
        steps.append(int(simulation.data.solver_niter[0]))
    assert max(steps) < model.opt.iterations
