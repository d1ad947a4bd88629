"""Draw the training curve of docs/results.md; `make curve RUN=runs/mine` draws that of a run, into its folder."""

import pathlib
import sys

import numpy as np
import polars as pl
from matplotlib.figure import Figure

ROOT = pathlib.Path(__file__).parents[1]
SHIPPED = ROOT / "models" / "h1" / "policies" / "h1" / "training.csv"
ERRORS = {"v_x": "v_x [m/s]", "v_y": "v_y [m/s]", "omega": "omega [rad/s]"}
COLUMNS = ("steps", "episode_length", *(f"walking_error/{name}" for name in ERRORS))
ROWS = 20  # of the record, to a point of the curve


def points(record: pathlib.Path) -> pl.DataFrame:
    """Return means over every `ROWS` rows of a record, without an incomplete rest."""
    rows = pl.read_csv(record, infer_schema_length=None).select(COLUMNS).cast(pl.Float64).to_numpy()
    whole = len(rows) - len(rows) % ROWS
    if not whole:
        sys.exit(f"{record} has {len(rows)} rows, a point of the curve takes {ROWS}; train for longer")
    return pl.DataFrame(np.nanmean(rows[:whole].reshape(-1, ROWS, len(COLUMNS)), axis=1), schema=COLUMNS)


def draw(record: pathlib.Path, picture: pathlib.Path) -> None:
    """Plot episode length and errors of walking over the environment steps of a record."""
    means = points(record)
    steps = means["steps"] / 1e6
    figure = Figure(figsize=(10, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.plot(steps, means["episode_length"])
    left.set(ylabel="steps of an episode, of 1,000", ylim=(0, 1000))
    for name, label in ERRORS.items():
        right.plot(steps, means[f"walking_error/{name}"], label=label)
    right.set(ylabel="error while walking, exploring", ylim=(0, None))
    right.legend(frameon=False)
    for axes in (left, right):
        axes.set(xlabel="environment steps [millions]", xlim=(0, None))
        axes.grid(alpha=0.3)
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        run = pathlib.Path(sys.argv[1])
        draw(run / "metrics.csv", run / "training.png")
    else:
        draw(SHIPPED, ROOT / "docs" / "images" / "training.png")
