"""Draw the pictures of docs/tasks.md; `make task-pictures` runs this.

The QP does each task once. Its records are kept in out/tasks, so that another drawing of the same commit takes seconds.
"""

import dataclasses
import pathlib
import sys
import tempfile

import imageio.v2 as imageio
import numpy as np
from PIL import Image

from hugwbc.runtime import Trace, load_controller, read_trace, write_trace
from hugwbc.sim import Simulation
from hugwbc.source import short_commit
from hugwbc.tasks import load_task, run_task
from hugwbc.viz.marks import LAYERS
from hugwbc.viz.video import write_video

ROOT = pathlib.Path(__file__).parents[1]
RECORDS, IMAGES = ROOT / "out" / "tasks", ROOT / "docs" / "images" / "tasks"
SHOTS = {  # seed, and time of the picture [s]
    "press_button": (0, 11.0),
    "fetch_box": (0, 18.2),
    "deliver_box": (0, 40.0),
    "lift_from_stool": (0, 18.0),
    "push_cart": (0, 11.0),
    "open_drawer": (0, 12.0),
    "hold_payload": (0, 16.0),
    "open_door": (0, 10.0),
    "wipe_table": (0, 16.0),
    "carry_tray": (0, 20.0),
    "stack_boxes": (0, 21.0),
}
BELOW_CAPTION, MIDDLE = 60, slice(240, 1000)  # [pixel], rows and columns of a frame
WIDTH = 380  # [pixel]
QUALITY = 90  # of the pictures, from 1 to 100


def record(name: str) -> Trace:
    """Return the record of a task, from its file or by doing the task."""
    seed, _ = SHOTS[name]
    path = RECORDS / f"{name}-{seed}-{short_commit()}.npz"
    if not path.is_file():
        task = load_task(name)
        run = run_task(task, load_controller("qp"), Simulation(scene=task.scene, seed=seed))
        if not run.verdict.success:
            sys.exit(
                f"{name}, seed {seed}, is no picture of a success: {run.verdict.reason}; choose another seed in SHOTS"
            )
        RECORDS.mkdir(parents=True, exist_ok=True)
        write_trace(path, run.trace)
    return read_trace(path)


def still(trace: Trace, moment: float) -> np.ndarray:
    """Return the middle of a picture of one moment [s], shape (height, width, 3), uint8.

    Raises:
        RuntimeError: if this machine cannot render.
    """
    sample = min(int(np.searchsorted(trace.time, moment)), len(trace.time) - 1)
    fields = {field.name: getattr(trace, field.name) for field in dataclasses.fields(trace)}
    one = {
        name: value[sample : sample + 1]
        for name, value in fields.items()
        if isinstance(value, np.ndarray) and len(value) == len(trace.time)
    }
    with tempfile.TemporaryDirectory() as folder:
        film = pathlib.Path(folder) / "still.mp4"
        obstacle = write_video(film, [dataclasses.replace(trace, **one)], hide=tuple(LAYERS))
        if obstacle is not None:
            raise RuntimeError(obstacle)
        with imageio.get_reader(film) as reader:
            return np.asarray(reader.get_data(0))[BELOW_CAPTION:, MIDDLE]


def save(path: pathlib.Path, picture: np.ndarray) -> None:
    """Write a picture, scaled to `WIDTH`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    image = Image.fromarray(picture)
    image = image.resize((WIDTH, round(WIDTH * image.height / image.width)), Image.Resampling.LANCZOS)
    image.save(path, quality=QUALITY, optimize=True)


def main() -> None:
    """Draw the pictures of the tasks that the command line names, or of all."""
    for name in sys.argv[1:] or SHOTS:
        save(IMAGES / f"{name}.jpg", still(record(name), SHOTS[name][1]))


if __name__ == "__main__":
    main()
