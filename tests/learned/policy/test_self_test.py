import pytest
import torch

from hugwbc.learned.config import EnvConfig
from hugwbc.learned.policy import LearnedController, self_test
from hugwbc.learned.policy.networks import Actor


def controller(**changes: float) -> LearnedController:
    torch.manual_seed(0)
    return LearnedController(Actor(63, 18, 19), EnvConfig(**changes).contract())


def test_a_policy_agrees_with_its_own_record() -> None:
    stored = self_test.record(controller())
    assert self_test.deviation(controller(), stored) == 0.0


@pytest.mark.parametrize("change", [{"substeps": 2}, {"action_scale": 0.26}, {"waist_rate": 1.0}])
def test_every_setting_shows_in_the_targets(change: dict) -> None:
    stored = self_test.record(controller())
    assert self_test.deviation(controller(**change), stored) > 10 * self_test.TOLERANCE


def test_every_gait_and_both_states_of_the_arms_are_covered() -> None:
    stored = self_test.record(controller())
    assert set(stored["self_test.gait"].tolist()) == {0, 1, 2, 3, 4}
    assert 0 < int(stored["self_test.intervention"].sum()) < len(stored["self_test.gait"])
