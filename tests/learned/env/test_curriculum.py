import dataclasses

import pytest
import torch

from hugwbc.commands import COMMAND_NAMES, command_ranges
from hugwbc.errors import ConfigError
from hugwbc.gait import Gait
from hugwbc.learned.config import CommandConfig, CurriculumConfig
from hugwbc.learned.env.curriculum import Curriculum, draw_commands, draw_gaits
from hugwbc.robot import Robot, load_robot

HOPPING = CommandConfig(standing_fraction=0.1, walking_fraction=0.0, hopping_fraction=0.9)
COUNT = 4000
CONFIG = CurriculumConfig(
    warm_up_iterations=2,
    alpha_interval=1,
    speed_interval=1,
    linear_threshold=0.7,
    angular_threshold=0.5,
    speed_threshold=0.7,
)


def started(robot: str = "h1") -> Curriculum:
    curriculum = Curriculum(CONFIG, load_robot(robot))
    for _ in range(2):
        curriculum.update((1.0, 1.0), (1.0, 1.0))
    return curriculum


def test_nothing_moves_during_warm_up() -> None:
    curriculum = started()
    assert (curriculum.alpha, curriculum.max_speed, curriculum.penalty_scale) == (0.0, 0.6, 0.2)
    assert curriculum.gates["alpha"] == "warm-up until 4.92e+04 steps", "2 times 24,576"


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


# As a G1 has shorter legs, its speeds are lower: at the same Froude number.
@pytest.mark.parametrize(("robot", "speed"), [("h1", 2.0), ("g1", 2.0 * (load_robot("g1").leg_length / 0.8) ** 0.5)])
def test_speed_grows_to_the_paper_s_limit(robot: str, speed: float) -> None:
    curriculum = started(robot)
    for _ in range(200):
        curriculum.update((0.9, 0.9), (0.0, 0.0))
    assert curriculum.max_speed == pytest.approx(speed, abs=0.005)
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


def draw(
    config: CommandConfig, *, max_speed: float = 0.6, robot: str | Robot = "h1"
) -> tuple[torch.Tensor, torch.Tensor]:
    curriculum = Curriculum(CurriculumConfig(), load_robot(robot) if isinstance(robot, str) else robot)
    curriculum.max_speed = max_speed
    agile = torch.arange(COUNT) % 2 == 0
    generator = torch.Generator().manual_seed(0)
    gait = draw_gaits(COUNT, config, generator)
    return draw_commands(gait, agile, config, curriculum, generator), gait


def share(gait: torch.Tensor, value: Gait) -> float:
    return (gait == value).float().mean().item()


def test_gaits_come_in_their_fractions() -> None:
    _, gait = draw(CommandConfig(standing_fraction=0.1, walking_fraction=0.3, hopping_fraction=0.4))
    expected = {
        Gait.STANDING: 0.1, Gait.WALKING: 0.3, Gait.JUMPING: 0.2, Gait.HOPPING_LEFT: 0.2, Gait.HOPPING_RIGHT: 0.2,
    }  # fmt: skip
    for value, fraction in expected.items():
        assert share(gait, value) == pytest.approx(fraction, abs=0.03)
    _, gait = draw(HOPPING)
    assert share(gait, Gait.JUMPING) == share(gait, Gait.WALKING) == 0.0
    _, gait = draw(CommandConfig())
    assert share(gait, Gait.HOPPING_LEFT) == share(gait, Gait.HOPPING_RIGHT) == 0.0


# Largest v_x, v_y and omega, lowest h, and the default l.
G1_HOPS = command_ranges(Gait.HOPPING_LEFT, load_robot("g1"))
G1_LARGEST = [G1_HOPS[name].initial[1] for name in ("v_x", "v_y", "omega")]


@pytest.mark.parametrize(
    ("robot", "largest", "lowest", "swing"),
    [("h1", [0.6, 0.6, 0.6], -0.3, 0.15), ("g1", G1_LARGEST, G1_HOPS["h"].initial[0], G1_HOPS["l"].default)],
)
def test_hopping_has_the_papers_command_space_whatever_the_speed_reached(
    robot: str, largest: list[float], lowest: float, swing: float
) -> None:
    command, gait = draw(HOPPING, max_speed=2.0, robot=robot)
    hopping = command[gait >= Gait.HOPPING_LEFT]
    assert (hopping[:, :3].abs() <= torch.tensor(largest)).all()
    # Uniform, not clamped from a wider range: no value piles up at the bound.
    assert hopping[:, 0].max() < largest[0] and hopping[:, 0].unique().numel() > 0.8 * hopping.shape[0]
    assert lowest <= hopping[:, 5].min() < 0.93 * lowest and hopping[:, 5].max() == 0.0
    defaults = torch.tensor([2.0, swing, 0.0, 0.0])
    torch.testing.assert_close(hopping[:, [3, 4, 6, 7]], defaults.expand(hopping.shape[0], 4))


def test_commands_reach_the_ends_of_a_robots_own_ranges() -> None:
    ends = {"h": (-0.25, 0.0), "v_x": (-1.0, 1.5), "v_y": (-0.3, 0.3), "omega": (-0.5, 1.0)}
    own = {name: {"initial": (0.4 * low, 0.4 * high), "finishing": (low, high)} for name, (low, high) in ends.items()}
    command, gait = draw(HOPPING, max_speed=1.5, robot=dataclasses.replace(load_robot("g1"), commands=own))
    hopping = command[gait >= Gait.HOPPING_LEFT]
    assert hopping[:, 0].unique().numel() > 0.8 * len(hopping), "no value piles up at the bound"
    mixed = CommandConfig(standing_fraction=0.0, walking_fraction=1.0)
    command, _ = draw(mixed, max_speed=1.5, robot=dataclasses.replace(load_robot("g1"), commands=own))
    for name, (low, high) in ends.items():
        column = command[:, COMMAND_NAMES.index(name)]
        assert low <= column.min() < 0.9 * low + 1e-6 and 0.9 * high - 1e-6 < column.max() <= high, name


def test_a_fraction_of_the_commands_combines_all_of_them() -> None:
    walking = CommandConfig(standing_fraction=0.0, walking_fraction=1.0)
    command, _ = draw(dataclasses.replace(walking, default_fraction=0.9, combined_fraction=0.25))
    drawn = (command[:, 3:] != torch.tensor([2.0, 0.15, 0.0, 0.0, 0.0])).sum(1)
    assert (drawn == 5).float().mean().item() == pytest.approx(0.25, abs=0.03)
    assert (drawn == 0).float().mean().item() == pytest.approx(0.75 * 0.9**5, abs=0.03)


def test_stands_combine_h_p_and_w_in_a_fraction_of_their_own() -> None:
    stands = CommandConfig(standing_fraction=1.0, walking_fraction=0.0, default_fraction=0.9)
    for own, expected in ((0.6, 0.6), (0.0, 0.0), (None, 0.3)):
        command, _ = draw(dataclasses.replace(stands, combined_fraction=0.3, combined_stands=own))
        combined = (command[:, 5:] != 0.0).all(1).float().mean().item()
        assert combined == pytest.approx(expected, abs=0.03)


def test_small_velocities_are_drawn_as_they_are() -> None:
    """Nothing between standing still and the range's ends is left out or zeroed."""
    command, gait = draw(CommandConfig())
    moving = (gait != Gait.STANDING) & (command[:, :3] != 0.0).any(1)
    speed = torch.linalg.vector_norm(command[moving, :2], dim=1)
    # Uniform over a square of 1.2 m/s: the ring from 0.1 to 0.3 m/s has 17 % of it, the disc within it 2 %.
    assert ((speed >= 0.1) & (speed <= 0.3)).float().mean().item() == pytest.approx(0.175, abs=0.025)
    assert (speed < 0.1).float().mean().item() == pytest.approx(0.022, abs=0.01)


def test_fractions_that_exceed_one_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"hopping sum to 1\.25; give at most 1"):
        dataclasses.replace(CommandConfig(), hopping_fraction=0.5)
