"""card.py RUN NAME INTERVENTION: put a run of the ablation into models/h1/policies/NAME (cwd: repository)."""

import json, pathlib, shutil, sys
import polars as pl

run, name, arms = pathlib.Path(sys.argv[1]), sys.argv[2], sys.argv[3]
to = pathlib.Path("models/h1/policies") / name
to.mkdir(exist_ok=True)
shutil.copy(run / "policy.safetensors", to)
rows = pl.read_csv(run / "one" / "metrics.csv", infer_schema_length=None)
kept = rows.filter((pl.col("iteration") % 10 == 1) | pl.col("evaluation/score").is_not_null())
kept.write_csv(to / "training.csv")
one = json.loads((run / "one" / "record.json").read_text())
cal = json.loads((run / "calibrated" / "record.json").read_text())
moved = {
    "noise": "while noise moved the arms, as the recipe has it",
    "motion": "while generated motions moved the arms",
    "none": "while nothing moved the arms",
}[arms]
plain = name.endswith("plain")
if plain:
    moved = "in networks without left-right symmetry"
option = f" --env.intervention {arms}"
patch = " after a change of the networks that is not part of the package" if plain else ""
text = f"""# Policy `{name}`

For the [paper's ablation](../../../../docs/results.md#the-papers-ablation): trained {moved}. To control a robot, take [`h1`](../h1/README.md).

| | |
|---|---|
| training | {one["steps"] / 1e6:.0f} million steps, {one["core_seconds"] / 3600:.1f} core-hours, commit {one["commits"][0][:8]}, seed {one["seed"]}: `hugwbc train --recipe h1 --processes 2 --env.count 512 --steps 20e6{option}`{patch} |
| calibration | in the default arena, at a selection seed; without `stop`, which came later |
| files | `training.csv`: every tenth iteration |
"""
(to / "README.md").write_text(text)
print(text, one["commits"], cal["commits"], (to / "training.csv").stat().st_size)
