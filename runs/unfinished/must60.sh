#!/bin/sh
# Issue 60, "must show": tools for a policy file at the report seed. must60.sh POLICY [WORKERS]; resumable by rows.
P=$1; W=${2:-1}
run() { echo "== $*"; hugwbc evaluate "$@" --controller learned --policy "$P" --seed 1000 --workers "$W" 2>&1 | grep -v '%'', about'; }
for gait in walking jumping; do run single-command --gait $gait --episodes 128; done
for gait in standing hopping; do run single-command --gait $gait --episodes 64; done
run random-commands --episodes 64
for kind in noise motion; do run single-command --gait walking --intervention $kind --episodes 128; done
for gait in walking jumping; do run single-command --gait $gait --ends --episodes 160; done
run engines --episodes 10
run single-command --gait walking --robot h1-2023 --episodes 128
for slope in 0.1745 0.2618; do run single-command --gait walking --slope $slope --episodes 20; done
run tasks --episodes 50
run boxes --episodes 20
