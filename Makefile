# Every target sets up what it needs: a virtual environment in .venv with the pinned versions of constraints.txt.
# The machine needs Python 3.11 to 3.13, with its venv module, and access to a package index.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
# Options for the target's command, such as ARGS="--episodes 64".
ARGS ?=
# The computations are many and small: a second thread per process only slows them down.
export OMP_NUM_THREADS ?= 1
# Processes that share the tests, file by file.
TEST_PROCESSES ?= 2

.PHONY: help install compare compare-tasks play evaluate bench soak try train check test lint test-slow docs models picture task-pictures animation results response curve clean

help:
	@echo "make install        set up .venv with the versions of constraints.txt; the other targets do it too"
	@echo "make compare        play loco_manipulation with both controllers; results in out/compare"
	@echo "make compare-tasks  do fetch_box and press_button with both, side by side; results in out/compare-TASK"
	@echo "make test           linter, formatter, type checker and tests, as CI runs them"
	@echo "make test-slow      the tests that take longer"
	@echo "make lint           linter, formatter and type checker only"
	@echo "make play           drive a robot in the browser"
	@echo "make evaluate       the paper's single-command experiment"
	@echo "make bench          speed of the parts"
	@echo "make soak           reliability: faults, random commands, absurd states, memory (docs/reliability.md)"
	@echo "make try            try what hugwbc can do by commands, each as small as it goes; an hour"
	@echo "make check          verify the installation"
	@echo "make train          train a policy"
	@echo "make docs           build the documentation into site/, failing on a broken link"
	@echo "make models         write the robots' XML and URDF files from their tables"
	@echo "make picture        take the README's picture of both controllers"
	@echo "make task-pictures  take the pictures of the tasks, docs/tasks.md"
	@echo "make animation      take the README's animation of robots and controllers at a task; minutes of computing"
	@echo "make results        run what the tables of the documents show, and write them; hours, goes on after a kill"
	@echo "make response       draw how both controllers answer commands, docs/comparison.md"
	@echo "make curve          draw the training curve of docs/results.md, with RUN=FOLDER that of a run"
	@echo "make clean          remove .venv, caches, site and out, with the episodes of make results"
	@echo 'Options go in ARGS: make evaluate ARGS="--controller qp --gait standing"'

install: $(STAMP)

$(STAMP): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' || \
		{ echo "hugwbc needs Python 3.11 to 3.13, and $(PYTHON) is none of them: run make PYTHON=/path/to/python3.12" >&2; exit 2; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet -c constraints.txt -e ".[dev]"
	@touch $@

compare: $(STAMP)
	$(BIN)/hugwbc compare --script loco_manipulation --seed 0 $(ARGS)

# Minutes of computing each, because the QP is asked 250 times for each second: `compare` stays without them.
compare-tasks: $(STAMP)
	$(BIN)/hugwbc compare --task fetch_box --seed 0 --out out/compare-fetch_box $(ARGS)
	$(BIN)/hugwbc compare --task press_button --seed 0 --out out/compare-press_button $(ARGS)

play evaluate bench train check: $(STAMP)
	$(BIN)/hugwbc $@ $(ARGS)

# Episodes of each fault, and rounds of ten seconds at random commands, with each controller.
EPISODES ?= 2
ROUNDS ?= 6
MINUTES ?= 1
soak: $(STAMP)
	$(BIN)/hugwbc evaluate faults --controller learned --episodes $(EPISODES) $(ARGS)
	$(BIN)/hugwbc evaluate faults --controller qp --episodes $(EPISODES) $(ARGS)
	$(BIN)/hugwbc evaluate random-commands --controller learned --gait walking --episodes $(ROUNDS) $(ARGS)
	$(BIN)/hugwbc evaluate random-commands --controller qp --gait walking --episodes $(ROUNDS) $(ARGS)
	$(BIN)/python tools/soak.py --minutes $(MINUTES)

try: $(STAMP)
	tools/try_all.sh $(ARGS)

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright

test: lint
	$(BIN)/pytest -n $(TEST_PROCESSES) --dist loadfile $(ARGS)

test-slow: $(STAMP)
	$(BIN)/pytest -m slow $(ARGS)

docs: $(STAMP)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
	@echo "open site/index.html; with its search: python3 -m http.server -d site"

models: $(STAMP)
	$(BIN)/python models/build.py

# Without its video, an old one is not taken for this one's.
picture: $(STAMP)
	rm -f out/compare/compare.mp4
	$(BIN)/hugwbc compare --script loco_manipulation --seed 0 --hide balance
	$(BIN)/python docs/picture.py

task-pictures: $(STAMP)
	$(BIN)/python docs/draw_tasks.py $(ARGS)

animation: $(STAMP)
	rm -rf out/animation
	$(BIN)/hugwbc compare --task fetch_box --controllers qp --seed 0 --out out/animation/qp --hide steps forces balance phases
	$(BIN)/hugwbc compare --task fetch_box --controllers learned --seed 0 --out out/animation/learned --hide steps forces balance phases
	$(BIN)/hugwbc compare --task fetch_box --robot g1 --controllers qp --seed 0 --out out/animation/g1 --hide steps forces balance phases
	$(BIN)/python docs/animation.py

results: $(STAMP)
	$(BIN)/python tools/results.py $(ARGS)

response: $(STAMP)
	$(BIN)/python docs/draw_response.py

curve: $(STAMP)
	$(BIN)/python docs/draw_curve.py $(RUN)

clean:
	rm -rf $(VENV) out site build dist .pytest_cache .ruff_cache .hypothesis *.egg-info MUJOCO_LOG.TXT
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
