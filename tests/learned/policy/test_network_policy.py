import dataclasses

import numpy as np
import pytest
import torch

from hugwbc import Command, Controller, Gait, UpperBody, load_robot
from hugwbc.arm_servo import ArmServo
from hugwbc.errors import ConfigError, PolicyFileError
from hugwbc.learned.policy import load_policy
from hugwbc.learned.policy.contract import History, Term, load_contract
from hugwbc.learned.policy.network_policy import NetworkPolicy, load_contract_policy
from hugwbc.mbc import WholeBodyController
from hugwbc.runtime import Constant, HoldController, rollout
from hugwbc.runtime.guard import Guard
from hugwbc.runtime.safety import SafetyFilter, StateCheck
from hugwbc.runtime.safety_report import SafetyLog
from hugwbc.sim import Simulation
from tests.conftest import ByHand

ROBOT = load_robot()
WALK = Command(v_x=0.5, gait=Gait.WALKING)


@pytest.fixture
def unitree(leg_lstm_file):
    return load_contract_policy("unitree-h1", leg_lstm_file)


def test_a_recurrent_leg_policy_runs_as_its_maker_runs_it(unitree, leg_lstm, state):
    """Two ticks against the maker's loop, written out: observation, network with memory, target = default + 0.25 a."""
    assert isinstance(unitree, Controller) and (unitree.name, unitree.period) == ("unitree-h1", 0.02)
    default = np.array([0, 0, -0.1, 0.3, -0.2] * 2)
    legs, action = ROBOT.legs, np.zeros(10)
    for _ in range(2):
        unitree.reset(state)
        leg_lstm.reset_memory()
        action = np.zeros(10)
        for tick in (1, 2):
            angle = 2 * np.pi * tick * 0.02 / 0.8
            parts = (0.25 * state.angular_velocity, state.projected_gravity, [1.0, 0.0, 0.0])
            joints = (state.q[legs] - default, 0.05 * state.dq[legs], action, [np.sin(angle), np.cos(angle)])
            row = torch.as_tensor(np.concatenate((*parts, *joints)), dtype=torch.float32)[None]
            with torch.no_grad():
                action = leg_lstm(row)[0].numpy()
            command = unitree.act(state, WALK, UpperBody.none())
            np.testing.assert_allclose(command.q[legs], default + 0.25 * action, atol=1e-6)
    others = np.setdiff1d(np.arange(19), legs)
    np.testing.assert_array_equal(command.q[others], ROBOT.nominal[others])
    np.testing.assert_array_equal(command.kp[others], ROBOT.kp[others])
    np.testing.assert_array_equal(command.kp[legs], [150, 150, 150, 200, 40] * 2)
    np.testing.assert_array_equal(command.kd[legs], [2, 2, 2, 4, 2] * 2)


@pytest.mark.parametrize("robot", ["h1", "h1-2023"])
def test_it_walks_through_a_rollout_with_arms_taken_over(unitree, state, robot):
    trace = rollout(unitree, Constant(WALK), Simulation(sensing="exact", robot=load_robot(robot)), duration=0.5)
    assert trace.robot == robot
    assert trace.safety.failures == 0 and trace.safety.bad_outputs == 0 and trace.name == "unitree-h1"
    arms = UpperBody.targets(np.full(8, 0.3))
    np.testing.assert_array_equal(unitree.act(state, WALK, arms).q[ROBOT.arms], 0.3)


def test_it_is_refused_on_a_robot_with_other_joints(unitree):
    with pytest.raises(ConfigError, match="unitree-h1 controls the robot h1, which has other joints than g1"):
        rollout(unitree, Constant(WALK), Simulation(sensing="exact", robot="g1"), duration=0.5)


def test_external_arms_are_driven_as_those_of_every_other_controller(unitree, state):
    """All five vectors of the arms' command, once the takeover has faded."""
    state = dataclasses.replace(state, position=np.array([0.0, 0.0, 0.98]), velocity=np.zeros(3))
    arms = UpperBody.targets([-0.4, 0.2, 0.1, 0.3, -0.5, -0.2, -0.1, 0.4], tau=np.full(8, 0.5))
    commands = []
    for controller in (unitree, HoldController(load_robot()), WholeBodyController(load_robot(), period=unitree.period)):
        period = ByHand(controller)
        period.start(state)
        for _ in range(30):
            command = period.act(state, Command(), arms)
        commands.append(command)
    servo = ArmServo(robot=ROBOT)
    expected = servo(arms, state, unitree.period)
    for command in commands:
        for name in ("q", "dq", "kp", "kd", "tau"):
            np.testing.assert_allclose(getattr(command, name)[ROBOT.arms], getattr(expected, name), atol=1e-12)


class _Fixed:
    """A network that gives prepared actions."""

    def __init__(self, *actions):
        self.actions, self.given, self.resets = list(actions), [], 0

    def reset(self):
        self.resets += 1

    def __call__(self, inputs):
        (observation,) = inputs
        self.given.append(observation)
        return self.actions[len(self.given) - 1]


def test_numbers_that_are_not_finite_are_left_to_the_guard_and_the_memory_is_cleared(state):
    """One bad number in a recurrent state would come back in all that follow; the guard counts it in its report."""
    contract = dataclasses.replace(load_contract("unitree-h1"), action_clip=2.0)
    network = _Fixed(np.full(10, 5.0), np.full(10, np.nan), np.zeros(10))
    policy = NetworkPolicy(contract, network)
    policy.reset(state)
    before, targets, resets = network.resets, [], []
    log = SafetyLog()
    guard = Guard(policy, StateCheck(ROBOT), SafetyFilter(ROBOT, log), log)
    guard._begun = True
    for _ in range(3):
        targets.append(guard.act(state, WALK, UpperBody.none()).q[ROBOT.legs])
        resets.append(network.resets - before)
    np.testing.assert_allclose(targets[0], np.array(contract.default_pose) + 0.25 * 2.0)
    np.testing.assert_array_equal(targets[1], targets[0])
    assert log.report().bad_outputs == log.report().held == 1 and resets == [0, 1, 1]
    assert "unitree-h1 gave a joint command in which q are not 19 finite numbers" in log.report().messages[0]
    np.testing.assert_array_equal(network.given[2][29:39], 2.0)  # the last action that was used


def test_the_clock_may_follow_the_commanded_frequency_and_held_joints_have_a_pose(state):
    contract = dataclasses.replace(load_contract("unitree-h1"), clock_period=None, held_pose={"left_elbow_joint": 0.7})
    network = _Fixed(np.zeros(10))
    policy = NetworkPolicy(contract, network)
    q = policy.act(state, dataclasses.replace(WALK, f=2.5), UpperBody.none()).q
    angle = 2 * np.pi * 2.5 * 0.02
    np.testing.assert_allclose(network.given[0][-2:], [np.sin(angle), np.cos(angle)], atol=1e-6)
    assert q[ROBOT.index("left_elbow_joint")] == 0.7


def test_a_network_that_does_not_fit_its_contract_is_refused(tmp_path, leg_lstm_file, counting_onnx):
    with pytest.raises(PolicyFileError, match="give one with --policy FILE"):
        load_contract_policy("unitree-h1")
    text = (tmp_path / "contract.yaml").write_text
    head = "policy: {}\nperiod: 0.02\njoints: [{}]\ndefault_pose: 0\nkp: 1\nkd: 1\naction_scale: 1\n"
    text(head.format(leg_lstm_file, "torso_joint") + "observation: [gravity]")
    with pytest.raises(PolicyFileError, match=r"does not take the contract's observation, 1 x \(gravity 3\) = 3 num"):
        load_contract_policy(tmp_path)
    text(head.format(counting_onnx, "torso_joint") + "state: {memory: next}\nobservation: [gravity]")
    with pytest.raises(PolicyFileError, match=r"gives 2 actions \(2 finite\), the contract has 1 joints: torso_joint"):
        load_contract_policy(tmp_path)


def seen(contract, states, command=Command()):  # noqa: B008  it is frozen
    """Return what the network of a contract reads at each of some states."""
    network = _Fixed(*[np.zeros(len(contract.joints))] * len(states))
    policy = NetworkPolicy(contract, network)
    policy.reset(states[0])
    for one in states:
        policy.act(one, command, UpperBody.none())
    return network.given


def test_terms_that_unitrees_policy_does_not_have(state):
    terms = (
        Term("linear_velocity", scale=2.0),
        Term("absolute_joint_position", joints=("left_knee_joint",)),
        Term("constant", scale=(1.0, 3.0), value=(7.0, 9.0)),
        Term("phase_cos", offset=0.5),
    )
    contract = dataclasses.replace(load_contract("unitree-h1"), observation=terms, observation_clip=8.0)
    angle = 2 * np.pi * (0.02 / 0.8 + 0.5)
    (still,) = seen(contract, [state])
    np.testing.assert_allclose(still, [0, 0, 0, 0.9, 7, 8, np.cos(angle)], atol=1e-6)
    (moving,) = seen(contract, [dataclasses.replace(state, velocity=np.array([1.0, 0.5, 0.0]))])
    # Pitched forward by 0.2 rad, the pelvis' own x axis points down a little.
    np.testing.assert_allclose(moving[:3], [2 * np.cos(0.2), 1.0, 2 * np.sin(0.2)], atol=1e-6)


@pytest.mark.parametrize(
    ("order", "layout", "start", "expected"),
    [
        ("oldest_first", "by_frame", "first_frame", [1, 2, 3, 1, 2, 3, 4, 2, 3]),
        ("newest_first", "by_frame", "first_frame", [4, 2, 3, 1, 2, 3, 1, 2, 3]),
        ("oldest_first", "by_term", "zeros", [0, 1, 4, 0, 2, 2, 0, 3, 3]),
    ],
)
def test_history_in_every_order(state, order, layout, start, expected):
    knee, constants = Term("absolute_joint_position", joints=("left_knee_joint",)), (2.0, 3.0)
    terms = (knee, *(Term("constant", value=(value,)) for value in constants))
    history = History(3, order, layout, start)
    contract = dataclasses.replace(load_contract("unitree-h1"), observation=terms, history=history)
    bent = [dataclasses.replace(state, q=np.full(19, angle)) for angle in (1.0, 4.0)]
    np.testing.assert_array_equal(seen(contract, bent)[-1], expected)


def test_a_reset_in_a_squat_does_not_ask_for_a_stand_at_once():
    """As after a moment of states that could not be used."""
    policy, simulation = load_policy("h1"), Simulation(sensing="exact")
    squat = Command(h=-0.25, p=0.2, w=0.3)
    rollout(policy, squat, simulation, duration=3.0)
    state, knee = simulation.state(), ROBOT.index("left_knee_joint")
    before = policy.act(state, squat, UpperBody.none()).q[knee]
    policy.reset(state)
    after = policy.act(state, squat, UpperBody.none()).q[knee]
    assert before > 1.2 and after == pytest.approx(before, abs=0.3)
    # Without a rate the waist's target never follows the command: an offset would stay for good.
    still = NetworkPolicy(dataclasses.replace(policy.contract, waist_rate=0.0), policy._network)
    still.reset(state)
    assert state.q[ROBOT.waist] == pytest.approx(0.3, abs=0.05) and still._waist[0] == 0.0
