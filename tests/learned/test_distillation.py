import dataclasses
import pathlib
from typing import Any

import pytest
import torch

from hugwbc.errors import ConfigError, PolicyFileError
from hugwbc.gait import Gait
from hugwbc.learned import checkpoint
from hugwbc.learned.config import CommandConfig, DistillationConfig, EnvConfig
from hugwbc.learned.distillation import CATCH_ROLL, CATCH_SPEED, Calibration, Distiller, SwingHeights, disturbance
from hugwbc.learned.networks import ActorCritic
from hugwbc.learned.train import SNAPSHOT_NAME
from hugwbc.robot import load_robot

ROBOT = load_robot()
# Equal on both sides, so that the mirrored half of a batch asks for the same.
KNEES = ROBOT.indices(["left_knee_joint", "right_knee_joint"])
COMMANDS = CommandConfig(standing_fraction=0.5, walking_fraction=0.3, hopping_fraction=0.2)


def write_teacher(path: pathlib.Path, action: float) -> pathlib.Path:
    """A snapshot of a network that always does the same with the knees."""
    network = ActorCritic()
    with torch.no_grad():
        for parameter in network.actor.parameters():
            parameter.zero_()
        last = [module for module in network.actor.modules() if isinstance(module, torch.nn.Linear)]
        (head,) = [layer for layer in last if layer.out_features == 19]
        head.bias[KNEES] = action
    tensors = {f"network.{name}": value for name, value in network.state_dict().items()}
    checkpoint.save_file(path, tensors, "checkpoint", {"steps": 7})
    return path


def make_config(folder: pathlib.Path, **changes: Any) -> DistillationConfig:
    names = ("standing", "catching", "walking", "hopping")
    teachers: Any = {name: write_teacher(folder / name, 0.1 * (i + 1)) for i, name in enumerate(names)}
    config = DistillationConfig(
        out=folder / "out",
        start_from=write_teacher(folder / "student", 0.0),
        env=EnvConfig(count=8, command=COMMANDS),
        memory=1000,
        batch=64,
        **teachers,
    )
    return dataclasses.replace(config, **changes)


def test_each_gait_is_labelled_by_its_teacher_and_a_moving_stand_by_the_catcher(tmp_path: pathlib.Path) -> None:
    distiller = Distiller(make_config(tmp_path))
    env = distiller.env
    gaits = (Gait.STANDING, Gait.STANDING, Gait.STANDING, Gait.WALKING, Gait.HOPPING_LEFT, Gait.HOPPING_RIGHT)
    env.gait[:6] = torch.tensor([int(gait) for gait in gaits])
    env.readings.velocity[:] = 0.0
    env.readings.angular_velocity[:] = 0.0
    env.readings.roll[:] = 0.0
    env.readings.velocity[1, 1] = CATCH_SPEED
    env.readings.velocity[2, 0] = 4.0 * CATCH_SPEED
    with torch.no_grad():
        label = distiller.label(env.observe())
    torch.testing.assert_close(
        label[:6, KNEES[0]], torch.tensor([0.1007, 0.15, 0.2, 0.3, 0.4, 0.4]), atol=1e-4, rtol=0.0
    )


def test_the_catcher_s_share_adds_the_disturbances_up(tmp_path: pathlib.Path) -> None:
    readings = Distiller(make_config(tmp_path)).env.readings
    readings.velocity[:] = 0.0
    readings.angular_velocity[:] = 0.0
    readings.roll[:] = -0.5 * CATCH_ROLL
    readings.velocity[:, 2] = 0.5 * CATCH_SPEED
    torch.testing.assert_close(disturbance(readings), torch.full((8,), 0.5))


def test_a_policy_that_turns_too_slowly_and_stands_too_low_is_asked_for_more() -> None:
    calibration, rng = Calibration(), torch.Generator().manual_seed(0)
    gait = torch.full((400,), int(Gait.WALKING))
    for _ in range(200):
        command = torch.rand(400, 8, generator=rng) * 2.0 - 1.0
        asked = calibration.commands(command, gait)
        executed = asked[:, [0, 1, 2, 5, 6, 7, 4]]
        executed[:, 2] = 0.8 * executed[:, 2]
        executed[:, 3] = executed[:, 3] - 0.03
        calibration.update(command, executed, gait)
    expected_gain, expected_offset = torch.ones(7), torch.zeros(7)
    expected_gain[2], expected_offset[3] = 1.25, 0.03
    torch.testing.assert_close(calibration.gain[Gait.WALKING], expected_gain, atol=0.01, rtol=0.0)
    torch.testing.assert_close(calibration.offset[Gait.WALKING], expected_offset, atol=0.01, rtol=0.0)
    torch.testing.assert_close(calibration.gain[Gait.STANDING], torch.ones(7))
    assert calibration.as_dict()["walking"]["h"][1] == pytest.approx(0.03, abs=0.01)


def test_a_command_that_is_always_the_same_moves_the_offset_only() -> None:
    calibration = Calibration()
    gait = torch.full((10,), int(Gait.JUMPING))
    executed = torch.full((10, 7), 0.2)
    executed[:, 6] = torch.nan
    calibration.update(torch.zeros(10, 8), executed, gait)
    torch.testing.assert_close(calibration.gain, torch.ones(len(Gait), 7))
    torch.testing.assert_close(calibration.offset[Gait.JUMPING], torch.tensor([-0.01] * 6 + [0.0]))


def test_what_a_policy_does_not_reach_at_high_speed_leaves_its_low_speeds_alone() -> None:
    calibration = Calibration()
    command = torch.zeros(100, 8)
    command[:, 0] = torch.linspace(-0.6, 2.0, 100)
    executed = command[:, [0, 1, 2, 5, 6, 7, 4]]
    executed[:, 0] = executed[:, 0].clamp(max=0.7)
    calibration.update(command, executed, torch.full((100,), int(Gait.WALKING)))
    torch.testing.assert_close(calibration.gain[Gait.WALKING], torch.ones(7))


def test_a_command_that_is_not_to_be_calibrated_is_left_alone() -> None:
    calibration = Calibration(("omega",))
    rng = torch.Generator().manual_seed(0)
    command = torch.rand(400, 8, generator=rng) * 2.0 - 1.0
    executed = 0.5 * command[:, [0, 1, 2, 5, 6, 7, 4]]
    calibration.update(command, executed, torch.full((400,), int(Gait.WALKING)))
    changed = calibration.gain[Gait.WALKING] != 1.0
    assert changed.tolist() == [False, False, True, False, False, False, False]


def test_the_swing_height_is_that_of_the_last_whole_stride() -> None:
    swings = SwingHeights(2)
    left = [0.0, 0.1, 0.2, 0.0, 0.0, 0.05, 0.3, 0.0]
    for step, height in enumerate(left):
        clearance = torch.tensor([[height, 0.1], [0.0, 0.0]])
        swings.update(torch.tensor([step / 4 % 1.0, step / 16]), clearance)
    assert swings.last[0].item() == pytest.approx(0.15) and swings.last[1].isnan()


def test_a_student_becomes_its_teacher(tmp_path: pathlib.Path) -> None:
    standing = EnvConfig(count=8, command=CommandConfig(standing_fraction=1.0, walking_fraction=0.0))
    config = make_config(tmp_path, env=standing, catching=None, samples=2400.0, updates=30, learning_rate=3e-3)
    distiller = Distiller(config)
    rows: list[dict[str, float]] = []
    distiller.run(rows.append)
    assert rows[-1]["imitation_loss"] < 0.1 * rows[0]["imitation_loss"] and rows[-1]["samples"] == 2400
    tensors, metadata = checkpoint.load_file(tmp_path / "out" / SNAPSHOT_NAME, "checkpoint")
    student = ActorCritic()
    student.load_state_dict({name.removeprefix("network."): value for name, value in tensors.items()})
    observation = distiller.env.observe()
    with torch.no_grad():
        action, _ = student.actor(observation.history, observation.command)
    torch.testing.assert_close(action[:, KNEES], torch.full((8, 2), 0.1), atol=0.03, rtol=0.0)
    assert float(action[:, ROBOT.arms].abs().max()) < 0.03
    assert metadata["steps"] == 7 and metadata["distillation"]["labels"] == 2400


def test_teachers_drive_and_are_calibrated_at_the_beginning_only(tmp_path: pathlib.Path) -> None:
    standing = EnvConfig(count=8, command=CommandConfig(standing_fraction=1.0, walking_fraction=0.0))
    config = make_config(tmp_path, env=standing, catching=None, samples=960.0, updates=1, calibration=0.7)
    distiller = Distiller(config)
    distiller.env.age[:] = 100
    distiller.env.command[:, 5] = -0.3
    offsets: list[float] = []
    distiller.run(lambda figures: offsets.append(float(distiller.calibration.offset[Gait.STANDING, 3])))
    # A stand that does not squat when it is told to is asked for a deeper one, until the student takes over.
    assert offsets[0] != 0.0 and offsets[3] != offsets[0]
    assert len(set(offsets[-4:])) == 1


def test_arms_under_takeover_do_not_count(tmp_path: pathlib.Path) -> None:
    distiller = Distiller(make_config(tmp_path))
    distiller.env.intervention.active[:] = False
    distiller.env.intervention.active[0] = True
    distiller.collect()
    weights = distiller.memory.sample(400)["weight"]
    masked = weights.min(1).values == 0.0
    assert 20 < int(masked.sum()) < 90  # an eighth of 400
    assert torch.all(weights[masked][:, ROBOT.arms] == 0.0) and torch.all(weights[masked][:, ROBOT.legs] == 1.0)


def test_a_snapshot_of_other_networks_is_refused(tmp_path: pathlib.Path) -> None:
    checkpoint.save_file(tmp_path / "other", {"network.weight": torch.zeros(3)}, "checkpoint", {})
    with pytest.raises(PolicyFileError, match="has other networks"):
        Distiller(make_config(tmp_path, start_from=tmp_path / "other"))


@pytest.mark.parametrize(
    "change",
    [
        {"samples": 0.0}, {"noise_level": 2.0}, {"exploration": -1.0}, {"walking": None}, {"calibration": 1.5},
        {"max_speed": float("nan")}, {"seed": -1}, {"calibrated": ("standing", "hoping")},
        {"calibrated_commands": ("v",)},
    ],
)  # fmt: skip
def test_settings_are_checked(tmp_path: pathlib.Path, change: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match=next(iter(change))):
        make_config(tmp_path, **change)
