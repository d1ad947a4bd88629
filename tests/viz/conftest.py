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
    phase: np.ndarray
    foot_contact: np.ndarray
    foot_force: np.ndarray
    pressure_centre: np.ndarray
    foothold: np.ndarray
    touch_downs: tuple[np.ndarray, np.ndarray]
    qpos: np.ndarray
    hand_target_world: np.ndarray
    arm_target: np.ndarray
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
    # Half a second on each foot, the left one first; the foot in the air has a foothold.
    phase = time % 1.0
    contact = np.stack((phase >= 0.5, phase < 0.5), axis=1)
    feet = position[:, None] + np.array([[0.05, 0.2, -0.95], [0.05, -0.2, -0.95]])
    return Run(
        name=name,
        time=time,
        command=np.tile([0.5, 0, 0.4, 2.0, 0.15, 0, 0.1, 0], (count, 1)),
        gait=np.full(count, Gait.WALKING),
        measured=np.tile([0.5, 0, 0.4, -0.03, 0.1, 0], (count, 1)) + 0.01 * rng.normal(size=(count, 6)),
        clearance=np.abs(rng.normal(size=(count, 2))) * 0.1,
        phase=phase,
        foot_contact=contact,
        foot_force=np.where(contact[..., None], [0.0, 30.0, 500.0], 0.0),
        pressure_centre=np.where(contact[..., None], feet, np.nan),
        foothold=np.where(contact[..., None], np.nan, feet[..., :2] + 0.1),
        touch_downs=(np.arange(0.5, seconds, 1.0), np.arange(1.0, seconds, 1.0)),
        qpos=np.hstack((position, orientation, joints)),
        hand_target_world=targets,
        arm_target=np.where(np.isfinite(targets[:, 0, :1]), joints[:, ROBOT.arms] + 0.1, np.nan),
        hand_error=np.linalg.norm(targets - position[:, None], axis=2),
        torque=rng.normal(size=(count, 19)),
        fell=fell,
    )


@pytest.fixture
def make_run() -> Callable[..., Run]:
    """Makes a run of `seconds`, with hand targets in its second half unless `hands` is False."""
    return _run
