"""Compare the evaluations of runs: cmp.py RUN..."""
import sys, csv
rows={}
for run in sys.argv[1:]:
    for r in csv.DictReader(open(f"{run}/one/metrics.csv")):
        if r.get("evaluation/score"):
            rows.setdefault(run,[]).append(r)
names=["score","falls","walking/v_x","walking/v_y","walking/omega","walking/f","walking/l","walking/h","walking/impact","jumping/v_x","jumping/omega","jumping/f","jumping/l","jumping/impact","hopping_left/v_x","hopping_left/omega","hopping_left/held_foot"]
print("run M "+" ".join(n.replace("walking","w").replace("jumping","j").replace("hopping_left","hl") for n in names))
for run,rs in rows.items():
    for r in rs:
        print(run, f"{float(r['steps'])/1e6:.1f}", *[f"{float(r['evaluation/'+n]):.3f}" if r.get('evaluation/'+n) else '-' for n in names])
