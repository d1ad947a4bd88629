"""Made-up records of episodes: everything stands still as drawn, but for what a test changes."""

import dataclasses
from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from hugwbc.sim import Scene
from hugwbc.tasks import Ending, TaskRecord
from hugwbc.tasks.task import scene_of

SAMPLES = 1000  # 20 s


def _record(name: str | Scene, **changes) -> TaskRecord:
    """Return a record in a scene, or in that of a task; changes are fields of the record."""
    scene = (scene_of(name) if isinstance(name, str) else name).draw(3)
    model = scene.model()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    poses = {}
    for body in scene.body_names:
        pose = np.concatenate((data.body(body).xpos, data.body(body).xquat))
        poses[body] = np.tile(pose, (SAMPLES, 1))
    jointed = {"button", "drawer", "door"} & set(scene.body_names)
    pelvis = np.tile([0.0, 0.0, 0.98, 1.0, 0.0, 0.0, 0.0], (SAMPLES, 1))
    still = TaskRecord(
        scene=scene,
        time=np.arange(SAMPLES) / 50,
        pelvis=pelvis,
        hands=np.tile([[0.3, 0.2, 1.0], [0.3, -0.2, 1.0]], (SAMPLES, 1, 1)),
        hand_force=np.zeros((SAMPLES, 2, 3)),
        hand_touches=np.zeros((SAMPLES, 2), dtype=bool),
        poses=poses,
        travel={body: np.zeros(SAMPLES) for body in jointed},
        gait=np.full(SAMPLES, -1),
        held=np.full((SAMPLES, 2), -1),
        touched={},
        lasted={},
        depth={},
        fell=False,
        ending=Ending(True, "", 19.0),
    )
    return dataclasses.replace(still, **changes)


@pytest.fixture
def made_up() -> Callable[..., TaskRecord]:
    """A function that gives the record of an episode in which nothing happens, with changes."""
    return _record
