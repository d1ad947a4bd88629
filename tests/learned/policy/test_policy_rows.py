import numpy as np
import torch

from hugwbc import COMMAND_NAMES, Gait, command_ranges
from hugwbc.gait import foot_phases, homogenised_phase
from hugwbc.learned.policy import observations as obs
from hugwbc.learned.policy.bare_actor import BareActor, on_arrays
from hugwbc.learned.policy.networks import Actor
from hugwbc.learned.policy.policy_contract import policy_contract
from hugwbc.learned.policy.policy_rows import PolicyRows


@torch.no_grad()
def test_the_bare_network_gives_what_the_module_gives():
    torch.manual_seed(0)
    actor = Actor()
    bare = BareActor(actor)
    for history, command in zip(torch.randn(5, 1, 315), torch.randn(5, 1, 18), strict=True):
        found = bare(history, command)
        assert all(torch.equal(a, b) for a, b in zip(found, actor(history, command), strict=True)), "to the last bit"


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
