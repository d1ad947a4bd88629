"""Put a finished run of the recipe h1 into models/h1/policies/h1: python runs/unfinished/ship.py RUN."""

import pathlib
import shutil
import sys

import polars as pl

run, to = pathlib.Path(sys.argv[1]), pathlib.Path("models/h1/policies/h1")
shutil.copy(run / "policy.safetensors", to)
shutil.copy(run / "one" / "snapshot.safetensors", to)
rows = pl.read_csv(run / "one" / "metrics.csv", infer_schema_length=None)
kept = rows.filter((pl.col("iteration") % 10 == 1) | pl.col("evaluation/score").is_not_null())
kept.write_csv(to / "training.csv")
for name in ("figures.json", "figures_uncalibrated.json"):
    (to / name).unlink(missing_ok=True)
