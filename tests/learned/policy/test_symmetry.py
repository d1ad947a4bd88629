import pytest
import torch

from hugwbc.learned.policy import critic_observations as obs
from hugwbc.learned.policy.symmetry import EvenOdd, SignedPermutation
from hugwbc.learned.policy.terms import ACTION, COMMAND, CRITIC_CORE, HISTORY
from hugwbc.robot import load_robot

PARTS = {"action": ACTION, "history": HISTORY, "command": COMMAND, "critic": CRITIC_CORE}
MIRRORS = {
    f"{name} {robot}": obs.mirror(part, load_robot(robot)) for name, part in PARTS.items() for robot in ("h1", "g1")
}


@pytest.mark.parametrize("mirror", [*MIRRORS.values(), obs.terrain_mirror()], ids=[*MIRRORS, "terrain"])
def test_a_mirror_image_negates_the_odd_coordinates_alone(mirror: SignedPermutation) -> None:
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
