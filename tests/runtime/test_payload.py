"""The learned payload: from the vertical force, slowly, beyond the friction; and where nothing is learned."""

import dataclasses

import numpy as np
import pytest

from hugwbc.controller import UpperBody
from hugwbc.robot import load_robot
from hugwbc.runtime.payload import BAND, HEAVIEST, PayloadObserver
from tests.conftest import make_state

DT = 0.02
BODY = UpperBody.targets(np.zeros(8))


def pulled(left, right=0.0):
    state = make_state(load_robot().nominal)
    return dataclasses.replace(state, hand_force=np.array([[0.0, 0.0, left], [3.0, 0.0, right]]))


def learn(observer, body, state, time=4.0):
    for _ in range(round(time / DT)):
        body_now = observer.complete(body, state, DT)
    return body_now


def test_a_weight_is_learned_up_to_the_friction():
    observer = PayloadObserver()
    first = observer.complete(BODY, pulled(-30.0), DT)
    assert first.payload is not None and 0.0 < first.payload[0] < 0.5, "not at once"
    body = learn(observer, BODY, pulled(-30.0))
    assert body.payload is not None
    assert body.payload[0] == pytest.approx((30.0 - BAND) / 9.81, abs=0.01)
    assert body.payload[1] == 0.0
    learn(observer, BODY, pulled(0.0))
    assert observer.payload[0] == pytest.approx(BAND / 9.81, abs=0.01)


def test_friction_and_upward_forces_are_no_payload_and_the_rest_is_bounded():
    observer = PayloadObserver()
    for force in (-1.4, 1.4, 25.0):
        assert learn(observer, BODY, pulled(force)) is BODY
    body = learn(observer, BODY, pulled(-500.0), 10.0)
    assert body.payload is not None and body.payload[0] == HEAVIEST


def test_a_wanted_force_is_no_payload():
    pressing = dataclasses.replace(BODY, hand_force=np.array([[0.0, 0.0, 20.0], [0.0, 0.0, 0.0]]))
    observer = PayloadObserver()
    assert learn(observer, pressing, pulled(-20.0)) is pressing
    down = dataclasses.replace(BODY, hand_force=np.array([[0.0, 0.0, -40.0], [0.0, 60.0, 0.0]]))
    body = learn(observer, down, pulled(0.0, -30.0))
    assert body.payload is not None and body.payload[0] == 0.0, "a hand that meets nothing would float"
    assert body.payload[1] == pytest.approx((30.0 - BAND) / 9.81, abs=0.01), "what both hands squeeze has a weight"


def test_a_told_payload_counts_and_a_soft_hand_gives_way():
    observer, told = PayloadObserver(), dataclasses.replace(BODY, payload=np.array([1.0, 2.0]))
    assert observer.complete(told, pulled(-40.0), DT) is told
    assert observer.payload.tolist() == [1.0, 2.0]
    soft = dataclasses.replace(BODY, stiffness=200.0)
    assert learn(observer, soft, pulled(-40.0)) is soft
    learn(observer, BODY, pulled(-40.0))
    assert observer.complete(UpperBody.none(), pulled(-40.0), DT).payload is None
    assert not observer.payload.any(), "released arms forget"


def test_without_forces_nothing_is_learned():
    state = make_state(load_robot().nominal)
    assert learn(PayloadObserver(), BODY, state) is BODY
