import dataclasses
import pathlib

import numpy as np
import pytest
import torch

from hugwbc.commands import Command
from hugwbc.controller import JointCommand, UpperBody
from hugwbc.errors import ConfigError
from hugwbc.gait import Gait
from hugwbc.learned.config import CommandConfig, EnvConfig, ImitationConfig, TrainConfig
from hugwbc.learned.env.starts import STARTS_FILE, RecordedStarts
from hugwbc.learned.imitation import imitation
from hugwbc.learned.imitation.imitation import Imitator, equivalent_targets
from hugwbc.learned.policy import load_policy
from hugwbc.learned.rl.cloning import LABELS_FILE, Labels
from hugwbc.learned.rl.trainer import SNAPSHOT_NAME, Trainer
from hugwbc.robot import load_robot
from hugwbc.state import RobotState

ROBOT = load_robot()


class Bow:
    """Stands with a hip pitch in proportion to the commanded pitch; counts its resets."""

    phase = 0.25
    stepping = False

    def __init__(self) -> None:
        self.resets = 0

    def reset(self, state: RobotState) -> None:
        self.resets += 1

    def act(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand:
        q = ROBOT.nominal.copy()
        q[ROBOT.indices(["left_hip_pitch_joint", "right_hip_pitch_joint"])] -= command.p
        return JointCommand.position(ROBOT, q)


def make_config(**changes: object) -> ImitationConfig:
    # Many commands in few samples: a student that sees ten of them learns these ten only.
    standing = CommandConfig(standing_fraction=1.0, walking_fraction=0.0, default_fraction=0.0, resample_steps=20)
    env = EnvConfig(count=4, command=standing, yaw_damping_factor=1.0)
    return dataclasses.replace(ImitationConfig(samples=1600, batch=256, env=env), **changes)  # type: ignore[arg-type]


def test_targets_give_the_torque_that_the_command_asks_for() -> None:
    rng = np.random.default_rng(0)
    command = JointCommand(*rng.normal(size=(5, 19)))
    command = dataclasses.replace(command, kp=ROBOT.kp, kd=2.0 * ROBOT.kd)
    target = equivalent_targets(command, ROBOT, 2.0 * ROBOT.kd)
    for _ in range(3):
        q, dq = rng.normal(size=(2, 19))
        asked = command.tau + command.kp * (command.q - q) + command.kd * (command.dq - dq)
        np.testing.assert_allclose(ROBOT.kp * (target - q) - 2.0 * ROBOT.kd * dq, asked, atol=1e-9)


def test_a_student_learns_what_the_teacher_does(tmp_path: pathlib.Path) -> None:
    teachers: list[Bow] = []

    def make(period: float) -> Bow:
        assert period == pytest.approx(0.02)
        teachers.append(Bow())
        return teachers[-1]

    imitator = Imitator(make_config(out=tmp_path, updates=60, learning_rate=2e-3, keep_labels=True), make)
    rows: list[dict[str, float]] = []
    imitator.run(rows.append)
    assert len(teachers) == 4 and imitator.samples == 1600
    assert rows[-1]["imitation_loss"] < 0.2 * rows[0]["imitation_loss"]
    labels = Labels(tmp_path / LABELS_FILE, imitator.network, torch.Generator().manual_seed(0))
    assert labels.count == 1600
    # Robots that it never saw, which the teacher drives: history and command fit together.
    others = Imitator(make_config(seed=77), make)
    for _ in range(200):
        others.collect()
    seen = others.memory.columns()
    with torch.no_grad():
        action, _ = imitator.network.actor(seen["history"], seen["command"])
    hips = ROBOT.indices(["left_hip_pitch_joint", "right_hip_pitch_joint"])
    p = seen["command"][:, 6].numpy() / 2.0
    assert p.std() > 0.1
    for hip in hips:
        student, teacher = action[:, hip].numpy(), seen["action"][:, hip].numpy()
        # Both hip pitches go back by p; an action of 1 is 0.25 rad.
        assert np.polyfit(p, teacher, 1) == pytest.approx([-1.0 / 0.25, 0.0], abs=1e-4)
        slope, offset = np.polyfit(p, student, 1)
        assert slope == pytest.approx(-1.0 / 0.25, rel=0.1)
        assert offset == pytest.approx(0.0, abs=0.1)
        assert np.mean((student - teacher) ** 2) < 0.1 * np.var(teacher)
    assert load_policy(tmp_path).training["steps"] == 1600
    trainer = Trainer(TrainConfig(out=tmp_path / "run", start_from=tmp_path / SNAPSHOT_NAME, env=EnvConfig(count=2)))
    assert trainer.steps == 1600 and trainer.env.curriculum.penalty_scale == 1.0
    for name, value in imitator.network.state_dict().items():
        torch.testing.assert_close(trainer.ppo.network.state_dict()[name], value)


def test_teachers_start_anew_with_their_robots_and_arms_under_intervention_do_not_count() -> None:
    teachers = [Bow() for _ in range(4)]
    supply = iter(teachers)
    imitator = Imitator(make_config(), lambda period: next(supply))
    assert [teacher.resets for teacher in teachers] == [1, 1, 1, 1]
    imitator.env.intervention.active[1] = True
    _, weight = imitator._labels()
    assert torch.all(weight[1, ROBOT.arms] == 0.0) and torch.all(weight[0] > 0.0)
    imitator.env.simulation.qpos[2, 3:7] = [0.5**0.5, 0.5**0.5, 0.0, 0.0]  # lies on its side
    imitator.env.simulation.forward(np.array([2]))
    assert imitator.collect() == 1
    assert [teacher.resets for teacher in teachers] == [1, 1, 2, 1]


class Hopper(Bow):
    """Begins to step after 0.2 s, at its own phase."""

    def __init__(self) -> None:
        super().__init__()
        self.calls = 0

    def reset(self, state: RobotState) -> None:
        super().reset(state)
        self.calls = 0

    def act(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand:
        self.calls += 1
        self.stepping = self.calls > 10
        return super().act(state, command, upper_body)


def hopping_imitator(**changes: object) -> Imitator:
    hopping = CommandConfig(standing_fraction=0.0, walking_fraction=0.0, hopping_fraction=1.0)
    env = EnvConfig(count=20, command=hopping)
    imitator = Imitator(make_config(env=env, **changes), lambda period: Hopper())
    imitator.env.begin_episodes(torch.arange(20))
    return imitator


def test_robots_take_the_phase_of_teachers_that_step_alone() -> None:
    imitator = hopping_imitator()
    imitator.env.phase[:] = 0.6
    for _ in range(9):
        imitator._labels()
    assert (imitator.env.phase == 0.6).all()
    for _ in range(2):
        imitator._labels()
    assert (imitator.env.phase == Hopper.phase).all()


def test_the_student_drives_in_between_and_gives_back_a_hop_that_comes_down(monkeypatch: pytest.MonkeyPatch) -> None:
    down = torch.zeros(20, dtype=torch.bool)
    monkeypatch.setattr(imitation, "held_foot_down", lambda readings, gait: down)
    imitator = hopping_imitator(own_time=0.3, taught_time=0.1, samples=1e6, handover=1e-6)
    imitator.samples = 100
    own = []
    for _ in range(200):
        for teacher in imitator._teachers:
            teacher.stepping = True  # type: ignore[misc]
        imitator._hand_over()
        own.append(~imitator._taught)
    driven = torch.stack(own)
    assert not driven[:24].any(), "the teacher begins"
    assert driven[50:].float().mean() == pytest.approx(0.3 / 0.4, abs=0.07)
    down[:10] = True
    imitator._hand_over()
    assert imitator._taught[:10].all()
    for _ in range(30):
        imitator._hand_over()
    assert imitator._taught[:10].all() and not imitator._taught[10:].all()


def test_states_of_hops_are_recorded_to_start_from(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(imitation, "held_foot_down", lambda readings, gait: torch.zeros(20, dtype=torch.bool))
    imitator = hopping_imitator(out=tmp_path, starts=30, samples=1600, handover=1.0)
    imitator.run(lambda figures: None)
    starts = RecordedStarts.load(tmp_path / STARTS_FILE)
    assert len(starts.columns["gait"]) == 30
    assert (starts.columns["gait"] >= Gait.HOPPING_LEFT).all()


def test_labels_that_are_not_finite_are_left_out() -> None:
    class Broken(Bow):
        def act(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand:
            return JointCommand.position(ROBOT, np.full(19, np.nan))

    imitator = Imitator(make_config(), lambda period: Broken())
    imitator.collect()
    labels, weight = imitator._labels()
    assert torch.all(weight == 0.0) and torch.all(labels == 0.0)
    assert np.all(np.isfinite(imitator.env.simulation.qpos))


@pytest.mark.parametrize("change", [{"samples": 0.0}, {"least_taught": 2.0}, {"exploration": -1.0}, {"batch": 0}])
def test_settings_are_checked(change: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match=next(iter(change))):
        ImitationConfig(**change)  # type: ignore[arg-type]
