import pathlib
import subprocess
import sys

import numpy as np
import pytest
import torch

from hugwbc.commands import Command
from hugwbc.controller import Controller, UpperBody
from hugwbc.errors import PolicyFileError, UnknownNameError
from hugwbc.gait import Gait
from hugwbc.learned.config import EnvConfig, RandomizationConfig
from hugwbc.learned.env.humanoid_env import HumanoidEnv
from hugwbc.learned.policy import LearnedController, checkpoint, load_policy, save_policy
from hugwbc.learned.policy.leg_feed_forward import HEIGHT_RATE, PITCH_RATE, LegFeedForward, swing_clearance
from hugwbc.learned.policy.networks import Actor
from hugwbc.learned.policy.terms import COMMAND, FRAME, size_of
from hugwbc.robot import Robot, load_robot
from hugwbc.state import RobotState
from tests.conftest import make_state

ROBOT = load_robot()


def random_actor(robot: Robot = ROBOT) -> Actor:
    torch.manual_seed(0)
    return Actor(size_of(FRAME, robot), size_of(COMMAND, robot), len(robot.joint_names)).eval()


@pytest.fixture
def policy_file(tmp_path: pathlib.Path) -> pathlib.Path:
    path = tmp_path / "policy.safetensors"
    training = {"steps": 7, "config": {"env": {"intervention": "motion"}}}
    save_policy(path, random_actor(), EnvConfig().contract(), training)
    return path


def test_is_a_controller(policy_file: pathlib.Path) -> None:
    controller = load_policy(policy_file)
    assert isinstance(controller, Controller)
    controller.reset(make_state())
    command = controller.act(make_state(), Command(), UpperBody.none())
    np.testing.assert_array_equal(command.kp, ROBOT.kp)
    assert command.is_finite


@pytest.mark.parametrize(
    "changes",
    [{}, {"action_scale": 0.5, "waist_rate": 1.0, "substeps": 2, "squat_gain": 0.7, "swing_gain": 0.8}],
    ids=["defaults", "other settings"],
)
@pytest.mark.parametrize(
    ("name", "gait", "taken"),
    [
        ("h1", Gait.WALKING, False),
        ("g1", Gait.WALKING, False),
        ("h1", Gait.HOPPING_RIGHT, False),
        ("g1", Gait.WALKING, True),
    ],
    ids=["h1", "g1", "h1 hopping", "g1 with its arms taken over"],
)
def test_controller_does_what_the_training_environment_does(
    name: str, gait: Gait, taken: bool, changes: dict, tmp_path: pathlib.Path
) -> None:
    """The same network in the environment and behind the controller gives the same targets along a trajectory."""
    robot = load_robot(name)
    settings = EnvConfig(count=1, robot=name, randomization=RandomizationConfig.off(), flip_probability=0.0, **changes)
    env = HumanoidEnv(settings, seed=2, threads=1)
    env.age[:] = 0
    env.gait[:] = int(gait)
    env.command[0] = torch.tensor([0.3, -0.1, 0.2, 2.0, 0.15, -0.1, 0.1, 0.3])
    env.intervention.active[:] = taken
    env.curriculum.alpha = 1.0
    actor = random_actor(robot)
    save_policy(tmp_path / "policy.safetensors", actor, settings.contract(), {})
    controller = load_policy(tmp_path)
    assert controller.period == 0.005 * settings.substeps
    command = Command.from_array(env.command[0].double().numpy(), gait)
    env.phase[:] = 2.0 * controller.period  # where the controller's clock is in its first period, after 0

    def state() -> RobotState:
        qpos, qvel = env.simulation.qpos[0].numpy().copy(), env.simulation.qvel[0].numpy().copy()
        return RobotState(q=qpos[7:], dq=qvel[6:], orientation=qpos[3:7], angular_velocity=qvel[3:6])

    controller.reset(state())
    waist, posture, legs = 0.0, np.zeros(2), LegFeedForward(robot)
    others = np.setdiff1d(np.arange(len(robot.joint_names)), robot.arms if taken else [])
    for _ in range(12):
        arms = env.intervention.source.targets()[0].double().numpy()
        joint_command = controller.act(state(), command, UpperBody.targets(arms) if taken else UpperBody.none())
        observation = env.observe()
        with torch.no_grad():
            action, _ = actor(observation.history, observation.command)
        expected = robot.nominal + settings.action_scales(robot) * action[0].double().numpy()
        waist = min(waist + settings.waist_rate * controller.period, 0.3)
        expected[robot.waist] += waist
        reach = controller.period * np.array([HEIGHT_RATE, PITCH_RATE])
        posture = np.clip([-0.1, 0.1], posture - reach, posture + reach)
        lifted = swing_clearance(env.phase.numpy(), env.gait.numpy(), env.command.numpy(), controller.period)
        expected += legs.offsets(*(settings.squat_gain * posture[:, None]), settings.swing_gain * lifted)[0]
        np.testing.assert_allclose(joint_command.q[others], expected[others], atol=2e-5)
        np.testing.assert_allclose(joint_command.kd, settings.damping(robot))
        env.step(action)
        np.testing.assert_allclose(env.simulation.ctrl[0, others], expected[others], atol=2e-5)
        if taken:  # the environment moves the targets on within its step
            np.testing.assert_array_equal(joint_command.q[robot.arms], arms)


def test_external_arms_are_passed_on_and_seen() -> None:
    controller = LearnedController(random_actor(), EnvConfig().contract())
    targets = np.linspace(-0.2, 0.2, 8)
    controller.reset(make_state())
    own = controller.act(make_state(), Command(), UpperBody.none())
    controller.reset(make_state())
    taken = controller.act(make_state(), Command(), UpperBody.targets(targets))
    np.testing.assert_array_equal(taken.q[ROBOT.arms], targets)
    assert not np.allclose(taken.q[ROBOT.legs], own.q[ROBOT.legs]), "the indicator must reach the network"


def test_unknown_policy_lists_the_shipped_ones() -> None:
    for name in ("n" * 5000, "no_such_policy"):
        with pytest.raises(UnknownNameError, match="h1"):
            load_policy(name)


NAN = float("nan")
BIAS = "policy.6.bias"


@pytest.mark.parametrize(
    ("tensors", "entries", "message"),
    [
        ({}, {"joints": ["a", "b"]}, "unknown joint 'a'"),
        ({"encoder.0.weight": lambda _: torch.zeros(3)}, {}, "does not fit"),
        ({BIAS: lambda old: old + 0.01}, {}, r"self-test: joint targets differ by up to 0\.00\d+ rad"),
        ({BIAS: lambda old: old * NAN}, {}, "weights that are not finite"),
        ({}, {"action_scale": [0.25] * 18 + [0.3]}, "self-test"),
        ({}, {"period": 0.01}, "self-test"),
        ({}, {"waist_rate": 1.0}, "self-test"),
        ({"self_test.target": lambda old: old * NAN}, {}, "self-test"),
    ],
)
def test_a_policy_that_was_changed_is_refused(policy_file: pathlib.Path, tensors, entries, message) -> None:
    old, metadata = checkpoint.load_file(policy_file, "policy")
    metadata["contract"] |= entries
    changed = {name: change(old[name]) for name, change in tensors.items()}
    checkpoint.save_file(policy_file, old | changed, "policy", metadata)
    with pytest.raises(PolicyFileError, match=message):
        load_policy(policy_file)


def test_a_missing_self_test_is_refused(policy_file: pathlib.Path) -> None:
    _, metadata = checkpoint.load_file(policy_file, "policy")
    checkpoint.save_file(policy_file, random_actor().state_dict(), "policy", metadata)
    with pytest.raises(PolicyFileError, match="lacks a readable self-test"):
        load_policy(policy_file)


def test_loading_needs_no_training_code(policy_file: pathlib.Path) -> None:
    script = (
        "import sys; from hugwbc.learned.policy import load_policy; load_policy(sys.argv[1]);"
        "print([n for n in ('mujoco', *('hugwbc.learned.' + m for m in ('env', 'rl', 'recipe', 'config')))"
        " if n in sys.modules])"
    )
    result = subprocess.run([sys.executable, "-c", script, policy_file], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"
