import dataclasses

import pytest

from hugwbc.learned.config import CurriculumConfig
from hugwbc.learned.env.curriculum import Curriculum
from hugwbc.robot import load_robot

CONFIG = CurriculumConfig(
    warm_up_iterations=2,
    alpha_interval=1,
    speed_interval=1,
    linear_threshold=0.7,
    angular_threshold=0.5,
    speed_threshold=0.7,
)


def started() -> Curriculum:
    curriculum = Curriculum(CONFIG, load_robot())
    for _ in range(2):
        curriculum.update((1.0, 1.0), (1.0, 1.0))
    return curriculum


def test_nothing_moves_during_warm_up() -> None:
    curriculum = started()
    assert (curriculum.alpha, curriculum.max_speed, curriculum.penalty_scale) == (0.0, 0.6, 0.2)
    assert "warm-up" in curriculum.gates["alpha"]


@pytest.mark.parametrize(
    ("rewards", "change", "gate"),
    [
        ((0.71, 0.51), 0.01, "open"),
        ((0.6, 0.51), 0.0, "closed: linear velocity reward 0.60 < 0.70"),
        ((0.46, 0.9), -0.01, "falling: linear velocity reward 0.46 < 0.70"),  # below two thirds of it
        ((0.9, 0.33), -0.01, "falling: angular velocity reward 0.33 < 0.50"),
    ],
)
def test_alpha_rises_holds_or_falls_by_both_rewards_and_says_why(rewards, change, gate):
    curriculum = started()
    curriculum.alpha = 0.5
    curriculum.update((0.0, 0.0), rewards)
    assert curriculum.alpha == pytest.approx(0.5 + change)
    assert curriculum.gates["alpha"].startswith(gate)


def test_speed_grows_to_the_paper_s_limit() -> None:
    curriculum = started()
    for _ in range(200):
        curriculum.update((0.9, 0.9), (0.0, 0.0))
    assert curriculum.max_speed == 2.0
    assert curriculum.max_yaw_rate == pytest.approx(1.0)
    curriculum.update((0.1, 0.9), (0.0, 0.0))
    assert "0.10 < 0.70" in curriculum.gates["speed"]


def test_a_robot_that_cannot_get_faster_turns_at_once() -> None:
    ranges = {"v_x": {"initial": (-0.5, 0.5), "finishing": (-0.5, 0.5)}}
    curriculum = Curriculum(CONFIG, dataclasses.replace(load_robot(), commands=ranges))
    assert (curriculum.max_speed, curriculum.max_yaw_rate) == (0.5, 1.0)


def test_without_intervention_alpha_rests() -> None:
    curriculum = started()
    curriculum.update((0.9, 0.9), None)
    assert curriculum.alpha == 0.0 and curriculum.gates["alpha"] == "off: no intervention"


def test_state_survives_a_round_trip() -> None:
    curriculum = started()
    curriculum.update((0.9, 0.9), (0.9, 0.9))
    other = Curriculum(CONFIG, load_robot())
    other.load_state_dict(curriculum.state_dict())
    assert other.state_dict() == curriculum.state_dict()


def test_without_agile_robots_the_speed_rests() -> None:
    curriculum = started()
    curriculum.update(None, (0.9, 0.9))
    assert curriculum.max_speed == 0.6 and curriculum.gates["speed"] == "off: no agile robots"
    assert curriculum.alpha == pytest.approx(0.01)
