"""What several verbs are tested with: a small task of one's own."""

import pathlib
from collections.abc import Callable

import pytest


@pytest.fixture
def standing_task(tmp_path: pathlib.Path) -> Callable[[str], pathlib.Path]:
    """Return a writer of a file with a task, in which the robot stands before a wall, and its only milestone."""

    def write(milestone: str) -> pathlib.Path:
        path = tmp_path / "stand.py"
        path.write_text(
            "from hugwbc.behaviours import wait\n"
            "from hugwbc.sim import Scene\n"
            "from hugwbc.sim.scenes import Wall\n"
            "from hugwbc.tasks import Milestone, Task\n"
            "scene = Scene((Wall(name='wall', position=(2.0, 0.0)),))\n"
            "TASK = Task(name='stand', about='Stand.', scene=scene, limit=3.0,\n"
            "    behaviour=lambda view, shapes: wait(view, 0.1),\n"
            f"    milestones=({milestone},))\n"
        )
        return path

    return write
