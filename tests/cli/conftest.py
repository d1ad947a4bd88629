"""What several verbs are tested with: a small task of one's own, and a signal in the middle of the learning."""

import os
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


@pytest.fixture
def signal_while_fitting(monkeypatch: pytest.MonkeyPatch) -> Callable[[type, int], None]:
    """Return what makes a class that learns from labels receive a signal whenever it fits."""

    def arrange(learner: type, number: int) -> None:
        fit = learner.fit

        def fit_and_stop(self: object) -> dict[str, float]:
            os.kill(os.getpid(), number)
            return fit(self)

        monkeypatch.setattr(learner, "fit", fit_and_stop)

    return arrange
