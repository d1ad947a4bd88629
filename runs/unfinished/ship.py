"""Put a finished run of the recipe h1 into models/h1/policies/h1: python runs/unfinished/ship.py RUN."""

import csv
import pathlib
import shutil
import sys

run, to = pathlib.Path(sys.argv[1]), pathlib.Path("models/h1/policies/h1")
shutil.copy(run / "policy.safetensors", to)
shutil.copy(run / "one" / "snapshot.safetensors", to)
with (run / "one" / "metrics.csv").open() as file:
    rows = list(csv.reader(file))
score = rows[0].index("evaluation/score")
kept = [row for i, row in enumerate(rows[1:]) if i % 10 == 0 or row[score] not in ("", "nan")]
with (to / "training.csv").open("w", newline="") as file:
    csv.writer(file, lineterminator="\n").writerows([rows[0], *kept])
for name in ("figures.json", "figures_uncalibrated.json"):
    (to / name).unlink(missing_ok=True)
