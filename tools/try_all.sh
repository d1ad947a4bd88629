#!/bin/sh
# Try what hugwbc can do by commands, each as small as it goes, and print which ones work. An hour on two cores.
#
#     tools/try_all.sh [FOLDER [PATTERN]]    # outputs go to FOLDER (out/try); PATTERN chooses by name, such as 'play*',
#                                            # together with what makes the files that they read, such as 'deploy*'
#
# What needs an extra (PhysX, onnxruntime, Dask, rsl_rl, stable-baselines3, the live page) is said to be skipped where
# the extra is missing, and does not count as working.
OUT=${1:-out/try}
ONLY=${2:-*}
mkdir -p "$OUT"
# What an earlier call left would be taken for what this one should make.
for left in results compare compare-task paper report demos run run2 recipe h1.onnx robot.rec; do rm -rf "${OUT:?}/$left"; done
: "${HUGWBC:=.venv/bin/hugwbc}" "${PYTHON:=.venv/bin/python}"
export OMP_NUM_THREADS=1
worked=0 failed=0 skipped=0

try() { # NAME COMMAND...
    name=$1
    shift
    # shellcheck disable=SC2254
    case $name in $ONLY) ;; *) return ;; esac
    begin=$(date +%s)
    if timeout "${LIMIT:-900}" "$@" >"$OUT/$name.txt" 2>&1; then
        worked=$((worked + 1)) word=works
    else
        failed=$((failed + 1)) word=FAILS
    fi
    printf '%-7s %-28s %4d s  %s\n' "$word" "$name" $(($(date +%s) - begin)) "$*"
}

needs() { # MODULE NAME COMMAND...
    module=$1
    shift
    if "$PYTHON" -c "import $module" 2>/dev/null; then try "$@"; else
        # shellcheck disable=SC2254
        case $1 in $ONLY) ;; *) return ;; esac
        skipped=$((skipped + 1))
        printf '%-7s %-28s         needs %s\n' skipped "$1" "$module"
    fi
}

cat >"$OUT/walk.yaml" <<'YAML'
segments:
  - {label: walk, duration: 2, gait: walking, commands: {v_x: 0.4}}
  - label: reach
    duration: 2
    gait: walking
    hands: {left: {hold: [0.33, 0.16, 0.15]}, right: mirror}
YAML
cat >"$OUT/room.yaml" <<'YAML'
objects:
  - {kind: table, name: desk, position: [1.5, 0.0], size: [0.5, 0.6], height: 0.8}
YAML
"$PYTHON" - "$OUT" <<'PY'
import sys
import numpy
from hugwbc import load_robot
robot = load_robot()
names = [robot.joint_names[joint] for joint in robot.arms]
angles = robot.nominal[robot.arms] + 0.3 * numpy.sin(numpy.linspace(0.0, 6.28, 101))[:, None]
numpy.savez(f"{sys.argv[1]}/wave.npz", fps=50.0, joint_names=names, positions=angles.astype(numpy.float32))
rows = numpy.column_stack((numpy.arange(101) / 50.0, angles))
numpy.savetxt(f"{sys.argv[1]}/wave.csv", rows, delimiter=",", header=",".join(["t", *names]), comments="")
PY
EVALUATE="$HUGWBC evaluate"
RESULTS="--results $OUT/results"
QUIET="--viewer none"

# Compare, report
try compare-script $HUGWBC compare --script "$OUT/walk.yaml" --seed 1 --out "$OUT/compare"
try compare-task $HUGWBC compare --task press_button --seed 1 --controllers qp --out "$OUT/compare-task"
for file in report.html replay.html summary.json compare.mp4; do
    try "compare-$file" test -s "$OUT/compare/$file"
done
try compare-experiment $HUGWBC compare --experiment single-command --controllers hold learned --gait walking \
    --episodes 8 --duration 3 --out "$OUT/paper" $RESULTS
try report $HUGWBC report --controllers hold --experiments single-command --out "$OUT/report" $RESULTS

# Evaluate
try single-command $EVALUATE single-command --controller learned --episodes 8 --duration 3 $RESULTS
try single-command-resumed sh -c "$EVALUATE single-command --controller learned --episodes 8 --duration 3 $RESULTS 2>&1 \
    | grep 'all 8 episodes are stored'"
try two-workers $EVALUATE single-command --controller qp --episodes 8 --duration 3 --workers 2 $RESULTS
try intervention $EVALUATE intervention --controller learned --episodes 24 --duration 2.5 $RESULTS
try disturbance $EVALUATE disturbance --controller learned --rollouts 1 --first 200 --limit 200 --duration 3 $RESULTS
try ramp $EVALUATE ramp --controller learned --episodes 1 $RESULTS
try contacts $EVALUATE contacts --controller learned --episodes 1 $RESULTS
try random-commands $EVALUATE random-commands --controller learned --episodes 3 $RESULTS
try response $EVALUATE response --controller learned --gait standing --points 2 --duration 3 $RESULTS
try stops $EVALUATE stops --controller learned --episodes 1 --speeds 0.6 $RESULTS
try arrive $EVALUATE arrive --controller learned --episodes 1 $RESULTS
try hands $EVALUATE hands --controller learned --episodes 1 $RESULTS
for experiment in carry press sway; do
    try $experiment $EVALUATE $experiment --controller learned --episodes 1 $RESULTS
done
try pull $EVALUATE pull --controller learned --episodes 1 $RESULTS
try push $EVALUATE push --controller learned --episodes 1 $RESULTS
try estimation $EVALUATE estimation --controller learned --episodes 1 $RESULTS
try faults $EVALUATE faults --controller learned --episodes 1 $RESULTS
try tasks $EVALUATE tasks --controller learned --task press_button --episodes 1 $RESULTS
try boxes $EVALUATE boxes --controller learned --episodes 1 --masses 2 --heights 0.9 $RESULTS
try behaviours $EVALUATE behaviours --controller learned --behaviour fetch_cup --scene cupboard --episodes 1 $RESULTS
needs sapien engines $EVALUATE engines --controller learned --episodes 1 $RESULTS
needs sapien physx $EVALUATE single-command --controller learned --episodes 8 --duration 2.5 --engine physx $RESULTS
needs distributed dask-cluster sh -c "
    $PYTHON -m dask scheduler --host 127.0.0.1 --port 18786 --no-dashboard & scheduler=\$!
    $PYTHON -m dask worker tcp://127.0.0.1:18786 --nthreads 1 --no-dashboard & worker=\$!
    trap 'kill \$worker \$scheduler' EXIT
    sleep 8
    $EVALUATE random-commands --controller hold --episodes 4 --cluster tcp://127.0.0.1:18786 $RESULTS"

# Play
try play-command $HUGWBC play --controller qp --v-x 0.5 --duration 2 $QUIET
try play-script $HUGWBC play --script "$OUT/walk.yaml" $QUIET
try play-scene $HUGWBC play --scene "$OUT/room.yaml" --v-x 0.2 --duration 2 $QUIET
try play-g1 $HUGWBC play --robot g1 --v-x 0.3 --duration 2 $QUIET
try play-task $HUGWBC play --task press_button $QUIET
try play-motion-csv $HUGWBC play --motion "$OUT/wave.csv" --v-x 0.3 --duration 2 $QUIET
try play-motion-npz $HUGWBC play --motion "$OUT/wave.npz" --v-x 0.3 --duration 2 $QUIET
try play-meshcat $HUGWBC play --viewer meshcat --v-x 0.3 --duration 3
needs viser play-live $HUGWBC play --viewer live --duration 5
needs viser live-page "$PYTHON" -m pytest -q -n0 tests/viz -k "live or drive"
needs pybvh play-bvh "$PYTHON" -m pytest -q -n0 tests/scripts/test_whole_body_motion.py

# Objects, tasks, demonstrations, other people's learners
try tasks-list $HUGWBC tasks
needs pyarrow tasks-record $HUGWBC tasks --record "$OUT/demos" --task press_button --controller qp --episodes 1
needs pyarrow tasks-replay $HUGWBC tasks --replay "$OUT/demos"
needs gymnasium gymnasium "$PYTHON" -m pytest -q -n0 tests/gym/test_task_env.py tests/gym/test_h1_env.py
needs rsl_rl rsl-rl "$PYTHON" -m pytest -q -n0 tests/gym/test_learners.py -k rsl
needs stable_baselines3 stable-baselines3 "$PYTHON" -m pytest -q -n0 tests/gym/test_learners.py -k stable

# Train, export, other controllers
SHORT="--env.count 16 --evaluation-steps 0"
try train $HUGWBC train --out "$OUT/run" --steps 2e3 $SHORT
try train-resume $HUGWBC train --out "$OUT/run" --steps 4e3 --resume $SHORT
try train-processes $HUGWBC train --processes 2 --out "$OUT/run2" --steps 4e3 $SHORT
try train-recipe $HUGWBC train --recipe h1 --smoke --out "$OUT/recipe"
try check-ancestry $HUGWBC check --policy "$OUT/recipe"
needs onnxruntime export $HUGWBC export --policy h1 --out "$OUT/h1.onnx"
needs onnxruntime run-onnx "$PYTHON" examples/11_onnx_only.py --policy "$OUT/h1.onnx" --model models/h1/h1.xml --v-x 0.5
needs onnxruntime other-policy $HUGWBC play --controller "$OUT/h1.onnx" --v-x 0.4 --duration 2 $QUIET
try other-controller $HUGWBC play --controller examples/10_write_a_controller.py:Squatter --duration 2 $QUIET

# A robot over DDS
SCHEDULE="1 Start, 4 lower, 7 A, 8 release, 9 ly=0.3, 11 ly=0, 13 Select"
needs cyclonedds deploy sh -c "
    $HUGWBC simulate-robot --lockstep --schedule '$SCHEDULE' --duration 14 & robot=\$!
    $HUGWBC deploy --controller learned --lockstep --duration 14 --record $OUT/robot.rec; status=\$?
    wait \$robot; exit \$status"
needs cyclonedds deploy-replay $HUGWBC deploy --controller learned --replay "$OUT/robot.rec"

# Health
try check $HUGWBC check
try check-robot $HUGWBC check --robot g1
try bench $HUGWBC bench
try soak "$PYTHON" tools/soak.py --minutes 0.7
try documents $HUGWBC docs

echo "$worked work, $failed fail, $skipped skipped"
test $((worked + failed + skipped)) -gt 0 || echo "no name matches $ONLY" >&2
test "$failed" -eq 0 && test $((worked + skipped)) -gt 0
