import pytest
import torch

from hugwbc.gait import Gait
from hugwbc.learned.config import CommandConfig, CurriculumConfig, EnvConfig
from hugwbc.learned.env.command_sampling import draw_commands
from hugwbc.learned.env.curriculum import CELLS, Curriculum, SpeedGrid
from hugwbc.learned.env.humanoid_env import HumanoidEnv

CONFIG = CurriculumConfig(
    warm_up_iterations=2,
    alpha_interval=1,
    speed_interval=1,
    linear_threshold=0.7,
    angular_threshold=0.5,
    speed_threshold=0.7,
)


def started() -> Curriculum:
    curriculum = Curriculum(CONFIG)
    for _ in range(2):
        curriculum.update((1.0, 1.0), (1.0, 1.0))
    return curriculum


def test_nothing_moves_during_warm_up() -> None:
    curriculum = started()
    assert (curriculum.alpha, curriculum.max_speed, curriculum.penalty_scale) == (0.0, 0.6, 0.2)
    assert "warm-up" in curriculum.gates["alpha"]


def test_alpha_rises_when_both_rewards_pass() -> None:
    curriculum = started()
    curriculum.update((0.0, 0.0), (0.71, 0.51))
    assert curriculum.alpha == pytest.approx(0.01)
    assert curriculum.gates["alpha"] == "open"


def test_alpha_holds_between_the_thresholds_and_says_why() -> None:
    curriculum = started()
    curriculum.alpha = 0.5
    curriculum.update((0.0, 0.0), (0.6, 0.51))
    assert curriculum.alpha == 0.5
    assert curriculum.gates["alpha"] == "closed: linear velocity reward 0.60 < 0.70"


@pytest.mark.parametrize("rewards", [(0.46, 0.9), (0.9, 0.33)])
def test_alpha_falls_below_two_thirds_of_either(rewards: tuple[float, float]) -> None:
    curriculum = started()
    curriculum.alpha = 0.5
    curriculum.update((0.0, 0.0), rewards)
    assert curriculum.alpha == pytest.approx(0.49)


def test_speed_grows_to_the_paper_s_limit() -> None:
    curriculum = started()
    for _ in range(200):
        curriculum.update((0.9, 0.9), (0.0, 0.0))
    assert curriculum.max_speed == 2.0
    assert curriculum.max_yaw_rate == pytest.approx(1.0)
    curriculum.update((0.1, 0.9), (0.0, 0.0))
    assert "0.10 < 0.70" in curriculum.gates["speed"]


def test_noise_and_speed_wait_for_the_terrain_and_say_so() -> None:
    curriculum = started()
    curriculum.update((0.9, 0.9), (0.9, 0.9), terrain_mastered=False)
    assert (curriculum.alpha, curriculum.max_speed) == (0.0, 0.6)
    assert curriculum.gates["alpha"] == curriculum.gates["speed"] == "closed: waits for the terrain"
    assert curriculum.penalty_scale > 0.2


def test_without_intervention_alpha_rests() -> None:
    curriculum = started()
    curriculum.update((0.9, 0.9), None)
    assert curriculum.alpha == 0.0 and curriculum.gates["alpha"] == "off: no intervention"


def test_state_survives_a_round_trip() -> None:
    curriculum = started()
    curriculum.update((0.9, 0.9), (0.9, 0.9))
    other = Curriculum(CONFIG)
    other.load_state_dict(curriculum.state_dict())
    assert other.state_dict() == curriculum.state_dict()


def test_without_agile_robots_the_speed_rests() -> None:
    curriculum = started()
    curriculum.update(None, (0.9, 0.9))
    assert curriculum.max_speed == 0.6 and curriculum.gates["speed"] == "off: no agile robots"
    assert curriculum.alpha == pytest.approx(0.01)


GRID = CurriculumConfig(speed="grid", warm_up_iterations=0, speed_interval=1, agile_fraction=1.0)
THRESHOLDS = (0.75, 0.4)
WALKING, JUMPING = int(Gait.WALKING), int(Gait.JUMPING)


def judge(grid: SpeedGrid, gait: int, v_x: float, omega: float, tracking: tuple[float, float] = (0.9, 0.9)) -> None:
    grid.judge(torch.tensor([gait]), torch.tensor([[v_x, omega]]), torch.tensor([tracking]), THRESHOLDS)


def test_the_first_cells_are_the_papers_initial_range() -> None:
    grid = SpeedGrid.up_to(0.6, 0.6)
    assert grid.weight.shape == (2, *CELLS) == (2, 13, 10)
    assert grid.weight.sum().item() == 2 * 36 and grid.weight[:, :6, 2:8].all()
    assert grid.max_speed == pytest.approx(0.6)


def test_draws_are_uniform_over_open_cells_and_follow_the_weights() -> None:
    grid = SpeedGrid.up_to(0.6, 0.6)
    grid.weight[1, 12, 9] = 0.5  # v_x 1.8 to 2, omega 0.8 to 1, jumping only
    gait = torch.full((40_000,), WALKING)
    gait[20_000:] = JUMPING
    speed = grid.draw(gait, torch.Generator().manual_seed(0))
    walking, jumping = speed[:20_000], speed[20_000:]
    assert walking.abs().max() <= 0.6 + 1e-6
    for column in walking.T:
        counts = torch.histc(column, bins=6, min=-0.6, max=0.6)
        assert (counts / 20_000 - 1 / 6).abs().max() < 0.015
    fast = jumping[:, 0] > 0.7
    assert fast.float().mean().item() == pytest.approx(0.5 / 36.5, abs=0.003)
    assert jumping[fast].min(0).values.tolist() >= [1.8, 0.8] and jumping[fast].max(0).values[0] <= 2.0


def test_a_cell_that_is_tracked_opens_its_neighbours_of_its_own_gait() -> None:
    grid = SpeedGrid.up_to(0.6, 0.6)
    judge(grid, WALKING, 0.55, 0.5)
    grid.update()
    opened = (grid.weight[0, 6] > 0.0).nonzero().flatten().tolist()
    assert opened == [6, 7, 8]  # omega from 0.2 to 0.8, at v_x from 0.6 to 0.8
    assert grid.weight[0, 6, 7].item() == pytest.approx(0.2)
    assert grid.weight[0, :6, 2:8].max() == 1.0 and grid.weight[1].sum() == 36
    assert grid.max_speed == pytest.approx(0.8)
    for _ in range(9):
        judge(grid, WALKING, 0.55, 0.5)
        grid.update()
    assert grid.weight[0, 6, 7] == 1.0


def test_cells_stay_shut_and_the_gate_says_why() -> None:
    grid = SpeedGrid.up_to(0.6, 0.6)
    judge(grid, WALKING, 0.55, 0.5, (0.32, 0.9))
    judge(grid, JUMPING, 0.55, 0.5, (0.0, 0.0))
    judge(grid, int(Gait.STANDING), 0.0, 0.0)
    judge(grid, WALKING, 0.1, 0.0)
    grid.update()
    assert grid.weight.sum() == 72
    expected = "walking 36 of 130 cells, jumping 36 of 130 cells; 1 of 3 commands passed"
    assert grid.report(THRESHOLDS) == f"{expected}, the others' linear velocity reward 0.16 < 0.75"
    assert grid.report(THRESHOLDS).endswith("0 of 0 commands passed")


def test_the_agile_group_draws_from_the_grid_and_hopping_does_not() -> None:
    curriculum = Curriculum(GRID)
    assert curriculum.grid is not None
    curriculum.grid.weight.zero_()
    curriculum.grid.weight[:, 10, 3] = 1.0  # v_x 1.4 to 1.6, omega -0.4 to -0.2
    agile = torch.arange(2000) < 1000
    mix = CommandConfig(standing_fraction=0.2, walking_fraction=0.3, hopping_fraction=0.3, zero_velocity_fraction=0.0)
    command, gait = draw_commands(agile, mix, curriculum, torch.Generator().manual_seed(0))
    moving = (gait == WALKING) | (gait == JUMPING)
    fast = command[moving & agile]
    assert fast.shape[0] > 400 and (fast[:, 0] >= 1.4 - 1e-6).all() and (fast[:, 0] <= 1.6 + 1e-6).all()
    assert (fast[:, 2] >= -0.4 - 1e-6).all() and (fast[:, 2] <= -0.2 + 1e-6).all()
    assert (command[~(moving & agile), 0] <= 0.6).all()


def test_the_environment_judges_commands_that_end() -> None:
    env = HumanoidEnv(EnvConfig(count=6, curriculum=GRID), seed=0, threads=1)
    grid = env.curriculum.grid
    assert grid is not None
    env.gait[:] = torch.tensor([WALKING, WALKING, JUMPING, WALKING, WALKING, int(Gait.STANDING)])
    env.command[:, 0], env.command[:, 2] = 0.5, 0.1
    env.statistics.tracking[:] = 1.0
    env.statistics.tracking[1] = 0.1
    env.age[:] = torch.tensor([299, 299, 999, 10, 10, 299])
    env.simulation.qpos[4, 3:7] = [0.7, 0.0, 0.7, 0.0]  # falls
    env.step(torch.zeros(6, 19))
    assert grid.passed.sum() == 2 and grid.passed[0, 5, 5] == 1 and grid.passed[1, 5, 5] == 1
    env.update_curriculum()
    assert env.curriculum.gates["speed"].startswith("walking 39 of 130 cells, jumping 39 of 130 cells; 2 of 4 commands")
    assert env.curriculum.max_speed == pytest.approx(0.8)


def test_the_grid_is_part_of_the_checkpoint_and_of_a_snapshot() -> None:
    env, other = (HumanoidEnv(EnvConfig(count=4, curriculum=GRID), seed=0, threads=1) for _ in range(2))
    assert env.curriculum.grid is not None and other.curriculum.grid is not None
    judge(env.curriculum.grid, WALKING, 0.55, 0.5)
    env.curriculum.grid.update()
    other.load_state_dict({name: value.clone() for name, value in env.state_dict().items()})
    assert torch.equal(other.curriculum.grid.weight, env.curriculum.grid.weight)
    snapshot = Curriculum(GRID)
    snapshot.load_state_dict(env.curriculum.state_dict())
    assert snapshot.grid is not None and torch.equal(snapshot.grid.weight, env.curriculum.grid.weight)


def test_a_run_with_one_range_goes_on_with_the_cells_that_it_had_reached() -> None:
    ranged = Curriculum(CurriculumConfig())
    ranged.max_speed = 1.3
    gridded = Curriculum(GRID)
    gridded.load_state_dict(ranged.state_dict())
    assert gridded.grid is not None and gridded.grid.max_speed == pytest.approx(1.4)
    assert gridded.grid.weight[0, :10].any(1).all() and not gridded.grid.weight[0, 10:].any()


def test_what_was_judged_since_the_last_update_is_part_of_the_checkpoint() -> None:
    curriculum, resumed = Curriculum(GRID), Curriculum(GRID)
    assert curriculum.grid is not None and resumed.grid is not None
    judge(curriculum.grid, WALKING, 0.55, 0.5)
    resumed.load_state_dict(curriculum.state_dict())
    for one in (curriculum, resumed):
        one.update((0.0, 0.0), None)
    assert torch.equal(resumed.grid.weight, curriculum.grid.weight)
    assert resumed.max_speed == pytest.approx(0.8)
