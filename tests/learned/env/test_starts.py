import pathlib

import numpy as np
import pytest
import torch

from hugwbc.errors import PolicyFileError
from hugwbc.gait import Gait
from hugwbc.learned.config import CommandConfig, EnvConfig, RandomizationConfig
from hugwbc.learned.env.humanoid_env import HumanoidEnv
from hugwbc.learned.env.starts import (
    COLUMNS,
    START_JOINT_NOISE,
    START_VELOCITY,
    RecordedStarts,
    StartRecorder,
    column_shapes,
    draw_starts,
)
from hugwbc.learned.policy import checkpoint
from hugwbc.robot import load_robot
from hugwbc.sim.batch import BatchSimulation

HOPPING = CommandConfig(standing_fraction=0.2, walking_fraction=0.0, hopping_fraction=0.8)


def states(gait: list[int], first: int = 1) -> dict[str, torch.Tensor]:
    """Recorded states that can be told apart."""
    rows = len(gait)
    generator = torch.Generator().manual_seed(first)
    sizes = {name: torch.rand(rows, *shape, generator=generator) for name, shape in column_shapes(load_robot()).items()}
    nominal = BatchSimulation(1, robot=load_robot()).qpos[0]
    qpos = nominal.repeat(rows, 1)
    qpos[:, 7:] += 0.01 * torch.arange(first, first + rows)[:, None]
    return sizes | {"gait": torch.tensor(gait), "qpos": qpos, "qvel": 0.1 * sizes["qvel"].double()}


@pytest.fixture
def starts_file(tmp_path: pathlib.Path) -> pathlib.Path:
    recorder = StartRecorder(5)
    recorder.add(states([3, 3, 4]))
    recorder.add(states([4, 3, 3, 3], first=4))
    assert recorder.full and recorder.count == 5
    recorder.save(tmp_path / "starts.safetensors")
    return tmp_path / "starts.safetensors"


def test_recorded_starts_are_drawn_by_gait_and_share(starts_file: pathlib.Path) -> None:
    starts, generator = RecordedStarts.load(starts_file, load_robot()), torch.Generator().manual_seed(0)
    assert starts.columns["gait"].tolist() == [3, 3, 4, 4, 3]
    gait = torch.tensor([3, 4, 0, 3, 1] * 100)
    having, drawn = starts.draw(gait, 1.0, generator)
    assert having.tolist() == [i for i in range(500) if gait[i] >= 3]
    assert (drawn["gait"] == gait[having]).all()
    rows = (drawn["qpos"][:, None] == starts.columns["qpos"]).all(-1)
    assert rows.any(0).all(), "all of them come up"
    having, _ = starts.draw(gait, 0.3, generator)
    assert len(having) == pytest.approx(0.3 * 300, abs=30)
    assert not len(starts.draw(gait, 0.0, generator)[0])


def test_episodes_start_in_recorded_motion_and_others_stand(starts_file: pathlib.Path) -> None:
    torch.set_num_threads(1)
    config = EnvConfig(count=60, command=HOPPING, starts=starts_file, starts_share=0.5, held_foot_grace=0.5)
    env = HumanoidEnv(config, seed=0, threads=1)
    env.begin_episodes(torch.arange(60))
    assert env.starts is not None and env.held_foot is not None
    columns, hopping = env.starts.columns, env.gait >= Gait.HOPPING_LEFT
    same = (env.simulation.qpos[:, None, 7:] == columns["qpos"][:, 7:]).all(-1)
    moving = same.any(1)
    assert not moving[~hopping].any() and 10 < moving.sum() < 40
    row = same[moving].int().argmax(1)
    for name in ("phase", "command", "history", "waist", "gait"):
        torch.testing.assert_close(getattr(env, name)[moving], columns[name][row])
    torch.testing.assert_close(env.actions[:, moving], columns["actions"][row].transpose(0, 1))
    np.testing.assert_array_equal(env.simulation.qvel[moving], columns["qvel"][row].numpy())
    np.testing.assert_array_equal(env.simulation.qpos[:, :2], 0.0)
    np.testing.assert_allclose(env.held_foot.due.numpy(), np.where(moving, 0.0, 0.5))
    standing = ~moving
    assert not env.actions[:, standing].any() and (env.simulation.ctrl == env.simulation.qpos[:, 7:])[standing].all()


def test_recorded_motion_starts_with_action_latency_too(starts_file: pathlib.Path) -> None:
    late = RandomizationConfig(latency=(0.0, 0.02))
    config = EnvConfig(count=20, command=HOPPING, starts=starts_file, starts_share=1.0, randomization=late)
    env = HumanoidEnv(config, seed=0, threads=1)
    assert env.latency is not None
    hopping = env.gait >= Gait.HOPPING_LEFT
    assert torch.equal(env.latency.targets[-1, hopping], env.simulation.ctrl[hopping])


def test_recorded_states_give_themselves_again(starts_file: pathlib.Path) -> None:
    config = EnvConfig(count=20, command=HOPPING, starts=starts_file, starts_share=1.0)
    env = HumanoidEnv(config, seed=0, threads=1)
    robots = torch.arange(20)
    env.begin_episodes(robots)
    again = env.recorded(robots[env.gait >= Gait.HOPPING_LEFT])
    columns = RecordedStarts({name: value.clone() for name, value in again.items()}, starts_file, load_robot()).columns
    source = env.starts.columns if env.starts else {}
    row = (columns["qpos"][:, None, 7:] == source["qpos"][:, 7:]).all(-1).int().argmax(1)
    for name in set(COLUMNS) - {"qpos"}:
        torch.testing.assert_close(columns[name], source[name][row])


def test_unusable_starts_are_refused(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "starts.safetensors"
    with pytest.raises(PolicyFileError, match="cannot read"):
        RecordedStarts.load(path, load_robot())
    for damage in ({"qpos": torch.zeros(2, 25)}, {"gait": torch.zeros(0)}, {"history": torch.zeros(3, 5, 63)}):
        checkpoint.save_file(path, states([3, 4]) | damage, "starts", {})
        with pytest.raises(PolicyFileError, match="no usable recorded starts"):
            RecordedStarts.load(path, load_robot())
    checkpoint.save_file(path, states([3, 4]), "policy", {})
    with pytest.raises(PolicyFileError, match="policy file"):
        RecordedStarts.load(path, load_robot())


def test_starts_are_about_the_nominal_pose_in_any_heading() -> None:
    stand = BatchSimulation(1, robot=load_robot()).qpos[0]
    drawn = draw_starts(stand, torch.arange(500), None, torch.Generator().manual_seed(0))
    nominal, qpos, qvel = (value.numpy() for value in (stand, *drawn))
    assert qpos.shape == (500, 26) and qvel.shape == (500, 25)
    np.testing.assert_array_equal(qpos[:, [0, 1, 2, 4, 5]], np.tile(nominal[[0, 1, 2, 4, 5]], (500, 1)))
    np.testing.assert_allclose(np.linalg.norm(qpos[:, 3:7], axis=1), 1.0, atol=1e-6)
    headings = 2.0 * np.arctan2(qpos[:, 6], qpos[:, 3])
    assert headings.min() < -3.0 and headings.max() > 3.0 and abs(headings.mean()) < 0.3
    for values, half_width in ((qpos[:, 7:] - nominal[7:], START_JOINT_NOISE), (qvel[:, :6], START_VELOCITY)):
        assert np.abs(values).max() <= half_width + 1e-6
        assert values.std() == pytest.approx(half_width / np.sqrt(3.0), rel=0.05)
    assert not qvel[:, 6:].any()
