import numpy as np
import pytest
import torch

from hugwbc.commands import Command
from hugwbc.gait import Gait
from hugwbc.learned.policy import critic_observations as obs
from hugwbc.learned.policy.terms import Sensed, observe
from hugwbc.robot import Robot, load_mirror, load_robot
from hugwbc.state import RobotState
from tests.conftest import mirror_command, mirror_state

ROBOT, G1 = load_robot(), load_robot("g1")


def test_sizes_are_the_paper_s() -> None:
    parts = (obs.FRAME, obs.COMMAND, obs.PRIVILEGED, obs.ESTIMATE)
    assert [obs.size_of(part, ROBOT) for part in parts] == [63, 18, 40, 6] and obs.TERRAIN_SIZE == 221
    assert 8 + len(Gait) + 2 * 2 + 1 == 18 and obs.size_of(obs.CRITIC_CORE, ROBOT) == 63 + 18 + 40


def test_sizes_are_those_of_29_joints_and_9_links_for_a_g1() -> None:
    parts = (obs.FRAME, obs.COMMAND, obs.PRIVILEGED, obs.ESTIMATE)
    assert [obs.size_of(part, G1) for part in parts] == [3 + 3 + 3 * 29, 18, 29 + 9, 6]


def test_the_privileged_observation_has_what_is_declared() -> None:
    n = 2
    rows = obs.privileged(
        torch.zeros(n, 3), torch.zeros(n), torch.zeros(n, 2), torch.zeros(n), torch.zeros(n, 2, 3),
        torch.zeros(n, 11, dtype=torch.bool), torch.zeros(n, 3), torch.zeros(n, 11), torch.zeros(n, 2),
    )  # fmt: skip
    assert rows.shape == (n, obs.size_of(obs.PRIVILEGED, ROBOT))


def test_terrain_points_span_the_published_grid() -> None:
    points = obs.terrain_points()
    assert points.shape == (221, 2)
    assert points.min(0).values.tolist() == pytest.approx([-0.42, -0.42])
    assert points.max(0).values.tolist() == pytest.approx([0.70, 0.42])


def random_frame(rng: np.random.Generator, joints: int = 19) -> tuple[RobotState, np.ndarray]:
    orientation = rng.normal(size=4)
    state = RobotState(
        q=rng.normal(size=joints),
        dq=rng.normal(size=joints),
        orientation=orientation / np.linalg.norm(orientation),
        angular_velocity=rng.normal(size=3),
    )
    return state, rng.normal(size=joints)


def sensed(state: RobotState, action: np.ndarray, command: Command, phase: float, robot: Robot = ROBOT) -> Sensed:
    rows = (state.angular_velocity, state.projected_gravity, state.q, state.dq, action, command.array())
    told = {"gait": np.array([int(command.gait)]), "phase": np.array([phase]), "indicator": np.array([True])}
    return Sensed(*(row[None] for row in rows), **told, pose=robot.nominal)


def frame_of(state: RobotState, action: np.ndarray, robot: Robot) -> torch.Tensor:
    return torch.from_numpy(observe(obs.FRAME, sensed(state, action, Command(), 0.0, robot)))


@pytest.mark.parametrize("robot", [ROBOT, G1], ids=lambda robot: robot.name)
def test_mirror_of_a_frame_is_the_frame_of_the_mirrored_robot(robot: Robot) -> None:
    rng = np.random.default_rng(0)
    mirror = load_mirror(robot)
    for _ in range(20):
        state, action = random_frame(rng, len(robot.joint_names))
        expected = frame_of(mirror_state(state, mirror), mirror.joints(action), robot).repeat(1, obs.HISTORY_FRAMES)
        history = frame_of(state, action, robot).repeat(1, obs.HISTORY_FRAMES)
        torch.testing.assert_close(obs.mirror(obs.HISTORY, robot)(history), expected)
        torch.testing.assert_close(
            obs.mirror(obs.ACTION, robot)(torch.tensor(action)[None].float())[0],
            torch.tensor(mirror.joints(action), dtype=torch.float32),
        )


def command_row(command: Command, phase: float) -> torch.Tensor:
    state, action = random_frame(np.random.default_rng(0))
    return torch.from_numpy(observe(obs.COMMAND, sensed(state, action, command, phase)))


def test_mirror_of_a_command_is_the_observation_of_the_mirrored_command() -> None:
    command = Command(v_x=0.3, v_y=-0.2, omega=0.4, f=2.5, l=0.2, h=-0.1, p=0.2, w=0.7, gait=Gait.WALKING)
    row = command_row(command, 0.3)
    torch.testing.assert_close(obs.mirror(obs.COMMAND, ROBOT)(row), command_row(mirror_command(command), 0.8))


def test_hopping_on_one_leg_mirrors_to_hopping_on_the_other() -> None:
    command = Command(v_y=0.2, omega=-0.3, gait=Gait.HOPPING_LEFT)
    mirrored = obs.mirror(obs.COMMAND, ROBOT)(command_row(command, 0.1))
    torch.testing.assert_close(mirrored, command_row(mirror_command(command), 0.1))


def test_standing_is_told_from_a_jump_at_mid_stance() -> None:
    standing = command_row(Command(gait=Gait.STANDING), 0.25)
    jumping = command_row(Command(gait=Gait.JUMPING), 0.25)
    assert not torch.equal(standing, jumping)


def test_no_two_gaits_or_phases_look_alike() -> None:
    """Jumps and hops had equal observations at phase 0.75, and no phase was told from 0.5 minus itself."""
    rows = []
    for gait in (Gait.WALKING, Gait.JUMPING, Gait.HOPPING_LEFT, Gait.HOPPING_RIGHT):
        for phase in (0.0, 0.05, 0.2, 0.45, 0.75):
            rows.append(command_row(Command(gait=gait), phase))
    rows = torch.cat(rows)
    assert (torch.cdist(rows, rows) + 10.0 * torch.eye(len(rows))).min() > 0.2
