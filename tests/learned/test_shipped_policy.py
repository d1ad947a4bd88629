import csv
import pathlib

import numpy as np
import pytest
import torch

from hugwbc.commands import MEASURED_NAMES, Command
from hugwbc.evaluation.metrics import held_foot_contact, touch_downs
from hugwbc.gait import Gait
from hugwbc.learned.config import EnvConfig, TrainConfig
from hugwbc.learned.policy import load_policy, policy_file, shipped_policies
from hugwbc.learned.policy.network_files import SNAPSHOT_FILE
from hugwbc.learned.rl.trainer import Trainer
from hugwbc.robot import load_robot
from hugwbc.runtime import Constant, rollout
from hugwbc.sim import Simulation


@pytest.mark.parametrize("robot", ["h1", "g1"])
@pytest.mark.parametrize(
    ("gait", "asked"),
    [
        (Gait.STANDING, {}),
        (Gait.STANDING, {"h": -0.2, "p": 0.2, "w": 0.5}),
        (Gait.WALKING, {}),
        (Gait.WALKING, {"v_x": 0.5}),
        (Gait.WALKING, {"v_y": -0.3, "omega": 0.3}),
    ],
    ids=["stand", "squat", "step in place", "forwards", "sideways and turning"],
)
def test_stays_up_and_does_most_of_what_it_is_asked(gait: Gait, asked: dict[str, float], robot: str) -> None:
    command = Command.from_mapping(asked, gait, load_robot(robot))
    trace = rollout(load_policy(robot), Constant(command), Simulation(robot=robot, sensing="exact"), duration=4.0)
    assert not trace.fell
    mean = dict(zip(MEASURED_NAMES, trace.measured[100:].mean(axis=0), strict=True))
    for name, value in asked.items():
        assert 0.5 < mean[name] / value < 1.7, name  # a deep squat of the G1 leans by half more
    steps = sum(times.size for times in trace.touch_downs)
    assert (steps > 10) == (gait is Gait.WALKING)


@pytest.mark.parametrize("gait", [Gait.HOPPING_LEFT, Gait.HOPPING_RIGHT])
def test_hops_at_the_frequency_of_the_clock(gait: Gait) -> None:
    command = Command(v_x=0.3, gait=gait)
    trace = rollout(load_policy(), Constant(command), Simulation(sensing="exact"), duration=5.0)
    assert not trace.fell
    assert np.diff(touch_downs(trace, gait.feet[0])).mean() == pytest.approx(0.5, abs=0.02)
    assert trace.measured[75:, 0].mean() == pytest.approx(0.3, abs=0.15)
    assert held_foot_contact(trace, settle=1.5) < 0.5  # the shipped one brushes the ground; a pair of feet would be 1


def test_every_policy_has_a_card_and_the_curve_of_its_training() -> None:
    ablation = ["h1-motion", "h1-noise", "h1-none", "h1-plain"]
    assert shipped_policies() == ["g1", "h1", *ablation]
    for name in shipped_policies():
        folder = policy_file(name).parent
        assert (folder / "README.md").read_text().startswith(f"# Policy `{name}`")
        if name in ablation:
            continue
        rows = list(csv.DictReader((folder / "training.csv").open()))
        steps = [float(row["steps"]) for row in rows]
        assert steps == sorted(steps)
        made = load_policy(name).training["steps"]
        assert any(abs(made - step) < 3e5 for step in steps), "every tenth iteration is in the curve"


def test_training_goes_on_from_the_shipped_snapshot(tmp_path: pathlib.Path) -> None:
    settings = TrainConfig(
        out=tmp_path, start_from=policy_file("h1").parent / SNAPSHOT_FILE, threads=1, env=EnvConfig(count=8)
    )
    resumed, shipped = Trainer(settings), load_policy("h1")
    assert resumed.steps == shipped.training["steps"]
    history, command = torch.randn(5, 315), torch.randn(5, shipped.actor.command_size)
    with torch.no_grad():
        pairs = zip(resumed.ppo.network.actor(history, command), shipped.actor(history, command), strict=True)
        for ours, theirs in pairs:  # the snapshot's symmetric network, and the same function in plain layers
            torch.testing.assert_close(ours, theirs, atol=1e-4, rtol=1e-4)
