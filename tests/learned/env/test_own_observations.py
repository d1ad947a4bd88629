"""Observation terms that another package registers."""

import dataclasses
import math
import pickle

import numpy as np
import pytest
import torch

from hugwbc import Command, Gait, UpperBody
from hugwbc.errors import ConfigError, PolicyFileError, UnknownNameError
from hugwbc.learned.config import EnvConfig, ImitationConfig, PPOConfig, RandomizationConfig, TrainConfig
from hugwbc.learned.env import HumanoidEnv
from hugwbc.learned.imitation.imitation import Imitator
from hugwbc.learned.policy import load_policy, observations as obs, own_terms as terms
from hugwbc.learned.policy.networks import ActorCritic
from hugwbc.learned.policy.own_terms import GROUP, ObservationTerm
from hugwbc.learned.policy.policy_contract import policy_contract
from hugwbc.learned.policy.snapshots import load_into
from hugwbc.learned.rl.ppo import PPO
from hugwbc.learned.rl.trainer import Trainer, save_product
from hugwbc.state import RobotState

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


def forget():
    terms.registered_terms.cache_clear()
    terms._term.cache_clear()


@pytest.fixture
def register(monkeypatch, install):
    """The function that registers terms of a module `own_terms`."""

    def register(**found):
        install("own_terms", GROUP, found)
        forget()

    yield register
    monkeypatch.undo()
    forget()


@pytest.fixture
def both(register):
    register(tilt=TILT, knees=KNEES)
    return EnvConfig(count=6, observations=("tilt", "knees"))


def test_without_such_packages_nothing_changes_and_names_are_refused():
    assert EnvConfig().observations == () and policy_contract()["command"][-1]["name"].startswith("intervention")
    with pytest.raises(UnknownNameError, match=r"unknown observation term 'tilt'.*no package with terms is installed"):
        EnvConfig(observations=("tilt",))


def test_actor_and_critic_see_the_terms_with_their_scales(both, register):
    register(tilt=TILT, knees=dataclasses.replace(KNEES, noise=0.0))
    calm = dataclasses.replace(both, randomization=RandomizationConfig(noise=0.0, sensing=(0.0, 0.0)))
    env = HumanoidEnv(calm, seed=1, threads=1)
    env.step(0.5 * torch.randn(6, 19, generator=torch.Generator().manual_seed(0)))
    seen = env.observe()
    expected = torch.cat((env.readings.gravity[:, 1:2], 2.0 * env.readings.q[:, [3, 8]]), dim=1)
    assert seen.command.shape == (6, 21) and seen.critic.shape == (6, 125)
    torch.testing.assert_close(seen.command[:, 18:], expected, atol=1e-5, rtol=0.0)
    torch.testing.assert_close(seen.critic[:, 121:124], expected, atol=1e-5, rtol=0.0)
    assert pickle.loads(pickle.dumps(calm)) == calm


def test_the_noise_is_the_declared_one(both):
    only_terms = dataclasses.replace(both, count=500, randomization=RandomizationConfig(sensing=(0.0, 0.0)))
    env = HumanoidEnv(only_terms, seed=1, threads=1)
    first, second = env.observe().command[:, 18:], env.observe().command[:, 18:]
    assert torch.equal(first[:, 0], second[:, 0]), "the tilt declares none"
    apart = (first - second)[:, 1:].abs().max()
    assert 0.15 < apart <= 2 * 2.0 * 0.05, "the difference of two draws of half-width 0.05 at scale 2"


@pytest.mark.parametrize("symmetric", [True, False])
def test_the_networks_mirror_the_terms_as_declared(symmetric):
    own = (TILT, KNEES)
    network = ActorCritic(symmetric=symmetric, own=own)
    mirror = obs.command_mirror(own)
    assert mirror.sign[18:].tolist() == [-1.0, 1.0, 1.0] and mirror.index[18:].tolist() == [18, 20, 19]
    history, command = torch.randn(4, 315), torch.randn(4, 21)
    critic = torch.randn(4, 121 + 3 + 1)
    if symmetric:
        image = torch.cat((obs.critic_mirror(own)(critic[:, :124]), critic[:, 124:]), dim=1)
        torch.testing.assert_close(network.critic(image), network.critic(critic), atol=1e-5, rtol=1e-5)
        straight, _ = network.actor(history, command)
        mirrored, _ = network.actor(obs.mirror_history(history), mirror(command))
        torch.testing.assert_close(mirrored, obs.mirror_action(straight), atol=1e-5, rtol=1e-5)
    plain = network.actor.plain()
    assert plain.command_size == 21
    torch.testing.assert_close(plain(history, command)[0], network.actor(history, command)[0], atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize("symmetry", ["network", "loss"])
def test_ppo_learns_with_them(both, symmetry):
    env = HumanoidEnv(both, seed=1, threads=1)
    config = PPOConfig(horizon=2, symmetry=symmetry, minibatches=1, epochs=1)
    learner = PPO(config, 6, torch.Generator().manual_seed(0), own=env.own)
    first = learner.network.actor.plain().state_dict()["policy.0.weight"][:, -3:].clone()
    for t in range(2):
        learner.record(t, env.step(learner.act(t, env.observe(), env.gait)))
    losses = learner.update(env.observe())
    assert math.isfinite(losses["value_loss"]) and losses["skipped"] == 0.0
    assert not torch.equal(first, learner.network.actor.plain().state_dict()["policy.0.weight"][:, -3:])


@pytest.mark.parametrize("symmetric", [True, False])
def test_a_network_without_them_goes_on_as_the_same_function(symmetric):
    old, new = ActorCritic(symmetric=symmetric), ActorCritic(symmetric=symmetric, own=(TILT, KNEES))
    load_into(new, old.state_dict())
    history, command, own = torch.randn(4, 315), torch.randn(4, 18), torch.randn(4, 3)
    core, ground = torch.randn(4, 121), torch.randn(4, 221)
    wide = torch.cat((command, own), dim=1)
    torch.testing.assert_close(new.actor(history, wide), old.actor(history, command), atol=1e-5, rtol=1e-5)
    found = new.critic(torch.cat((core, own, ground), dim=1))
    torch.testing.assert_close(found, old.critic(torch.cat((core, ground), dim=1)), atol=1e-5, rtol=1e-5)
    load_into(new, new.state_dict())


def test_a_policy_with_them_runs_where_the_package_is_and_nowhere_else(both, register, tmp_path):
    torch.manual_seed(0)
    network = ActorCritic(own=(TILT, KNEES))
    save_product(tmp_path, network, both, {})
    policy = load_policy(tmp_path)
    assert [part["term"] for part in policy.metadata["command"] if "term" in part] == ["tilt", "knees"]
    q = policy.robot.nominal + 0.1
    state = RobotState(q, 0.0 * q, np.array([0.98, 0.2, 0.0, 0.0]), np.zeros(3))
    policy.reset(state)
    policy.act(state, Command(gait=Gait.WALKING), UpperBody.none())
    seen = policy.last_pass()["observation"][0, 18:]
    np.testing.assert_allclose(seen, [state.projected_gravity[1], 2 * q[3], 2 * q[8]], atol=1e-5)
    register(tilt=TILT)
    with pytest.raises(PolicyFileError, match="reads the observation terms tilt, knees of other packages"):
        load_policy(tmp_path)
    register(tilt=TILT, knees=dataclasses.replace(KNEES, scale=1.0))
    with pytest.raises(PolicyFileError, match="has command = "):
        load_policy(tmp_path)
    register(tilt=dataclasses.replace(TILT, read=lambda s: 20.0 * s.gravity[:, 1:2]), knees=KNEES)
    with pytest.raises(PolicyFileError, match="fails its self-test"):
        load_policy(tmp_path)


def test_what_has_no_terms_says_so(both, tmp_path):
    with pytest.raises(ConfigError, match="teachers have no observation terms"):
        Imitator(ImitationConfig(out=tmp_path, env=both), make_teacher=lambda _: pytest.fail("nobody teaches"))
    with pytest.raises(ConfigError, match="labels of a teacher have no observation terms"):
        PPO(PPOConfig(labels=tmp_path), 6, torch.Generator(), own=(TILT,))


def test_a_checkpoint_of_other_terms_says_to_take_the_snapshot(both, tmp_path):
    config = TrainConfig(
        out=tmp_path / "a",
        threads=1,
        steps=1,
        evaluation_interval=0,
        env=dataclasses.replace(both, observations=()),
        ppo=PPOConfig(horizon=2, minibatches=1, epochs=1),
    )
    Trainer(config).run(lambda *_: None)
    wider = dataclasses.replace(config, out=tmp_path / "b", env=both)
    with pytest.raises(PolicyFileError, match="continue from its snapshot"):
        Trainer(dataclasses.replace(wider, start_from=tmp_path / "a" / "checkpoint.safetensors"))
    trainer = Trainer(dataclasses.replace(wider, start_from=tmp_path / "a" / "snapshot.safetensors"))
    assert trainer.ppo.network.own == (TILT, KNEES)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"size": 0}, "has the size 0"),
        ({"size": 2}, "has signs for 1 numbers and the size 2"),
        ({"sides": True}, "has signs for 2 numbers and the size 1"),
        ({"signs": (0.5,)}, "has the signs .* give \\+1 or -1 for each number"),
        ({"signs": "links"}, "has the signs 'links'; give \\+1 or -1 for each number"),
        ({"signs": (1.0,)}, "gives a mirrored robot not the mirror image that its signs declare: see its number 0"),
        ({"scale": 0.0}, "has scale 0.0 and noise 0.0"),
        ({"noise": float("nan")}, "has scale 1.0 and noise nan"),
        ({"read": lambda s: s.gravity}, r"gives shape \(64, 3\); give an array, here \(64, 1\)"),
        ({"read": lambda s: 1.0}, "gives a float"),
        ({"read": lambda s: s.nothing}, r"fails: AttributeError.*test_own_observations.py, line"),
        ({"read": lambda s: s.gravity[:, 1:2] / 0.0}, "gives numbers that are not finite"),
        (
            {"read": lambda s: s.gravity[:, 1:2] - s.gravity[:, 1].mean()},
            "gives a robot alone other numbers than among others",
        ),
    ],
)
@pytest.mark.filterwarnings("ignore:divide by zero")
def test_a_term_that_does_not_work_is_refused_before_the_first_step(register, change, message):
    register(wrong=dataclasses.replace(TILT, **change))
    with pytest.raises(ConfigError, match=rf"observation term 'wrong' \(own_terms:wrong\) {message}"):
        HumanoidEnv(EnvConfig(count=2, observations=("wrong",)), seed=0, threads=1)


def test_what_is_no_term_or_given_twice_is_refused(register):
    register(number=3, tilt=TILT)
    with pytest.raises(ConfigError, match="is a int; register an ObservationTerm"):
        HumanoidEnv(EnvConfig(count=2, observations=("number",)), seed=0, threads=1)
    with pytest.raises(ConfigError, match="give each once"):
        EnvConfig(observations=("tilt", "tilt"))
