"""Observation terms: ours, and those that a user's Python file adds."""

import dataclasses

import numpy as np
import pytest
import torch

from hugwbc import Command, Gait, UpperBody
from hugwbc.errors import ConfigError, PolicyFileError, UnknownNameError
from hugwbc.learned.config import EnvConfig, PPOConfig, RandomizationConfig
from hugwbc.learned.env import HumanoidEnv
from hugwbc.learned.policy import critic_observations as obs, load_policy
from hugwbc.learned.policy.networks import ActorCritic, load_into
from hugwbc.learned.policy.terms import (
    ACTION,
    COMMAND,
    COMMAND_TERMS,
    CRITIC_CORE,
    FRAME_TERMS,
    HISTORY,
    TERMS,
    ObservationTerm,
    _made_up,
    check_term,
    observe,
)
from hugwbc.learned.rl.ppo import PPO
from hugwbc.learned.rl.trainer import save_product
from hugwbc.robot import load_robot
from hugwbc.state import RobotState

ROBOT = load_robot()

TILT = ObservationTerm(about="gravity, sideways", size=1, signs=(-1.0,), read=lambda s: s.gravity[:, 1:2])
KNEES = ObservationTerm(
    about="knee angles of both sides",
    size=2,
    signs=(1.0,),
    sides=True,
    scale=2.0,
    noise=0.05,
    read=lambda s: s.q[:, [3, 8]],
)


@pytest.fixture
def both(monkeypatch):
    monkeypatch.setitem(TERMS, "tilt", TILT)
    monkeypatch.setitem(TERMS, "knees", KNEES)
    return EnvConfig(count=6, observations=("tilt", "knees"))


@pytest.mark.parametrize("name", [*FRAME_TERMS, *COMMAND_TERMS, "absolute_joint_position", "linear_velocity"])
@pytest.mark.parametrize("robot", ["h1", "g1"])
def test_our_terms_are_what_they_declare(name, robot):
    check_term(name, load_robot(robot))


def test_training_and_deployment_read_the_same():
    """A term takes tensors as it takes arrays; one of a user's gets arrays in training too."""
    arrays = _made_up(ROBOT)
    values = {field.name: getattr(arrays, field.name) for field in dataclasses.fields(arrays)}
    parts = {name: torch.tensor(value) for name, value in values.items()}
    terms = [*(term for term in TERMS.values() if term.tensors), KNEES]
    assert not KNEES.tensors and all(TERMS[name].tensors for name in (*FRAME_TERMS, *COMMAND_TERMS))
    seen = observe(terms, dataclasses.replace(arrays, **parts))
    assert isinstance(seen, torch.Tensor) and seen.dtype == torch.float32
    np.testing.assert_allclose(seen.numpy(), observe(terms, arrays), atol=1e-6)


def test_our_terms_have_the_errors_of_the_sensors_alone():
    calm = EnvConfig(count=6, observations=FRAME_TERMS, randomization=RandomizationConfig(sensing=(0.0, 0.0)))
    env = HumanoidEnv(calm, seed=1, threads=1)
    torch.testing.assert_close(env.observe().command[:, 18:], env.history[:, -1], atol=1e-5, rtol=0.0)


def test_a_clock_without_a_gait_has_no_mirror_image():
    with pytest.raises(ConfigError, match="'phase_sin' violates its mirror signs at 0"):
        check_term("phase_sin", ROBOT)


def test_names_are_refused(both):
    with pytest.raises(UnknownNameError, match=r"unknown observation term 'tlt'\. Did you mean 'tilt'"):
        EnvConfig(observations=("tlt",))
    with pytest.raises(ConfigError, match="give each once"):
        EnvConfig(observations=("tilt", "tilt"))


def test_actor_and_critic_see_the_terms_with_their_scales(both, monkeypatch):
    monkeypatch.setitem(TERMS, "knees", dataclasses.replace(KNEES, noise=0.0))
    calm = dataclasses.replace(both, randomization=RandomizationConfig(sensing=(0.0, 0.0)))
    env = HumanoidEnv(calm, seed=1, threads=1)
    env.step(0.5 * torch.randn(6, 19, generator=torch.Generator().manual_seed(0)))
    seen = env.observe()
    expected = torch.cat((env.readings.gravity[:, 1:2], 2.0 * env.readings.q[:, [3, 8]]), dim=1)
    assert seen.command.shape == (6, 21) and seen.critic.shape == (6, 125)
    torch.testing.assert_close(seen.command[:, 18:], expected, atol=1e-5, rtol=0.0)
    torch.testing.assert_close(seen.critic[:, 121:124], expected, atol=1e-5, rtol=0.0)


def test_the_noise_is_the_declared_one(both):
    only_terms = dataclasses.replace(both, count=500, randomization=RandomizationConfig(sensing=(0.0, 0.0)))
    env = HumanoidEnv(only_terms, seed=1, threads=1)
    first, second = env.observe().command[:, 18:], env.observe().command[:, 18:]
    assert torch.equal(first[:, 0], second[:, 0]), "the tilt declares none"
    apart = (first - second)[:, 1:].abs().max()
    assert 0.15 < apart <= 2 * 2.0 * 0.05, "the difference of two draws of half-width 0.05 at scale 2"


def test_the_networks_mirror_the_terms_as_declared():
    own = (TILT, KNEES)
    network = ActorCritic(ROBOT, further=own)
    mirror = obs.mirror((*COMMAND, *own), ROBOT)
    assert mirror.sign[18:].tolist() == [-1.0, 1.0, 1.0] and mirror.index[18:].tolist() == [18, 20, 19]
    history, command = torch.randn(4, 315), torch.randn(4, 21)
    critic = torch.randn(4, 121 + 3 + 1)
    image = torch.cat((obs.mirror((*CRITIC_CORE, *own), ROBOT)(critic[:, :124]), critic[:, 124:]), dim=1)
    torch.testing.assert_close(network.critic(image), network.critic(critic), atol=1e-5, rtol=1e-5)
    straight, _ = network.actor(history, command)
    mirrored, _ = network.actor(obs.mirror(HISTORY, ROBOT)(history), mirror(command))
    torch.testing.assert_close(mirrored, obs.mirror(ACTION, ROBOT)(straight), atol=1e-5, rtol=1e-5)
    plain = network.actor.plain()
    assert plain.command_size == 21
    torch.testing.assert_close(plain(history, command)[0], network.actor(history, command)[0], atol=1e-5, rtol=1e-4)


def test_ppo_learns_with_them(both):
    env = HumanoidEnv(both, seed=1, threads=1)
    learner = PPO(
        PPOConfig(horizon=2, minibatches=1, epochs=1), ROBOT, torch.Generator().manual_seed(0), further=env.further
    )
    first = learner.network.actor.plain().state_dict()["policy.0.weight"][:, -3:].clone()
    for t in range(2):
        learner.record(t, env.step(learner.act(t, env.observe(), env.gait)))
    assert learner.update(env.observe())["skipped"] == 0.0
    assert not torch.equal(first, learner.network.actor.plain().state_dict()["policy.0.weight"][:, -3:])


def test_a_term_is_not_asked_about_no_robot(monkeypatch):
    rows = ObservationTerm(about="tilt", size=1, signs=(-1.0,), read=lambda s: np.stack([[g[1]] for g in s.gravity]))
    monkeypatch.setitem(TERMS, "rows", rows)
    env = HumanoidEnv(EnvConfig(count=2, observations=("rows",)), seed=0, threads=1)
    result = env.step(torch.zeros(2, 19))
    assert not bool(result.done.any()) and result.final.command.shape == (0, 19)


def test_a_network_without_them_goes_on_as_the_same_function():
    old, new = ActorCritic(ROBOT), ActorCritic(ROBOT, further=(TILT, KNEES))
    load_into(new, old.state_dict())
    history, command, own = torch.randn(4, 315), torch.randn(4, 18), torch.randn(4, 3)
    core, ground = torch.randn(4, 121), torch.randn(4, 221)
    wide = torch.cat((command, own), dim=1)
    torch.testing.assert_close(new.actor(history, wide), old.actor(history, command), atol=1e-5, rtol=1e-5)
    found = new.critic(torch.cat((core, own, ground), dim=1))
    torch.testing.assert_close(found, old.critic(torch.cat((core, ground), dim=1)), atol=1e-5, rtol=1e-5)
    load_into(new, new.state_dict())


def test_a_policy_with_them_runs_where_they_are_known_and_nowhere_else(both, monkeypatch, tmp_path):
    torch.manual_seed(0)
    save_product(tmp_path, ActorCritic(ROBOT, further=(TILT, KNEES)), both, {})
    policy = load_policy(tmp_path)
    assert [term.term for term in policy.contract.command[-2:]] == ["tilt", "knees"]
    q = policy.robot.nominal + 0.1
    state = RobotState(q, 0.0 * q, np.array([0.98, 0.2, 0.0, 0.0]), np.zeros(3))
    policy.reset(state)
    policy.act(state, Command(gait=Gait.WALKING), UpperBody.none())
    np.testing.assert_allclose(policy.inputs[1][18:], [state.projected_gravity[1], 2 * q[3], 2 * q[8]], atol=1e-5)
    monkeypatch.setitem(TERMS, "tilt", dataclasses.replace(TILT, read=lambda s: 20.0 * s.gravity[:, 1:2]))
    with pytest.raises(PolicyFileError, match="fails its self-test"):
        load_policy(tmp_path)
    monkeypatch.delitem(TERMS, "tilt")
    with pytest.raises(PolicyFileError, match=r"unknown observation term 'tilt'.*the Python file that adds it"):
        load_policy(tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"size": 2}, "has the size 2 and other signs"),
        ({"sides": True, "size": 2}, r"gives shape \(64, 1\); give \(64, 2\)"),
        ({"signs": (0.5,)}, "has the size 1 and other signs"),
        ({"signs": (1.0,)}, "violates its mirror signs at 0"),
        ({"read": lambda s: s.gravity}, r"gives shape \(64, 3\)"),
        ({"read": lambda s: s.gravity[:, 1:2] / 0.0}, "gives numbers that are not finite"),
        ({"read": lambda s: s.gravity[:, 1:2] - s.gravity[:, 1].mean()}, "mixes robots"),
    ],
)
@pytest.mark.filterwarnings("ignore:divide by zero")
def test_a_term_that_does_not_work_is_refused(monkeypatch, change, message):
    monkeypatch.setitem(TERMS, "wrong", dataclasses.replace(TILT, **change))
    with pytest.raises(ConfigError, match=f"observation term 'wrong' {message}"):
        EnvConfig(count=2, observations=("wrong",))
