"""The force plan: against momentum balances worked out by hand, and its limits."""

import dataclasses

import numpy as np
import pytest

from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.rigid_body_mpc import RigidBody, RigidBodyMpc, Stance, TakeOff

PARAMS = ControllerParams()
MASS, GRAVITY = 50.0, 9.81
ANKLE = 40.0


def _body(**changes):
    body = RigidBody(
        mass=MASS,
        inertia=np.diag([4.0, 3.0, 1.0]),
        coupling=np.zeros((3, 3)),
        frozen_inertia=np.diag([6.0, 5.0, 1.2]),
        com=np.array([0.0, 0.0, 0.9]),
        velocity=np.zeros(3),
        tilt=np.zeros(3),
        momentum=np.zeros(3),
    )
    return dataclasses.replace(body, **changes)


def _stance(time_left):
    """Both feet 0.36 m apart, with the ankle 0.07 m above the ground, a third of the way from heel to toe."""
    points = [[x, y, 0.0] for y in (0.18, -0.18) for x in (-0.1, 0.2)]
    return Stance(
        points=np.array(points),
        ankles=np.array([[0.0, 0.18, 0.07], [0.0, -0.18, 0.07]]),
        lateral=np.array([[0.0, 1.0, 0.0]] * 2),
        time_left=time_left,
    )


def _take_off(velocity=(0.0, 0.0, 1.2), height=0.9, flight=0.25):
    return TakeOff(height, np.array(velocity), np.zeros(3), flight)


def _push_off(body, stance, target):
    """The body at take-off, with forces planned again every 10 ms from the exact motion."""
    mpc, dt, left, age = RigidBodyMpc(PARAMS, len(stance.points), ANKLE), 0.0005, stance.time_left, np.inf
    while left > 1e-6:
        if age > 0.01 - 1e-6 and left > PARAMS.mpc_shortest_stance:
            plan, age = mpc.solve(body, dataclasses.replace(stance, time_left=left), target), 0.0
            assert plan.solved
        forces = plan.at(age)
        acceleration = forces.sum(axis=0) / body.mass - [0.0, 0.0, GRAVITY]
        spin = np.linalg.solve(body.inertia, body.momentum - body.coupling @ body.velocity)
        body = dataclasses.replace(
            body,
            com=body.com + body.velocity * dt + 0.5 * acceleration * dt**2,
            velocity=body.velocity + acceleration * dt,
            tilt=body.tilt + spin * dt,
            momentum=body.momentum + np.cross(stance.points - body.com, forces).sum(axis=0) * dt,
        )
        left, age = left - dt, age + dt
    return body


def _solve(body, stance, target):
    return RigidBodyMpc(PARAMS, len(stance.points), ANKLE).solve(body, stance, target)


def test_a_landing_body_is_thrown_up_again_by_a_push_of_twice_its_weight():
    body, stance = _body(velocity=np.array([0.0, 0.0, -1.22625])), _stance(0.25)
    plan = _solve(body, stance, _take_off((0.0, 0.0, 1.22625)))
    assert plan.solved
    # 2 * 1.22625 m/s in 0.25 s is g: an even push of 2 m g ends at the height and the speed asked for.
    assert plan.forces[:, :, 2].sum(axis=1) == pytest.approx(np.full(6, 2.0 * MASS * GRAVITY), rel=0.01)
    thrown = _push_off(body, stance, _take_off((0.0, 0.0, 1.22625)))
    assert thrown.com[2] == pytest.approx(0.9, abs=0.002)
    assert thrown.velocity == pytest.approx([0.0, 0.0, 1.22625], abs=0.02)
    assert thrown.momentum == pytest.approx(np.zeros(3), abs=0.3)


@pytest.mark.parametrize("sideways", [-0.3, 0.3])
def test_it_brings_the_horizontal_velocity_towards_the_wanted(sideways):
    body, stance = _body(velocity=np.array([0.0, 0.0, -1.2])), _stance(0.25)
    thrown = _push_off(body, stance, _take_off((0.2, sideways, 1.2)))
    assert thrown.velocity[:2] == pytest.approx([0.2, sideways], abs=0.1)


def test_a_body_that_tumbles_is_stopped():
    body, stance = _body(velocity=np.array([0.0, 0.0, -1.2]), momentum=np.array([2.0, 3.0, 0.5])), _stance(0.25)
    assert np.abs(_push_off(body, stance, _take_off()).momentum).max() < 1.0


def test_legs_that_are_to_swing_forward_get_their_momentum_from_the_ground():
    coupling = np.zeros((3, 3))
    coupling[1, 0] = 3.0
    body, stance = _body(velocity=np.array([0.6, 0.0, -1.2]), coupling=coupling), _stance(0.25)
    thrown = _push_off(body, stance, _take_off((0.6, 0.0, 1.2)))
    assert thrown.velocity[0] == pytest.approx(0.6, abs=0.1)
    # In flight the feet overtake the body as fast as it overtook them: the legs take -K v = -1.8 of the momentum.
    landing = thrown.tilt[1] + 0.25 * (thrown.momentum[1] + 3.0 * thrown.velocity[0]) / 3.0
    assert thrown.momentum[1] < -1.0
    assert landing == pytest.approx(0.0, abs=0.1)


def test_forces_stay_in_their_cones_and_ankles_within_their_torque():
    rng = np.random.default_rng(0)
    mpc, solved = RigidBodyMpc(PARAMS, 4, ANKLE), 0
    for _ in range(100):
        body = _body(
            com=np.array([*rng.uniform(-0.2, 0.2, 2), 0.9]),
            velocity=rng.uniform(-1.5, 1.5, 3),
            tilt=rng.uniform(-0.3, 0.3, 3),
            momentum=rng.uniform(-8.0, 8.0, 3),
        )
        stance = _stance(rng.uniform(0.01, 0.6))
        plan = mpc.solve(body, stance, _take_off(flight=rng.uniform(0.14, 0.33)))
        solved += plan.solved
        forces = plan.forces
        slope = PARAMS.friction / np.sqrt(2.0)
        assert np.all(forces[..., 2] >= -0.5)
        assert np.all(np.abs(forces[..., :2]) <= slope * forces[..., 2:] + 0.5)
        arms = stance.points - np.repeat(stance.ankles, 2, axis=0)
        torque = np.cross(arms, forces)[..., 1].reshape(-1, 2, 2).sum(axis=2)
        assert np.all(np.abs(torque) <= PARAMS.torque_fraction * ANKLE + 0.5)
    assert solved >= 99


def test_the_plan_is_mirrored_with_the_state():
    flip = np.array([1.0, -1.0, 1.0])
    state = {"velocity": np.array([0.3, 0.2, -1.0]), "momentum": np.array([1.0, -0.5, 0.4]),
             "tilt": np.array([0.05, 0.1, -0.1])}  # fmt: skip
    mirrored = {"velocity": state["velocity"] * flip, "momentum": -state["momentum"] * flip,
                "tilt": -state["tilt"] * flip}  # fmt: skip
    one = _solve(_body(**state), _stance(0.2), _take_off((0.4, 0.1, 1.2))).forces
    other = _solve(_body(**mirrored), _stance(0.2), _take_off((0.4, -0.1, 1.2))).forces
    assert other == pytest.approx((one * flip)[:, [2, 3, 0, 1]], abs=0.5)


def test_a_broken_body_gets_an_even_push_and_the_next_one_a_plan():
    mpc, stance = RigidBodyMpc(PARAMS, 4, ANKLE), _stance(0.25)
    for broken in ({"inertia": np.zeros((3, 3))}, {"velocity": np.full(3, np.nan)}):
        plan = mpc.solve(_body(**broken), stance, _take_off())
        assert not plan.solved
        assert plan.forces[0] == pytest.approx(np.tile([0.0, 0.0, MASS * GRAVITY / 4.0], (4, 1)))
    assert mpc.solve(_body(), stance, _take_off()).solved
