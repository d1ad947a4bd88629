import pathlib

import pytest
import torch

from hugwbc.errors import PolicyFileError
from hugwbc.learned.config import PPOConfig
from hugwbc.learned.env.readings import StepResult
from hugwbc.learned.policy import checkpoint
from hugwbc.learned.policy.networks import ActorCritic
from hugwbc.learned.policy.observations import CRITIC_SIZE, Observation
from hugwbc.learned.rl.cloning import Labels, cloning_loss, save_labels
from hugwbc.learned.rl.ppo import PPO


def write(path: pathlib.Path, rows: int = 50) -> dict[str, torch.Tensor]:
    torch.manual_seed(0)
    columns = {"history": torch.randn(rows, 315), "command": torch.randn(rows, 18), "weight": torch.ones(rows, 19)}
    columns["action"] = columns["history"][:, :19].clone()
    save_labels(path, columns, {"teacher": "a test"})
    return columns


def test_loss_by_hand() -> None:
    action, label = torch.tensor([[1.0, 2.0]]), torch.tensor([[0.0, 5.0]])
    assert cloning_loss(action, label, torch.tensor([[1.0, 0.5]])).item() == pytest.approx((0.5 + 0.5 * 2.5) / 2.0)


@pytest.mark.parametrize("symmetric", [True, False])
def test_labels_are_read_in_the_coordinates_of_the_network(tmp_path: pathlib.Path, symmetric: bool) -> None:
    write(tmp_path / "labels")
    network = ActorCritic(symmetric=symmetric)
    labels = Labels(tmp_path / "labels", network, torch.Generator().manual_seed(0))
    batch = labels.sample(6)
    assert labels.count == 50 and batch["action"].shape == (6, 19)
    # The half precision of the file is 1e-3 of a number.
    columns, _ = checkpoint.load_file(tmp_path / "labels", "labels")
    row = int((columns["action"].float() - batch["action"][0]).abs().sum(1).argmin())
    torch.testing.assert_close(columns["action"][row].float(), batch["action"][0])
    with torch.no_grad():
        seen, _ = network.actor.prepared(batch["history"], batch["command"])
        plain, _ = network.actor(columns["history"][row : row + 1].float(), columns["command"][row : row + 1].float())
    torch.testing.assert_close(seen[:1], plain, atol=1e-5, rtol=1e-4)


def test_a_file_of_another_shape_is_refused(tmp_path: pathlib.Path) -> None:
    checkpoint.save_file(
        tmp_path / "labels", {"history": torch.zeros(3, 2), "action": torch.zeros(3, 19)}, "labels", {}
    )
    with pytest.raises(PolicyFileError, match="'history' has the shape"):
        Labels(tmp_path / "labels", ActorCritic(), torch.Generator())


def test_the_term_pulls_the_policy_to_the_labels_as_its_weight_says(tmp_path: pathlib.Path) -> None:
    write(tmp_path / "labels")
    losses = {}
    for weight in (0.0, 10.0):
        torch.manual_seed(0)
        config = PPOConfig(horizon=2, labels=tmp_path / "labels", cloning_weight=weight, cloning_batch=50)
        learner = PPO(config, 4, torch.Generator().manual_seed(0))
        learner.learning_rate = 1e-3
        seen = Observation(torch.randn(4, 315), torch.randn(4, 18), torch.randn(4, CRITIC_SIZE), torch.randn(4, 6))
        for _ in range(20):
            for t in range(2):
                learner.act(t, seen, torch.ones(4, dtype=torch.long))
                result = StepResult(
                    torch.zeros(4), torch.ones(4, dtype=torch.bool), torch.empty(0, dtype=torch.long), seen.critic[:0]
                )
                learner.record(t, result)
            figures = learner.update(seen)
        assert learner.labels is not None
        batch = learner.labels.sample(200)
        mean, _ = learner.network.actor.prepared(batch["history"], batch["command"])
        losses[weight] = cloning_loss(mean, batch["action"], batch["weight"]).item()
        assert (figures["cloning_loss"] > 0.0) == (weight > 0.0)
    assert losses[10.0] < 0.8 * losses[0.0]
