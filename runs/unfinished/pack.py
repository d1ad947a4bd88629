"""Pack what a continuation of a run needs: pack.py RUN OUT.tar.xz; without robots and averages."""
import pathlib, sys, tarfile, tempfile, shutil, csv
from hugwbc.learned.policy import checkpoint
run, out = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
work = pathlib.Path(tempfile.mkdtemp())/run.name
(work/"one").mkdir(parents=True)
shutil.copy(run/"recipe.yaml", work)
for name in ("sessions.jsonl","spent.json"): shutil.copy(run/"one"/name, work/"one")
t,m=checkpoint.load_file(run/"one"/"checkpoint.safetensors","checkpoint")
checkpoint.save_file(work/"one"/"checkpoint.safetensors", {k:v for k,v in t.items() if k.split(".")[0] in ("network","optimiser")}, "checkpoint", m)
rows=list(csv.reader(open(run/"one"/"metrics.csv")))
score=rows[0].index("evaluation/score"); last=rows[-1]
kept=[rows[0]]+[r for i,r in enumerate(rows[1:]) if i%10==0 or r[score] or r is last]
csv.writer(open(work/"one"/"metrics.csv","w"),lineterminator="\n").writerows(kept)
with tarfile.open(out,"w:xz") as tar: tar.add(work, run.name)
print(out, out.stat().st_size, m["steps"])
