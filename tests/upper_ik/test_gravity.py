import dataclasses
import math

import numpy as np
import pytest

from hugwbc import load_robot, rotations
from hugwbc.controller import JointCommand
from hugwbc.upper_ik import ArmDamping, GravityCompensation

# Both arms forward, elbows slightly bent.
REACHING = np.array([-0.9, 0.2, 0.1, 0.6, -0.9, -0.2, -0.1, 0.6])


def test_torque_of_the_elbow_by_hand(nominal_state):
    # Nominal arms: forearms level, centre of mass 0.164862 m ahead of the elbow's axis, 0.745 kg (h1.yaml).
    torque = GravityCompensation(robot=load_robot("h1")).torque(np.zeros(8), nominal_state)
    assert torque[[3, 7]] == pytest.approx([-0.745 * 9.81 * 0.164862] * 2, rel=1e-6)
    # Shoulder roll: the arm hangs below its axis, offset sideways by the parts' centres of mass only.
    sideways = 0.852 * 0.00115 + 0.862 * 0.002767 + 0.745 * 0.000118
    assert torque[[1, 5]] == pytest.approx([9.81 * sideways, -9.81 * sideways], rel=1e-6)


def test_upside_down_the_torques_change_sign(nominal_state, make_state):
    gravity = GravityCompensation()
    turned = make_state(nominal_state.q, orientation=rotations.from_axis_angle(np.array([0.0, 1.0, 0.0]), math.pi))
    assert gravity.torque(REACHING, turned) == pytest.approx(-gravity.torque(REACHING, nominal_state), abs=1e-9)


def test_targets_stay_within_limits_and_bad_numbers_pass_through(robot, nominal_state, make_state):
    gravity = GravityCompensation()
    rng = np.random.default_rng(0)
    for q in rng.uniform(robot.lower[robot.arms], robot.upper[robot.arms], (200, 8)):
        targets = gravity(q, nominal_state)
        assert np.all(targets >= robot.lower[robot.arms])
        assert np.all(targets <= robot.upper[robot.arms])
    lost = make_state(nominal_state.q, orientation=[math.nan] * 4)
    assert gravity(REACHING, lost).tolist() == REACHING.tolist()


@pytest.mark.parametrize("pitch", [0.0, 0.3])
def test_soft_arms_rest_where_they_should(robot, hanging, pitch):
    gravity = GravityCompensation()
    sag = {}
    for compensated in (False, True):
        rig = hanging(pitch)
        q = robot.nominal.copy()
        q[robot.arms] = gravity(REACHING, rig.state) if compensated else REACHING
        state = rig.step(JointCommand.position(robot, q), 6.0)
        sag[compensated] = np.abs(state.q[robot.arms] - REACHING).max()
    print(
        f"pitch {pitch} rad: sag {sag[False]:.3f} rad without, {sag[True]:.4f} rad with compensation"
    )  # docs/upper_ik.md
    assert sag[False] > 0.1
    assert sag[True] < 0.005


def test_damping_is_worth_the_torque_it_says(robot, nominal_state):
    damping = ArmDamping()
    moving = dataclasses.replace(nominal_state, dq=np.where(np.isin(np.arange(19), robot.arms), 1.0, 0.0))
    offset = damping(np.zeros(8), moving)
    # A left shoulder at 1 rad/s: 2 N*m/(rad/s) in all, of which the joint itself has 0.5; at 20 N*m/rad.
    assert offset[0] == pytest.approx(-(2.0 - 0.5) / 20.0)
    assert offset[3] == pytest.approx(-(0.8 - 0.5) / 20.0)
    assert damping(np.ones(8), moving) == pytest.approx(np.zeros(8)), "a joint that moves as it should is let go"
    lost = dataclasses.replace(nominal_state, dq=np.full(19, math.nan))
    assert damping(np.zeros(8), lost).tolist() == [0.0] * 8
    assert np.abs(damping(np.full(8, 100.0), nominal_state)).max() == 0.5


def test_a_pushed_arm_comes_to_rest_sooner(robot, hanging):
    """Called at 50 Hz, as the learned controller is."""
    gravity, damping = GravityCompensation(), ArmDamping()
    left = {}
    for damped in (False, True):
        rig = hanging()
        rig.simulation.data.qvel[6 + robot.arms[:2]] = 3.0
        for _ in range(40):
            q = robot.nominal.copy()
            q[robot.arms] = gravity(REACHING, rig.state) + (damping(np.zeros(8), rig.state) if damped else 0.0)
            state = rig.step(JointCommand.position(robot, q), 0.02)
        left[damped] = np.abs(state.dq[robot.arms]).max()
    print(f"{left[False]:.3f} rad/s left without, {left[True]:.3f} with damping")
    assert left[True] < 0.3 * left[False]


def test_damped_arms_do_not_chatter(robot, hanging):
    gravity, damping, rig, speeds = GravityCompensation(), ArmDamping(), hanging(), []
    for _ in range(120):
        q = robot.nominal.copy()
        q[robot.arms] = gravity(np.zeros(8), rig.state) + damping(np.zeros(8), rig.state)
        speeds.append(np.abs(rig.step(JointCommand.position(robot, q), 0.02).dq[robot.arms]).max())
    assert max(speeds[-20:]) < 0.02
