"""A made-up run, short and cheap, for the pictures."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from hugwbc import Gait, load_robot, rotations

ROBOT = load_robot()


@dataclasses.dataclass(frozen=True)
class Run:
    name: str
    time: np.ndarray
    command: np.ndarray
    gait: np.ndarray
    measured: np.ndarray
    clearance: np.ndarray
    qpos: np.ndarray
    hand_target_world: np.ndarray
    hand_error: np.ndarray
    torque: np.ndarray
    fell: bool


def _run(name: str = "qp", seconds: float = 1.0, seed: int = 0, *, hands: bool = True, fell: bool = False) -> Run:
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * 50)) / 50
    count = len(time)
    orientation = np.array([rotations.from_yaw_pitch_roll(yaw, 0.1, 0.0) for yaw in 0.4 * time])
    position = np.column_stack((0.5 * time, np.zeros(count), np.full(count, 0.95)))
    joints = ROBOT.nominal + 0.2 * np.sin(time)[:, None] * rng.uniform(-1, 1, 19)
    targets = position[:, None] + rng.uniform(0.2, 0.4, (count, 2, 3))
    targets[: count // 2] = np.nan
    if not hands:
        targets[:] = np.nan
    return Run(
        name=name,
        time=time,
        command=np.tile([0.5, 0, 0.4, 2.0, 0.15, 0, 0.1, 0], (count, 1)),
        gait=np.full(count, Gait.WALKING),
        measured=np.tile([0.5, 0, 0.4, -0.03, 0.1, 0], (count, 1)) + 0.01 * rng.normal(size=(count, 6)),
        clearance=np.abs(rng.normal(size=(count, 2))) * 0.1,
        qpos=np.hstack((position, orientation, joints)),
        hand_target_world=targets,
        hand_error=np.linalg.norm(targets - position[:, None], axis=2),
        torque=rng.normal(size=(count, 19)),
        fell=fell,
    )


@pytest.fixture
def make_run() -> Callable[..., Run]:
    """Makes a run of `seconds`, with hand targets in its second half unless `hands` is False."""
    return _run
