import numpy as np
import pytest
import torch

from hugwbc.commands import Command
from hugwbc.gait import Gait
from hugwbc.learned.policy import critic_observations as obs
from hugwbc.learned.policy.terms import (
    ACTION,
    COMMAND,
    CRITIC_CORE,
    ESTIMATE,
    FRAME,
    HISTORY,
    HISTORY_FRAMES,
    PRIVILEGED,
    TERRAIN_SIZE,
    Sensed,
    observe,
    size_of,
)
from hugwbc.robot import Robot, load_mirror, load_robot
from hugwbc.state import RobotState
from tests.conftest import mirror_command, mirror_state

ROBOT, G1 = load_robot(), load_robot("g1")


def test_sizes_are_the_paper_s() -> None:
    parts = (FRAME, COMMAND, PRIVILEGED, ESTIMATE)
    assert [size_of(part, ROBOT) for part in parts] == [63, 18, 40, 6] and TERRAIN_SIZE == 221
    assert 8 + len(Gait) + 2 * 2 + 1 == 18 and size_of(CRITIC_CORE, ROBOT) == 63 + 18 + 40


def test_terrain_points_span_the_published_grid() -> None:
    points = obs.terrain_points()
    assert points.shape == (221, 2)
    assert points.min(0).values.tolist() == pytest.approx([-0.42, -0.42])
    assert points.max(0).values.tolist() == pytest.approx([0.70, 0.42])
    mirror = obs.terrain_mirror()
    torch.testing.assert_close(points[mirror.index], points * torch.tensor([1.0, -1.0]))
    assert (mirror.sign == 1.0).all()


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
    return torch.from_numpy(observe(FRAME, sensed(state, action, Command(), 0.0, robot)))


@pytest.mark.parametrize("robot", [ROBOT, G1], ids=lambda robot: robot.name)
def test_mirror_of_a_frame_is_the_frame_of_the_mirrored_robot(robot: Robot) -> None:
    rng = np.random.default_rng(0)
    mirror = load_mirror(robot)
    for _ in range(20):
        state, action = random_frame(rng, len(robot.joint_names))
        expected = frame_of(mirror_state(state, mirror), mirror.joints(action), robot).repeat(1, HISTORY_FRAMES)
        history = frame_of(state, action, robot).repeat(1, HISTORY_FRAMES)
        torch.testing.assert_close(obs.mirror(HISTORY, robot)(history), expected)
        torch.testing.assert_close(
            obs.mirror(ACTION, robot)(torch.tensor(action)[None].float())[0],
            torch.tensor(mirror.joints(action), dtype=torch.float32),
        )


def command_row(command: Command, phase: float) -> torch.Tensor:
    state, action = random_frame(np.random.default_rng(0))
    return torch.from_numpy(observe(COMMAND, sensed(state, action, command, phase)))


@pytest.mark.parametrize(("gait", "phase"), [(Gait.WALKING, 0.8), (Gait.HOPPING_LEFT, 0.3)])
def test_mirror_of_a_command_is_the_observation_of_the_mirrored_command(gait: Gait, phase: float) -> None:
    command = Command(v_x=0.3, v_y=-0.2, omega=0.4, f=2.5, l=0.2, h=-0.1, p=0.2, w=0.7, gait=gait)
    row = command_row(command, 0.3)
    torch.testing.assert_close(obs.mirror(COMMAND, ROBOT)(row), command_row(mirror_command(command), phase))


def test_no_two_gaits_or_phases_look_alike() -> None:
    """Jumps and hops had equal observations at phase 0.75, and no phase was told from 0.5 minus itself."""
    rows = [command_row(Command(), 0.25)]
    for gait in (Gait.WALKING, Gait.JUMPING, Gait.HOPPING_LEFT, Gait.HOPPING_RIGHT):
        for phase in (0.0, 0.05, 0.2, 0.45, 0.75):
            rows.append(command_row(Command(gait=gait), phase))
    rows = torch.cat(rows)
    assert (torch.cdist(rows, rows) + 10.0 * torch.eye(len(rows))).min() > 0.2
