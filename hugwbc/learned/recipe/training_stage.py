"""Stages of reinforcement learning: segments with constant settings, a measurement after each, gates between them.

A segment is a continued training: `Trainer` restores everything from a checkpoint, bit for bit. A schedule is therefore
a rule for the next segment's settings, and any setting can have one; the ramps of those that the trainer reads anew in
every iteration are handed to it and are smooth. What gates and schedules decide rests on the
measurements in the stage's state file and on the log, not on anything that a killed process would have forgotten.
"""

import copy
import csv
import dataclasses
import math
import pathlib
import shutil
from collections.abc import Iterable, Mapping
from typing import Any

import torch

from hugwbc.errors import RecipeError, UnknownNameError
from hugwbc.files import write_whole
from hugwbc.learned.config import EnvConfig, TrainConfig
from hugwbc.learned.policy import checkpoint
from hugwbc.learned.recipe.ancestry import Discarded
from hugwbc.learned.recipe.recipe_records import POLICY, SNAPSHOT
from hugwbc.learned.recipe.stage_gates import PROGRESS, Gate, Times, open_gate
from hugwbc.learned.recipe.stage_work import Outcome, StageWork, read_state, write_state
from hugwbc.learned.rl.evaluator import Evaluator
from hugwbc.learned.rl.run_log import LOG_NAME
from hugwbc.learned.rl.trainer import CHECKPOINT_NAME, Trainer, save_product

BEST, START = "best", "start.safetensors"
_NO_LIMIT = 1e6  # [h]
_TOO_MANY_SKIPPED = 0.5  # share of the updates of a segment; a learner that skips more has diverged
_OWN_FIGURES = ("steps", "seconds", "iteration", "steps_per_second", "collect_fraction")


@dataclasses.dataclass
class TrainingState:
    """How far a training stage is; everything that its next decision depends on.

    Attributes:
        segment: number of finished segments.
        branch: number of returns to the best checkpoint; each has a folder and a seed of its own.
        begin_steps, begin_iteration: counters at the begin of the stage; its network may have been trained before.
        measurements: of the finished segments, without those that were discarded.
        best: index of the best measurement; None before the first.
        levels: levels of the gated schedules.
        best_levels: the same when the best checkpoint was measured.
        changes: settings that gates have changed: ["to", value] or ["times", factor].
        gates: how often each gate has acted.
        discarded: branches that were left.
        over: why no further segment follows; empty as long as one does.
    """

    segment: int = 0
    branch: int = 0
    begin_steps: float = 0.0
    begin_iteration: int = 0
    measurements: list[dict[str, float]] = dataclasses.field(default_factory=list)
    best: int | None = None
    levels: dict[str, int] = dataclasses.field(default_factory=dict)
    best_levels: dict[str, int] = dataclasses.field(default_factory=dict)
    changes: dict[str, list[Any]] = dataclasses.field(default_factory=dict)
    gates: dict[str, int] = dataclasses.field(default_factory=dict)
    discarded: list[dict[str, Any]] = dataclasses.field(default_factory=list)
    over: str = ""

    def best_measurement(self) -> dict[str, float]:
        """Return the measurement of the best checkpoint; an empty one before the first."""
        return {} if self.best is None else self.measurements[self.best]


class TrainingStage:
    """A training stage at work."""

    def __init__(self, work: StageWork) -> None:
        """Read how far the stage is."""
        self.work, self.stage, self.folder = work, work.stage, work.folder
        found = read_state(work.folder)
        names = {field.name for field in dataclasses.fields(TrainingState)}
        if found and set(found) - {PROGRESS} != names:
            raise RecipeError(
                f"{work.folder / 'state.json'} was written by another version; begin the stage again with "
                f"`--redo {work.stage.name}`"
            )
        self.state = TrainingState(**{name: found[name] for name in names}) if found else self._begin()
        self._evaluator: Evaluator | None = None

    def _begin(self) -> TrainingState:
        start = self.work.inputs.get("start_from")
        if start is None:
            return TrainingState()
        _, metadata = checkpoint.load_file(start, "checkpoint")
        return TrainingState(begin_steps=float(metadata["steps"]), begin_iteration=int(metadata["iteration"]))

    def run(self) -> Outcome:
        """Train until the last segment or until a gate ends the stage; write its policy and snapshot.

        Raises:
            StoppedError: if the run was asked to stop.
            RecipeError: if the stage is given up and the recipe does not say what then.
        """
        while not self.state.over:
            self._check_names(self._evaluator_of_stage().names, "evaluation/")
            self._segment()
        return self._finish()

    # Segments -------------------------------------------------------------------------------------------------------

    def _segment(self) -> None:
        """Train one segment, measure, and decide what follows."""
        state = self.state
        trainer = Trainer(self._config())
        trainer.stop = self.work.stop
        work_steps = max(self.stage.work, 1.0)
        last = float(trainer.steps)

        def report(row: dict[str, float], _gates: dict[str, str]) -> None:
            nonlocal last
            self.work.session.work(steps=row["steps"] - last)
            last = row["steps"]
            if int(row["iteration"]) % trainer.config.save_interval == 0 or last >= trainer.config.steps:
                self.work.session.write()  # what a checkpoint holds is in the ledger before
            self.work.progress(min(1.0, (last - state.begin_steps) / work_steps))

        trainer.run(report)
        self.work.stop.check()
        figures = self._measure(trainer)
        diverged = self._diverged(trainer, figures)
        self.state.measurements.append(figures)
        if not diverged:
            self._keep_best(figures)
        self._decide(figures, diverged)

    @property
    def _branch_folder(self) -> pathlib.Path:
        return self.folder / f"branch-{self.state.branch}"

    def _config(self) -> TrainConfig:
        """Return the settings of the next segment, or of the rest of one that was interrupted."""
        state, stage, folder = self.state, self.stage, self._branch_folder
        resumed = (folder / CHECKPOINT_NAME).exists()
        start = self.work.inputs.get("start_from")
        if state.branch and not resumed:
            start = folder / START
            _write_start(self.folder / BEST / CHECKPOINT_NAME, start)
        iteration = state.begin_iteration
        if resumed or state.branch:
            _, metadata = checkpoint.load_file(folder / CHECKPOINT_NAME if resumed else start, "checkpoint")  # type: ignore[arg-type]
            iteration = int(metadata["iteration"])
        config: TrainConfig = self._settings_at(stage.progress_of(state.segment))
        # The critic's time alone is counted from the begin of the stage, not of a session.
        left = max(0, config.critic_warm_up - (iteration - state.begin_iteration))
        return dataclasses.replace(
            config,
            out=folder,
            resume=resumed,
            start_from=None if resumed else start,
            steps=state.begin_steps + stage.end_of(state.segment),
            hours=_NO_LIMIT,
            seed=self.work.seed() + state.branch,
            critic_warm_up=left,
            evaluation_interval=0,
            schedules=stage.smooth_schedules(state.begin_steps, without=state.changes),
        )

    def _settings_at(self, progress: float) -> TrainConfig:
        changes = {name: Times(value) if how == "times" else value for name, (how, value) in self.state.changes.items()}
        return self.stage.config(progress, levels=self.state.levels, changes=changes, own=self.work.paths)

    # Measurements ---------------------------------------------------------------------------------------------------

    def measured_env(self) -> EnvConfig:
        """Return the environment of the measurements: that of the stage's end, so that all of them are alike.

        A policy runs in it with the feed-forward of squats that it has learned with.
        """
        highest = {name: len(schedule.values) - 1 for name, schedule in self.stage.schedules.items()}
        return self.stage.config(1.0, levels=highest, own=self.work.paths).env

    def _measure(self, trainer: Trainer) -> dict[str, float]:
        """Return the figures of the evaluator, at a seed of selection, and the training's own over the segment."""
        state = self.state
        evaluator = self._evaluator_of_stage()
        evaluator.adopt(trainer.config.at(trainer.steps).env)
        # In the form in which the policy runs, on the CPU.
        figures = evaluator.run(copy.deepcopy(trainer.ppo.network.actor).cpu().plain())
        earlier = state.measurements[-1]["iteration"] if state.measurements else state.begin_iteration
        if state.branch and not self._branch_has_measurements():
            earlier = state.best_measurement().get("iteration", state.begin_iteration)
        figures |= log_means(self._branch_folder, int(earlier), trainer.iteration)
        figures |= {
            PROGRESS: min(1.0, (trainer.steps - state.begin_steps) / self.stage.work),
            "steps": float(trainer.steps),
            "iteration": float(trainer.iteration),
        }
        self._check_names([*figures, "skipped updates"])
        return {name: float(value) for name, value in figures.items() if math.isfinite(value)}

    def _evaluator_of_stage(self) -> Evaluator:
        if self._evaluator is None:
            measure, env = self.work.recipe.measure, self.measured_env()
            settings = self._settings_at(0.0)
            self._evaluator = Evaluator(
                env,
                count=measure.robots,
                seconds=measure.seconds,
                threads=settings.threads,
                timestep=settings.evaluation_timestep,
            )
        return self._evaluator

    def _check_names(self, measured: Iterable[str], prefix: str = "") -> None:
        """Refuse gates, schedules and a score that ask for a figure that nobody measures: they would never act.

        Args:
            measured: names of the figures.
            prefix: which figures to look at; the names of the training's own are known after its first segment only.

        Raises:
            RecipeError: if there is one.
        """
        names = list(measured)
        schedules = self.stage.schedules.values()
        conditions = [one for gate in self.stage.gates for one in gate.when]
        conditions += [one for schedule in schedules for one in (*schedule.when, *schedule.back_when)]
        for figure in (self.stage.score, *(one.figure for one in conditions)):
            if figure.startswith(prefix) and figure not in names:
                raise RecipeError(
                    f"stage {self.stage.name}: {UnknownNameError('figure', figure, sorted(names))} Correct its gates, "
                    "schedules or score in the recipe, and run it again with --redo changed"
                )

    def _branch_has_measurements(self) -> bool:
        return self.state.best is None or len(self.state.measurements) > self.state.best + 1

    def _keep_best(self, figures: dict[str, float]) -> None:
        """Copy the checkpoint if it is the best so far."""
        state, score = self.state, self.stage.score
        value = figures.get(score, math.inf)
        if state.best is None or value < state.best_measurement().get(score, math.inf):
            for name in (POLICY, SNAPSHOT, CHECKPOINT_NAME):
                write_whole(self.folder / BEST / name, (self._branch_folder / name).read_bytes())
            state.best, state.best_levels = len(state.measurements) - 1, dict(state.levels)

    def _diverged(self, trainer: Trainer, figures: Mapping[str, float]) -> str:
        """Return in words that the learner has diverged; empty if it has not."""
        finite = all(bool(torch.isfinite(p).all()) for p in trainer.ppo.network.parameters())
        config = trainer.config.ppo
        logged = any(not name.startswith("evaluation/") for name in figures.keys() - {PROGRESS, *_OWN_FIGURES})
        if not finite or (logged and "reward" not in figures):
            return "the learner diverged: " + ("the reward" if finite else "its network") + " is not finite"
        skipped = figures.get("skipped updates", 0.0) / (config.epochs * config.minibatches)
        if skipped > _TOO_MANY_SKIPPED:
            return f"the learner diverged: {100.0 * skipped:.0f} % of its updates were not finite and left out"
        return ""

    # Decisions ------------------------------------------------------------------------------------------------------

    def _decide(self, figures: dict[str, float], diverged: str) -> None:
        """Move on, back, or give up; then write the state."""
        state, stage = self.state, self.stage
        gate = open_gate(stage.gates, state.measurements)
        back = next((one for one in stage.gates if one.do == "back"), None)
        if diverged and (gate is None or gate.do == "next"):
            gate = back
        state.segment += 1
        text = self._line(figures)
        if diverged and gate is None:
            state.over = f"given up: {diverged}"
        elif gate is not None and gate.do == "back":
            text += "; " + self._go_back(gate, diverged or gate.reason())
        elif gate is not None and gate.do == "stop":
            state.over = f"given up: {gate.reason()}"
        elif gate is not None:
            state.over = f"gate: {gate.reason()}"
        elif state.segment >= stage.segments:
            state.over = "all steps are done"
        else:
            earlier = state.measurements[:-1]
            state.levels = {
                name: schedule.next_level(state.levels.get(name, 0), figures, earlier)
                for name, schedule in stage.schedules.items()
                if schedule.shape == "gated"
            }
        write_state(self.folder, {PROGRESS: figures[PROGRESS], **dataclasses.asdict(state)})
        self.work.say(text + (f"; {state.over}" if state.over else ""))

    def _line(self, figures: Mapping[str, float]) -> str:
        shown = [name for name in figures if name in (self.stage.score, "evaluation/falls", "reward")]
        parts = ", ".join(f"{name.removeprefix('evaluation/')} {figures[name]:.3f}" for name in shown)
        steps = figures["steps"] - self.state.begin_steps
        return f"{self.stage.name}: {steps:.3g} of {self.stage.work:.3g} steps, {parts}"

    def _go_back(self, gate: Gate, reason: str) -> str:
        """Return to the best checkpoint with a branch of its own; give up if that was done often enough."""
        state, key = self.state, str(self.stage.gates.index(gate))
        if state.gates.get(key, 0) >= gate.at_most:
            state.over = f"given up after {gate.at_most} returns to the best checkpoint: {reason}"
            return state.over
        if state.best is None:
            state.over = f"given up before its first good measurement: {reason}"
            return state.over
        state.gates[key] = state.gates.get(key, 0) + 1
        lost = state.measurements[-1]["steps"] - state.best_measurement()["steps"]
        state.discarded.append({"reason": f"back to the best checkpoint: {reason}", "steps": lost})
        for name, change in gate.change.items():
            how, value = ("times", change.factor) if isinstance(change, Times) else ("to", change)
            if how == "times" and name in state.changes and state.changes[name][0] == "times":
                value *= state.changes[name][1]
            state.changes[name] = [how, value]
        state.measurements = state.measurements[: state.best + 1]
        state.segment, state.levels = state.best + 1, dict(state.best_levels)
        state.branch += 1
        return f"back to {state.best_measurement()['steps'] - state.begin_steps:.3g} steps: {reason}"

    # End ------------------------------------------------------------------------------------------------------------

    def _finish(self) -> Outcome:
        """Write policy and snapshot of the chosen checkpoint, and say what the stage came to."""
        state, stage = self.state, self.stage
        given_up = state.over.startswith("given up")
        if given_up and (stage.if_given_up == "fail" or (stage.if_given_up == "best" and state.best is None)):
            best = f"Its best checkpoint ({_words(state.best_measurement())}) is in {self.folder / BEST}"
            raise RecipeError(
                f"stage {stage.name} is {state.over}. {best if state.best is not None else 'It has no checkpoint'}. "
                "Change the recipe (a lower learning rate or KL, other gates, or if_given_up) and run it again with "
                "--redo changed; nothing that was finished is lost"
            )
        discarded = [Discarded(**one) for one in state.discarded]
        seeds = tuple(self.work.seed() + branch for branch in range(state.branch + 1))
        last = state.measurements[-1]["steps"]
        if given_up and stage.if_given_up == "skip":
            self._pass_on()
            discarded.append(Discarded(state.over, steps=last - state.begin_steps))
            return Outcome("skipped", discarded=tuple(discarded), figures=state.best_measurement(), seeds=seeds)
        keep_best = stage.keep == "best" or given_up
        source = self.folder / BEST if keep_best else self._branch_folder
        chosen = state.best_measurement() if keep_best else state.measurements[-1]
        for name in (POLICY, SNAPSHOT):
            write_whole(self.folder / name, (source / name).read_bytes())
        if last > chosen["steps"]:
            discarded.append(Discarded("after the best checkpoint", steps=last - chosen["steps"]))
        how = "kept best" if given_up else "finished"
        return Outcome(how, chosen["steps"] - state.begin_steps, 0.0, tuple(discarded), chosen, seeds)

    def _pass_on(self) -> None:
        """Write the snapshot that the stage started from, and its policy, as the stage's own."""
        start = self.work.inputs["start_from"]
        settings = self._settings_at(0.0)
        one = dataclasses.replace(settings.env, count=1)
        trainer = Trainer(dataclasses.replace(settings, env=one, start_from=start, evaluation_interval=0))
        _, metadata = checkpoint.load_file(start, "checkpoint")
        save_product(self.folder, trainer.ppo.network, settings.env, metadata)


def clean_training(folder: pathlib.Path) -> None:
    """Remove what only an unfinished stage needs; logs and the best checkpoint stay."""
    for branch in folder.glob("branch-*"):
        for name in (CHECKPOINT_NAME, START, POLICY, SNAPSHOT):
            (branch / name).unlink(missing_ok=True)
    shutil.rmtree(folder / BEST, ignore_errors=True)


def _words(figures: Mapping[str, float]) -> str:
    shown = {name: value for name, value in figures.items() if name.startswith("evaluation/") and name.count("/") == 1}
    return ", ".join(f"{name.removeprefix('evaluation/')} {value:.3g}" for name, value in shown.items()) or "none"


def _write_start(source: pathlib.Path, target: pathlib.Path) -> None:
    """Write a checkpoint without its robots: a branch starts new episodes with random numbers of its own."""
    tensors, metadata = checkpoint.load_file(source, "checkpoint")
    kept = {name: tensor for name, tensor in tensors.items() if name.startswith(("network.", "optimiser."))}
    checkpoint.save_file(target, kept, "checkpoint", metadata)


def log_means(folder: pathlib.Path, after: int, until: int) -> dict[str, float]:
    """Return the means of a training's logged figures over some iterations.

    They are read from the log, so that a segment with an interruption has the same means as one without.

    Args:
        folder: folder of the training.
        after: iteration before the first one.
        until: last iteration.

    Returns:
        Means by column, NaN where it has no numbers, without counters; "skipped updates" is the number of skipped
        updates per iteration.
    """
    rows: dict[int, dict[str, str]] = {}
    for path in sorted(folder.glob(f"{pathlib.Path(LOG_NAME).stem}*.csv")):
        with path.open(newline="") as file:
            for row in csv.DictReader(file):
                number = row.get("iteration") or ""
                if number and after < float(number) <= until:
                    rows[int(float(number))] = row
    figures: dict[str, float] = {}
    for name in {name for row in rows.values() for name in row if name and name not in _OWN_FIGURES}:
        values = [float(row[name]) for row in rows.values() if row.get(name)]
        figures[name] = sum(values) / len(values) if values else math.nan
    skipped = [float(rows[number]["skipped"]) for number in sorted(rows) if rows[number].get("skipped")]
    if len(skipped) > 1:
        figures["skipped updates"] = (skipped[-1] - skipped[0]) / (len(skipped) - 1)
    return figures
