import dataclasses
import pathlib
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

from hugwbc.commands import sample_all
from hugwbc.errors import ConfigError, PolicyFileError
from hugwbc.gait import Gait
from hugwbc.learned.config import CommandConfig, DistillationConfig, EnvConfig
from hugwbc.learned.imitation.distillation import (
    CATCH_ROLL,
    CATCH_SPEED,
    Calibration,
    Distiller,
    SwingHeights,
    disturbance,
)
from hugwbc.learned.policy import checkpoint, observations as obs
from hugwbc.learned.policy.networks import ActorCritic
from hugwbc.learned.policy.terms import TERMS
from hugwbc.learned.rl.trainer import SNAPSHOT_NAME
from hugwbc.robot import load_robot

ROBOT = load_robot()
# Equal on both sides, so that the mirrored half of a batch asks for the same.
KNEES = ROBOT.indices(["left_knee_joint", "right_knee_joint"])
COMMANDS = CommandConfig(standing_fraction=0.5, walking_fraction=0.3, hopping_fraction=0.2)


def write_teacher(path: pathlib.Path, action: float) -> pathlib.Path:
    """A snapshot of a network that always does the same with the knees."""
    network = ActorCritic(symmetric=False)
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


def test_hops_on_the_right_leg_are_labelled_as_the_mirror_images_of_those_on_the_left(tmp_path: pathlib.Path) -> None:
    distiller = Distiller(make_config(tmp_path))
    torch.manual_seed(0)
    teacher = ActorCritic(symmetric=False).actor  # random: it does different things on its two sides
    distiller.teachers["hopping"] = teacher
    distiller.env.gait[:4], distiller.env.gait[4:] = int(Gait.HOPPING_LEFT), int(Gait.HOPPING_RIGHT)
    seen = distiller.env.observe()
    history, command = seen.history.clone(), seen.command.clone()
    history[4:], command[4:] = obs.mirror_history(history[:4]), obs.mirror_command_observation(command[:4])
    commanded = command[:, :8] / torch.tensor(TERMS["command"].scale)
    distiller.env.command[:] = commanded
    with torch.no_grad():
        label = distiller.label(dataclasses.replace(seen, history=history, command=command))
        own, _ = teacher(history, command)
    torch.testing.assert_close(label[:4], own[:4])
    torch.testing.assert_close(label[4:], obs.mirror_action(own[:4]))
    assert (label[4:] - own[4:]).abs().max() > 1e-3


def test_the_catcher_s_share_adds_the_disturbances_up(tmp_path: pathlib.Path) -> None:
    readings = Distiller(make_config(tmp_path)).env.readings
    readings.velocity[:] = 0.0
    readings.angular_velocity[:] = 0.0
    readings.roll[:] = -0.5 * CATCH_ROLL
    readings.velocity[:, 2] = 0.5 * CATCH_SPEED
    torch.testing.assert_close(disturbance(readings), torch.full((8,), 0.5))


MEASURED = [0, 1, 2, 5, 6, 7, 4]  # columns of the calibrated commands: v_x, v_y, omega, h, p, w, l


def calibrate(calibration: Calibration, answer: Callable[[torch.Tensor], None]) -> torch.Tensor:
    """Commands of a walk (400, 8) over the whole ranges, after a policy was calibrated that executes `answer`."""
    rng = np.random.default_rng(0)
    gait = torch.full((400,), int(Gait.WALKING))
    command = torch.zeros(0)
    for _ in range(300):
        command = torch.tensor(sample_all(Gait.WALKING, rng, 400), dtype=torch.float32)
        executed = calibration.commands(command, gait)[:, MEASURED]
        answer(executed)
        calibration.update(command, executed, gait)
    return command


def test_a_policy_that_turns_too_slowly_and_stands_too_low_is_asked_for_more() -> None:
    calibration = Calibration()

    def answer(executed: torch.Tensor) -> None:
        executed[:, 2] = 0.8 * executed[:, 2]
        executed[:, 3] = executed[:, 3] - 0.03

    command = calibrate(calibration, answer)
    expected = command.clone()
    expected[:, 2] /= 0.8
    expected[:, 5] += 0.03
    gait = torch.full((400,), int(Gait.WALKING))
    torch.testing.assert_close(calibration.commands(command, gait), expected, atol=2e-3, rtol=0.0)
    standing = torch.full((400,), int(Gait.STANDING))
    assert torch.equal(calibration.commands(command, standing), command)
    pairs = calibration.as_dict()["walking"]["h"]
    assert pairs[0] == pytest.approx([-0.3, -0.27], abs=2e-3) and pairs[-1] == pytest.approx([0.0, 0.03], abs=2e-3)


def test_an_answer_that_saturates_is_undone_up_to_its_end() -> None:
    calibration = Calibration()

    def answer(executed: torch.Tensor) -> None:
        executed[:, 6] = 0.25 * executed[:, 6].clamp(max=0.8) + 0.1

    calibrate(calibration, answer)
    pairs = calibration.as_dict()["walking"]["l"]
    assert pairs[0] == pytest.approx([0.1, 0.0], abs=0.02)
    command, asked = pairs[2]
    assert asked == pytest.approx((command - 0.1) / 0.25, abs=0.05)
    command, asked = pairs[-1]
    assert 0.8 < asked <= command + 0.8 + 1e-4  # no more is asked for once nothing more is gained


def test_a_command_that_is_not_to_be_calibrated_is_left_alone() -> None:
    def answer(executed: torch.Tensor) -> None:
        executed *= 0.5

    calibration = Calibration(("omega",))
    calibrate(calibration, answer)
    changed = (calibration.asked != calibration.knots).any(-1)[Gait.WALKING]
    assert changed.tolist() == [False, False, True, False, False, False, False]


def test_what_is_not_known_or_not_commanded_changes_nothing() -> None:
    calibration = Calibration()
    executed = torch.full((10, 7), 0.2)
    executed[:, 6] = torch.nan
    calibration.update(torch.zeros(10, 8), executed, torch.full((10,), int(Gait.STANDING)))
    changed = (calibration.asked != calibration.knots).any(-1)[Gait.STANDING]
    assert changed.tolist() == [False, False, False, True, True, True, False]


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
    student = ActorCritic(symmetric=False)
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
    distiller.run(lambda figures: offsets.append(float(distiller.calibration.asked[Gait.STANDING, 3, 0])))
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
