import pytest
import torch

from hugwbc.errors import ConfigError
from hugwbc.learned.imitation.dagger import Memory
from hugwbc.learned.policy import observations as obs
from hugwbc.learned.policy.observations import Observation


def test_half_of_a_batch_is_mirrored() -> None:
    torch.manual_seed(0)
    memory = Memory(3, torch.Generator().manual_seed(0))
    rows = [torch.randn(2, size) for size in (315, obs.COMMAND_SIZE, obs.CRITIC_SIZE, 6, 19)]
    history, command, critic, estimate, action = rows
    weight = torch.rand(2, 19)
    for _ in range(2):  # wraps round
        memory.add(Observation(history, command, critic, estimate), action, weight)
    assert memory.size == 3
    batch = memory.sample(64)
    for i in range(64):
        mirrored = i < 32
        seen = obs.mirror_action(batch["action"][i : i + 1]) if mirrored else batch["action"][i : i + 1]
        row = int((action - seen).abs().sum(1).argmin())
        torch.testing.assert_close(seen[0], action[row])
        back = obs.mirror_history(batch["history"][i : i + 1]) if mirrored else batch["history"][i : i + 1]
        torch.testing.assert_close(back[0], history[row])
        expected = estimate[row].clone()
        if mirrored:
            expected = expected[[0, 1, 2, 4, 3, 5]]
            expected[1] *= -1.0
        torch.testing.assert_close(batch["estimate"][i], expected)
        assert batch["weight"][i].min() >= 0.0


def test_more_labels_than_memory_are_refused() -> None:
    with pytest.raises(ConfigError, match="GiB of memory; ask for fewer"):
        Memory(10**14, torch.Generator())
