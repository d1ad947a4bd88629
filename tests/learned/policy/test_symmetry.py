import pytest
import torch

from hugwbc.learned.policy import critic_observations as obs
from hugwbc.learned.policy.symmetry import EvenOdd, SignedPermutation
from hugwbc.learned.policy.terms import ACTION, COMMAND, CRITIC_CORE, HISTORY
from hugwbc.robot import load_robot


@pytest.mark.parametrize("robot", ["h1", "g1"])
@pytest.mark.parametrize("name", ["action", "history", "command", "critic", "terrain"])
def test_a_mirror_image_negates_the_odd_coordinates_alone(name: str, robot: str) -> None:
    parts = {"action": ACTION, "history": HISTORY, "command": COMMAND, "critic": CRITIC_CORE}
    mirror = obs.mirror(parts[name], load_robot(robot)) if name in parts else obs.terrain_mirror()
    split = EvenOdd(mirror)
    rows = torch.randn(3, len(mirror.index))
    even, odd = split(rows).split((split.even, split.odd), 1)
    torch.testing.assert_close(split(mirror(rows)), torch.cat((even, -odd), 1))
    torch.testing.assert_close(split(rows), rows @ split.matrix.T)
    torch.testing.assert_close(split.inverse(split(rows)), rows)


def test_a_map_that_is_not_its_own_inverse_is_refused() -> None:
    with pytest.raises(ValueError, match="inverse"):
        SignedPermutation(torch.tensor([1, 2, 0]), torch.ones(3))
    with pytest.raises(ValueError, match="inverse"):
        SignedPermutation(torch.tensor([1, 0]), torch.tensor([1.0, -1.0]))
