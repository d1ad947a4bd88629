"""Put a finished run of the recipe h1 into models/h1/policies/h1: python runs/unfinished/ship.py RUN."""

import pathlib
import shutil
import sys

import polars as pl

run, to = pathlib.Path(sys.argv[1]), pathlib.Path("models/h1/policies/h1")
shutil.copy(run / "policy.safetensors", to)
shutil.copy(run / "one" / "snapshot.safetensors", to)
# A file for each set of columns: of the first steps, with hops, on rough ground.
until = sorted((run / "one").glob("metrics-until-*.csv"), key=lambda path: int(path.stem.rpartition("-")[2]))
parts = [pl.read_csv(path, infer_schema_length=None) for path in (*until, run / "one" / "metrics.csv")]
rows = pl.concat(parts, how="diagonal_relaxed")
kept = rows.filter((pl.col("iteration") % 10 == 1) | pl.col("evaluation/score").cast(pl.Float64).is_not_nan())
kept.write_csv(to / "training.csv")
for name in ("figures.json", "figures_uncalibrated.json"):
    (to / name).unlink(missing_ok=True)
