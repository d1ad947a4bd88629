"""What the controller was not told: mass, friction, delay, load in the hands, a slower clock; and absurd states."""

import dataclasses

import mujoco
import numpy as np
import pytest

from hugwbc import Command, Gait, RobotState, UpperBody, load_robot, rotations
from hugwbc.mbc import Output, QpStatus, WholeBodyController
from hugwbc.sim import Simulation

ROBOT = load_robot()
WALK = Command(v_x=0.6, gait=Gait.WALKING)


def _heavier_torso(simulation):
    simulation.model.body_mass[simulation.model.body("torso_link").id] += 9.0
    mujoco.mj_setConst(simulation.model, simulation.data)


def _loaded_hands(simulation):
    """2 kg at the middle of each fist, as a point."""
    model, hand = simulation.model, np.array([0.28, 0.0, -0.015])
    for side in ("left", "right"):
        body = model.body(f"{side}_elbow_link").id
        mass, centre = model.body_mass[body], model.body_ipos[body].copy()
        model.body_ipos[body] = (mass * centre + 2.0 * hand) / (mass + 2.0)
        model.body_mass[body] = mass + 2.0
        model.body_inertia[body] += mass * 2.0 / (mass + 2.0) * (hand - centre) @ (hand - centre)
    mujoco.mj_setConst(model, simulation.data)


def _slippery(simulation):
    friction = simulation.model.geom_friction
    friction[:, 0] = np.where(friction[:, 0] > 0.3, 0.5, friction[:, 0])


def _walk(change=None, *, period=0.002, latency=0.0, seconds=5.0):
    """Mean v_x after two seconds, and whether the robot stayed up; the controller is not told of the latency."""
    simulation = Simulation(latency=latency)
    if change is not None:
        change(simulation)
    simulation.reset()
    controller = WholeBodyController(period=period)
    controller.reset(simulation.sense())
    speeds = []
    for tick in range(round(seconds / period)):
        reading = dataclasses.replace(simulation.sense(), age=0.0)
        state = simulation.step(controller.act(reading, WALK, UpperBody.none()), period)
        if tick * period > 2.0:
            speeds.append(state.velocity[0])
        if simulation.fallen:
            return 0.0, False
    return float(np.mean(speeds)), True


@pytest.mark.slow
@pytest.mark.parametrize("change", [_heavier_torso, _slippery, _loaded_hands])
def test_it_walks_with_what_it_does_not_know(change):
    speed, up = _walk(change)
    assert up and speed == pytest.approx(0.6, abs=0.1)


@pytest.mark.slow
def test_it_walks_with_a_delay_that_it_does_not_know():
    speed, up = _walk(latency=0.014)
    assert up and speed == pytest.approx(0.6, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("period", [0.002, 0.004, 0.01, 0.02])
def test_it_walks_at_lower_rates(period):
    speed, up = _walk(period=period)
    assert up and speed == pytest.approx(0.6, abs=0.15)


def _random_state(rng, absurd):
    scale = 10.0 ** rng.uniform(0.0, 7.0) if absurd else 1.0
    orientation = rng.normal(size=4) if absurd else rotations.from_yaw_pitch_roll(*rng.uniform(-0.3, 0.3, 3))
    return RobotState(
        q=scale * rng.normal(size=19) if absurd else np.clip(ROBOT.nominal + rng.uniform(-0.2, 0.2, 19), ROBOT.lower,
                                                             ROBOT.upper),
        dq=scale * rng.normal(size=19),
        orientation=orientation / np.linalg.norm(orientation),
        angular_velocity=scale * rng.normal(size=3),
        position=np.array([0.0, 0.0, 0.95]) + (scale * rng.normal(size=3) if absurd else 0.0),
        velocity=scale * rng.normal(size=3),
    )  # fmt: skip


def test_random_and_absurd_states_give_solutions_or_named_fallbacks():
    """Half of the states and of the commands absurd: NaN, infinite, far out of range, numbers up to 1e7."""
    rng, controller, outputs = np.random.default_rng(0), WholeBodyController(), set()
    limit = controller.params.torque_fraction * ROBOT.torque_limit
    gaits = list(Gait)
    for index in range(200):
        absurd = index % 2 == 1
        state = _random_state(rng, absurd)
        if absurd and index % 20 == 1:
            state = dataclasses.replace(state, dq=np.full(19, (np.nan, np.inf)[index // 20 % 2]))
        values = rng.normal(size=8) * (10.0 ** rng.uniform(0, 9) if absurd else 0.5)
        values[rng.integers(8)] = np.nan if absurd else 0.0
        command = Command.from_array(values, gaits[rng.integers(len(gaits))])
        if index % 5 == 0:
            controller.reset(state)
        joint_command = controller.act(state, command, UpperBody.none())
        assert joint_command.is_finite
        assert np.all(np.abs(joint_command.tau) <= limit + 1e-9)
        diagnostics = controller.diagnostics
        assert (diagnostics.output is Output.SOLUTION) == (diagnostics.status is not QpStatus.FAILED)
        outputs.add(diagnostics.output)
    assert outputs == set(Output)
