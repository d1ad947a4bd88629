import dataclasses

import numpy as np
import pytest

from hugwbc import Command, Gait, load_robot
from hugwbc.runtime.foreign.contract import History, Term
from hugwbc.runtime.foreign.contract_file import load_contract
from hugwbc.runtime.foreign.observation import ObservationHistory, Reading, observe

ROBOT = load_robot()


def test_the_41_observations_of_unitrees_policy(state):
    """Against the layout by hand: legs only, relative to their default pose, scaled."""
    contract = load_contract("unitree-h1")
    reference = ROBOT.nominal.copy()
    reference[ROBOT.legs] = contract.default_pose
    command = Command(v_x=0.5, v_y=-0.2, omega=0.4, gait=Gait.WALKING)
    seen = observe(contract, Reading(state, command, np.arange(10.0), 0.25, reference))
    legs_q = [0, 0.02, -0.3, 0.5 + 0.1, -0.2, 0, -0.02, -0.3, 0.5, -0.2]  # nominal minus default, knee bent
    legs_dq = [0, 0, 0, 0, 0, 0, 0, 0, 0, 0.1]
    expected = [0.1, -0.2, 0.3, np.sin(0.2), 0.0, -np.cos(0.2), 1.0, -0.4, 0.1, *legs_q, *legs_dq, *range(10), 1.0, 0.0]
    np.testing.assert_allclose(seen, expected, atol=1e-12)


def test_terms_that_unitrees_policy_does_not_have(state):
    terms = (
        Term("linear_velocity", 3, (2.0, 2.0, 2.0)),
        Term("joint_position", 1, (1.0,), ("left_knee_joint",), absolute=True),
        Term("constant", 2, (1.0, 3.0), value=(7.0, 9.0)),
        Term("phase_cos", 1, (1.0,), offset=0.5),
    )
    contract = dataclasses.replace(load_contract("unitree-h1"), observation=terms, observation_clip=8.0)
    reading = Reading(state, Command(), np.zeros(10), 0.0, ROBOT.nominal)
    np.testing.assert_allclose(observe(contract, reading), [0, 0, 0, 0.9, 7, 8, -1], atol=1e-12)
    moving = dataclasses.replace(state, velocity=np.array([1.0, 0.5, 0.0]))
    velocity = observe(contract, dataclasses.replace(reading, state=moving))[:3]
    # Pitched forward by 0.2 rad, the pelvis' own x axis points down a little.
    np.testing.assert_allclose(velocity, [2 * np.cos(0.2), 1.0, 2 * np.sin(0.2)], atol=1e-12)


@pytest.mark.parametrize(
    ("order", "layout", "start", "expected"),
    [
        ("oldest_first", "by_frame", "first_frame", [1, 2, 3, 1, 2, 3, 4, 5, 6]),
        ("newest_first", "by_frame", "first_frame", [4, 5, 6, 1, 2, 3, 1, 2, 3]),
        ("oldest_first", "by_term", "zeros", [0, 1, 4, 0, 0, 2, 3, 5, 6]),
    ],
)
def test_history_in_every_order(order, layout, start, expected):
    terms = (Term("phase_sin", 1, (1.0,)), Term("constant", 2, (1.0, 1.0), value=(0.0, 0.0)))
    contract = dataclasses.replace(
        load_contract("unitree-h1"), observation=terms, history=History(3, order, layout, start)
    )
    history = ObservationHistory(contract)
    for frame in ([9.0, 9.0, 9.0], [1.0, 2.0, 3.0], [4.0, 5.0, 6.0]):
        if frame[0] == 1.0:
            history.reset()
        history.push(np.array(frame))
    np.testing.assert_array_equal(history.input(), expected)
