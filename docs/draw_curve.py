"""Draw the training curve of docs/results.md from the record of a run; `make curve RUN=runs/mine` draws yours.

The record of a run is its `metrics.csv`. What is drawn is kept in `docs/images/training.csv`: means of 20 iterations.
"""

import csv
import pathlib
import sys

import numpy as np
import polars as pl
from matplotlib.figure import Figure

IMAGES = pathlib.Path(__file__).parent / "images"
RECORD = IMAGES / "training.csv"
ERRORS = {"v_x": "v_x [m/s]", "v_y": "v_y [m/s]", "omega": "omega [rad/s]"}
COLUMNS = ("steps", "episode_length", *(f"walking_error/{name}" for name in ERRORS))
ITERATIONS = 20


def keep_record(run: pathlib.Path) -> None:
    """Write means over every `ITERATIONS` iterations of a run as the record; drop an incomplete rest."""
    rows = pl.read_csv(run / "metrics.csv", infer_schema_length=None).select(COLUMNS).cast(pl.Float64).to_numpy()
    whole = len(rows) - len(rows) % ITERATIONS
    if not whole:
        sys.exit(f"{run} has {len(rows)} iterations, a point of the curve takes {ITERATIONS}; train for longer")
    means = np.nanmean(rows[:whole].reshape(-1, ITERATIONS, len(COLUMNS)), axis=1)
    with RECORD.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows([f"{value:.6g}" for value in row] for row in means)


def draw() -> None:
    """Plot episode length and errors of walking over the environment steps of the record."""
    record = pl.read_csv(RECORD)
    steps = record["steps"] / 1e6
    figure = Figure(figsize=(10, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.plot(steps, record["episode_length"])
    left.set(ylabel="steps of an episode, of 1,000", ylim=(0, 1000))
    for name, label in ERRORS.items():
        right.plot(steps, record[f"walking_error/{name}"], label=label)
    right.set(ylabel="error while walking, exploring", ylim=(0, None))
    right.legend(frameon=False)
    for axes in (left, right):
        axes.set(xlabel="environment steps [millions]", xlim=(0, None))
        axes.grid(alpha=0.3)
    figure.savefig(IMAGES / "training.png", dpi=110)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        keep_record(pathlib.Path(sys.argv[1]))
    draw()
