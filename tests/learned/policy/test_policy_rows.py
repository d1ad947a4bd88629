import numpy as np
import torch

from hugwbc import COMMAND_NAMES, Command, Gait, RobotState, UpperBody, command_ranges, load_robot
from hugwbc.gait import foot_phases, homogenised_phase
from hugwbc.learned.policy import load_policy, observations as obs
from hugwbc.learned.policy.bare_actor import BareActor, on_arrays, row_by_row
from hugwbc.learned.policy.networks import Actor
from hugwbc.learned.policy.policy_contract import policy_contract
from hugwbc.learned.policy.policy_rows import PolicyRows

N = 37


@torch.no_grad()
def test_a_row_of_many_is_the_row_alone():
    torch.manual_seed(0)
    actor = Actor()
    history, command = torch.randn(N, 315), torch.randn(N, 18)
    alone = [actor(history[i : i + 1], command[i : i + 1]) for i in range(N)]
    bare = BareActor(actor)
    for i, expected in enumerate(alone):
        found = bare(history[i : i + 1], command[i : i + 1])
        assert all(torch.equal(a, b) for a, b in zip(found, expected, strict=True)), "to the last bit"
    for part, rows in zip(zip(*alone, strict=True), row_by_row(actor)(history, command), strict=True):
        assert torch.equal(rows, torch.cat(part)), "to the last bit"
    assert not torch.equal(actor(history, command)[0], row_by_row(actor)(history, command)[0]), "unlike the network's"


def test_many_robots_get_what_each_gets_alone():
    rng, robot = np.random.default_rng(0), load_robot()
    gaits = rng.choice([Gait.STANDING, Gait.WALKING, Gait.JUMPING], N)
    commands = [Command.from_array(_draw(rng, Gait(gait)), Gait(gait)) for gait in gaits]
    indicator = rng.uniform(size=N) < 0.5
    alone = [load_policy() for _ in range(3)]
    many = alone[0].for_many(N)
    kept = np.arange(N)
    for tick in range(6):
        orientation = np.column_stack((np.ones(N), 0.1 * rng.standard_normal((N, 3))))
        orientation /= np.linalg.norm(orientation, axis=1, keepdims=True)
        q, dq = robot.nominal + 0.1 * rng.standard_normal((N, 19)), rng.standard_normal((N, 19))
        spin = rng.standard_normal((N, 3))
        states = [RobotState(*row) for row in zip(q, dq, orientation, spin, strict=True)]
        gravity = np.array([state.projected_gravity for state in states])
        if tick == 0:
            many.reset()
            many.push(spin, gravity, q, dq)
        if tick == 4:
            many.keep(kept < N - 5)
            kept = kept[: N - 5]
        many.push(spin[kept], gravity[kept], q[kept], dq[kept])
        rows = np.array([command.array() for command in commands])[kept]
        targets = many.decide(rows, gaits.astype(int)[kept], indicator[kept])
        for controller, index in zip(alone, (0, 7, 31), strict=True):
            if tick == 0:
                controller.reset(states[index])
            arms = UpperBody.targets(np.zeros(8)) if indicator[index] else UpperBody.none()
            own = np.setdiff1d(np.arange(19), robot.arms) if indicator[index] else np.arange(19)
            np.testing.assert_allclose(
                targets[index][own], controller.act(states[index], commands[index], arms).q[own], atol=1e-5, rtol=0
            )
            assert many.phase[index] == controller.phase


def test_rows_see_what_the_training_lets_the_network_see():
    rng = np.random.default_rng(1)
    gait = np.array([int(gait) for gait in Gait])
    command = np.array([_draw(rng, Gait(value)) for value in gait])
    indicator = gait % 2 == 0
    rows = PolicyRows(policy_contract(), on_arrays(BareActor(Actor(obs.COMMAND_SIZE))), len(gait))
    rows.phase = rng.uniform(size=len(gait))
    phases = homogenised_phase(foot_phases(torch.tensor(rows.phase), torch.tensor(gait))).float()
    seen = obs.command_observation(torch.tensor(command).float(), torch.tensor(gait), phases, torch.tensor(indicator))
    np.testing.assert_allclose(rows._observe(command, gait, indicator), seen.numpy(), atol=2e-6)


def _draw(rng: np.random.Generator, gait: Gait) -> np.ndarray:
    return np.array([rng.uniform(*command_ranges(gait)[name].finishing) for name in COMMAND_NAMES])
