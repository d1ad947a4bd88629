"""Forces on the hands in the QP: the filter, the dynamics, the shift of the balance, and a pulled stand."""

import dataclasses

import numpy as np
import pytest

from hugwbc.commands import Command
from hugwbc.controller import UpperBody
from hugwbc.hand_wrench import HandWrench
from hugwbc.mbc import WholeBodyController
from hugwbc.mbc.dynamics import Dynamics
from hugwbc.mbc.footsteps import Pendulum
from hugwbc.mbc.hand_load import HandLoad
from hugwbc.mbc.qp import QpStatus
from hugwbc.robot import load_robot
from hugwbc.runtime.loop import ControlLoop
from hugwbc.scripts.view import Constant
from hugwbc.sim import Simulation
from hugwbc.sim.forces import HandPull

DT = 0.002
ARMS = UpperBody.none()
PULL = np.array([[20.0, 0.0, -30.0], [0.0, 5.0, 0.0]])


def after(load, state, time, *, stepping, targets=ARMS):
    """Return the force that counts after some time [s]."""
    for _ in range(round(time / DT)):
        load.update(state, targets, DT, stepping=stepping)
    return load.force


def felt(state, force):
    """Return the state with a force on the left hand [N]."""
    return dataclasses.replace(state, hand_force=np.array([force, [0.0, 0.0, 0.0]]))


@pytest.fixture
def load():
    return HandLoad(10.0, 5.0)


def test_small_forces_are_none_and_large_ones_count_in_full(load, standing_state):
    for force, share in ((4.0, 0.0), (7.5, 0.5), (40.0, 1.0)):
        load.reset()
        counted = after(load, felt(standing_state, [force, 0.0, 0.0]), 4.0, stepping=True)
        assert counted[0, 0] == pytest.approx(share * force, abs=0.05)
        assert not counted[1].any()


def test_a_felt_force_counts_only_after_it_has_made_the_robot_step(standing_state):
    load, pulled = HandLoad(10.0, 5.0), felt(standing_state, [40.0, 0.0, 0.0])
    assert not after(load, pulled, 4.0, stepping=False).any(), "a stand that leans against a post falls"
    assert not after(load, pulled, 0.3, stepping=True).any(), "a touch ends with the first step"
    assert after(load, pulled, 0.4, stepping=True)[0, 0] == pytest.approx(40.0, abs=0.1)
    assert after(load, pulled, 1.0, stepping=False)[0, 0] == pytest.approx(40.0, abs=0.1), "the stand that follows"
    assert not after(load, felt(standing_state, [0.0, 0.0, 0.0]), 1.0, stepping=False).any()
    assert not after(load, pulled, 4.0, stepping=False).any(), "the next force has to prove itself"


@pytest.mark.parametrize(
    ("carried", "met", "counted"),
    [
        ([0.0, 12.0, 0.0], [0.0, 12.0, 40.0], [0.0, 12.0, 0.0]),  # a box between the hands, set down on a table
        ([15.0, 0.0, 0.0], [80.0, 0.0, 0.0], [15.0, 0.0, 0.0]),  # a post that pushes back harder
        ([15.0, 0.0, 0.0], [-40.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
    ],
)
def test_a_stand_counts_no_more_than_what_has_made_the_robot_step(standing_state, carried, met, counted):
    """Before, the felt force of a carried box let the push of the table count: the robot leant back, and ran."""
    load = HandLoad(10.0, 5.0)
    after(load, felt(standing_state, carried), 2.0, stepping=True)
    assert after(load, felt(standing_state, met), 2.0, stepping=False)[0] == pytest.approx(np.array(counted), abs=0.5)


def test_a_short_blow_does_not_count_in_full(load, standing_state):
    after(load, felt(standing_state, [15.0, 0.0, 0.0]), 2.0, stepping=True)
    assert after(load, felt(standing_state, [150.0, 0.0, 0.0]), 0.1, stepping=True)[0, 0] < 60.0


def test_without_an_estimate_what_is_told_counts(load, standing_state):
    told = dataclasses.replace(ARMS, wrench=HandWrench.of(right=(-15.0, 0.0, 0.0), payload=(3.0, 0.0)))
    state = dataclasses.replace(standing_state, hand_force=None)
    force = after(load, state, 4.0, stepping=False, targets=told)
    assert force == pytest.approx(np.array([[0.0, 0.0, -29.43], [-15.0, 0.0, 0.0]]), abs=0.05)
    assert told.wrench.force.tolist() == [[0.0, 0.0, 0.0], [-15.0, 0.0, 0.0]], "the targets are the caller's"


def test_what_is_told_counts_in_full_and_what_is_felt_besides_up_to_a_bound(load, standing_state):
    """The arms give the torques of the heaviest payload and the strongest force too, which was cut at 250 N here."""
    told = dataclasses.replace(ARMS, wrench=HandWrench.of(left=(0.0, 0.0, -200.0), payload=(20.0, 0.0)))
    for felt_z, counted in ((-396.2, -396.2), (-1e4, -646.2)):
        force = after(load, felt(standing_state, [0.0, 0.0, felt_z]), 4.0, stepping=True, targets=told)
        assert force[0] == pytest.approx(np.array([0.0, 0.0, counted]), abs=0.5)


def test_what_is_told_and_felt_counts_once(load, standing_state):
    told = dataclasses.replace(ARMS, wrench=HandWrench.of(left=(40.0, 0.0, 0.0)))
    force = after(load, felt(standing_state, [40.0, 0.0, 0.0]), 4.0, stepping=True, targets=told)
    assert force == pytest.approx(np.array([[40.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), abs=0.05)


def test_the_bias_has_the_forces_on_the_hands(standing_state):
    free, loaded = Dynamics(load_robot()), Dynamics(load_robot())
    loaded.hand_force = PULL
    free.update(standing_state)
    loaded.update(standing_state)
    jacobians = [free.frame(f"{side}_hand").jacobian[:3] for side in ("left", "right")]
    assert free.bias - loaded.bias == pytest.approx(
        sum(j.T @ f for j, f in zip(jacobians, PULL, strict=True)), abs=1e-9
    )


def test_the_balance_shifts_by_the_moment_over_the_weight(standing_state):
    dynamics, pivot = Dynamics(load_robot()), np.array([0.05, 0.0, 0.0])
    dynamics.update(standing_state)
    assert dynamics.hand_shift(pivot).tolist() == [0.0, 0.0]
    plain = Pendulum.about(pivot, dynamics)
    dynamics.hand_force = PULL
    arms = [dynamics.position(f"{side}_hand") - pivot for side in ("left", "right")]
    moment = sum(np.cross(arm, force) for arm, force in zip(arms, PULL, strict=True))
    expected = np.array([moment[1], -moment[0]]) / (dynamics.mass * 9.81)
    assert dynamics.hand_shift(pivot) == pytest.approx(expected, abs=1e-9)
    shifted = Pendulum.about(pivot, dynamics)
    assert shifted.dcm - plain.dcm == pytest.approx(expected, abs=1e-9)
    dynamics.hand_force = 1e4 * PULL
    assert np.abs(dynamics.hand_shift(pivot)).max() <= 0.25


def test_forces_that_the_arms_cannot_hold_do_not_cost_the_balance(standing_state):
    controller = WholeBodyController(load_robot())
    controller.reset(standing_state)
    targets = dataclasses.replace(
        UpperBody.targets(standing_state.q[controller.robot.arms]),
        wrench=HandWrench(np.tile((0.0, 150.0, 0.0), (2, 1))),
    )
    for _ in range(300):
        controller.act(standing_state, Command(), targets)
    diagnostics = controller.diagnostics
    assert diagnostics.status is QpStatus.SOLVED
    limit = controller._params.torque_fraction * controller.robot.torque_limit
    assert controller.planned_acceleration is not None
    held = controller.dynamics
    columns = held.columns[controller.robot.arms]
    torque = (
        held.M[np.ix_(columns, columns)] @ controller.planned_acceleration[controller.robot.arms] + held.bias[columns]
    )
    assert np.all(np.abs(torque) <= 1.1 * limit[controller.robot.arms])


@pytest.mark.slow
@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0)])
def test_a_stand_holds_a_steady_force_on_its_hands(direction):
    """60 N for 3 s on what the estimator and the sensors of a robot tell; the robot may step, but must not go along."""
    simulation = Simulation(seed=2)
    loop = ControlLoop(WholeBodyController(load_robot()), Constant(Command()), simulation, None)
    loop.reset()
    pull = HandPull(simulation, 60.0 * np.array(direction), 1.0, 1.0)
    while simulation.time < 5.0 and not simulation.fallen:
        command = loop.decide(simulation.time)
        loop.step(command, loop.period)
        pull.update(simulation.state())
    assert not simulation.fallen
    assert np.linalg.norm(simulation.state().position[:2]) < 1.2
