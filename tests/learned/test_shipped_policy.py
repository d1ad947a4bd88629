import csv
import pathlib

import numpy as np
import pytest

from hugwbc.commands import Command
from hugwbc.evaluation import Constant, rollout
from hugwbc.gait import Gait
from hugwbc.learned.config import EnvConfig, TrainConfig
from hugwbc.learned.policy import load_policy, policy_dir, shipped_policies
from hugwbc.learned.train import SNAPSHOT_NAME, Trainer
from hugwbc.sim import Simulation


@pytest.mark.parametrize(
    "command",
    [
        Command(),
        Command(h=-0.2, p=0.2, w=0.5),
        Command(gait=Gait.WALKING),
        Command(v_x=0.5, gait=Gait.WALKING),
        Command(v_y=-0.3, omega=0.3, gait=Gait.WALKING),
    ],
    ids=["stand", "squat", "step in place", "forwards", "sideways and turning"],
)
def test_stays_up(command: Command) -> None:
    trace = rollout(load_policy(), Constant(command), Simulation(), duration=5.0)
    assert not trace.fell
    if command.v_x:
        assert trace.measured[100:, 0].mean() > 0.5 * command.v_x
    steps = sum(times.size for times in trace.touch_downs)
    assert (steps > 10) == (command.gait is Gait.WALKING)


def test_every_policy_has_card_curve_and_snapshot(tmp_path: pathlib.Path) -> None:
    assert shipped_policies() == ["h1"]
    for name in shipped_policies():
        folder = policy_dir() / name
        assert (folder / "README.md").is_file()
        rows = list(csv.DictReader((folder / "training.csv").open()))
        steps = [float(row["steps"]) for row in rows]
        assert steps == sorted(steps)
        trained = load_policy(name).metadata["training"]["steps"]
        assert abs(trained - steps[-1]) < 1e6
        settings = TrainConfig(out=tmp_path, start_from=folder / SNAPSHOT_NAME, threads=1, env=EnvConfig(count=8))
        resumed = Trainer(settings)
        assert resumed.steps == trained
        np.testing.assert_array_equal(
            resumed.ppo.network.actor.encoder[0].weight.detach().numpy(),
            load_policy(name).actor.encoder[0].weight.detach().numpy(),
        )
