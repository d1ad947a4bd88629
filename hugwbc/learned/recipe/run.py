"""The run of a recipe: one stage after the other, from where an earlier session ended, on this machine or another.

Everything that a run needs is in its folder. A folder for each stage holds what the stage wrote, its record once it is
finished, and until then what it needs to continue.
"""

import contextlib
import dataclasses
import datetime
import json
import pathlib
import resource
import shutil
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from pydantic import TypeAdapter

from hugwbc.errors import RecipeError
from hugwbc.files import digest, sole_writer, write_whole
from hugwbc.learned import distributed
from hugwbc.learned.config import CalibrationConfig, TrainConfig
from hugwbc.learned.config.schedules import replaced
from hugwbc.learned.distributed import Stop, StoppedError, stopped_by_signals
from hugwbc.learned.policy.records import robot_label, versions
from hugwbc.learned.recipe.ancestry import (
    KINDS,
    Ancestry,
    Parent,
    StageRecord,
    content_digest,
    origin,
    read_record,
    seal,
)
from hugwbc.learned.recipe.calibration import ROUNDS, Arena, calibrate
from hugwbc.learned.recipe.recipe import TAKEN, Recipe, Stage
from hugwbc.learned.rl.continuation import OF_A_SESSION
from hugwbc.learned.rl.trainer import BEST_FOLDER, CHECKPOINT_NAME, RECIPE_NAME, Trainer
from hugwbc.source import source_commit

RECORD, SPENT = "record.json", "spent.json"
_NO_LIMIT = 1e6  # [h]

_Found = TypeVar("_Found")
Report = Callable[[str, Mapping[str, float], Mapping[str, str]], None]


def run_recipe(
    recipe: Recipe,
    out: pathlib.Path,
    arena: Arena,
    *,
    report: Report = lambda stage, figures, gates: None,
    say: Callable[[str], None] = lambda line: None,
) -> bool:
    """Run a recipe from the state of its folder, until it is finished or stopped.

    Under torchrun all processes train; the first one alone does the rest.

    Args:
        recipe: the recipe.
        out: folder of the run.
        arena: runs policies, for a calibration.
        report: called in the first process after each iteration of a training or round of a calibration, with the name
            of the stage, figures, of which `progress` is the finished share of the stage, and the gates of a training.
        say: prints a line.

    Returns:
        Whether the recipe is finished; False if a signal stopped it.

    Raises:
        RecipeError: if the folder holds a run without a recipe, or a stage that began with other settings.
    """
    with distributed.process_group(), stopped_by_signals() as stop:
        leads = distributed.rank() == 0
        tell = say if leads else lambda line: None
        with sole_writer(out) if leads else contextlib.nullcontext():
            if leads and (out / CHECKPOINT_NAME).exists():
                raise RecipeError(f"{out} holds a run without a recipe; give another --out")
            works = [_Work(recipe, name, out, arena, stop, report, tell) for name in recipe.stages]
            for work in works:
                work.check()
            if leads:
                write_whole(out / RECIPE_NAME, recipe.source)
            try:
                for work in works:
                    work.run()
            except StoppedError:
                tell(f"stopped; the same command continues {out}")
                return False
            if leads:
                _finish(recipe, out)
    tell(f"finished; the policy is in {out}")
    return True


def _finish(recipe: Recipe, out: pathlib.Path) -> None:
    """Put the last policy, and the snapshot that led to it, into the folder of the run."""
    line = recipe.line(list(recipe.stages)[-1])
    for name in KINDS:
        files = [out / stage / name for stage in line if (out / stage / name).exists()]
        if files:
            write_whole(out / name, files[0].read_bytes())


@dataclasses.dataclass
class _Work:
    """A stage of a recipe, and its run in its folder."""

    recipe: Recipe
    name: str
    out: pathlib.Path
    arena: Arena
    stop: Stop
    report: Report
    say: Callable[[str], None]

    def __post_init__(self) -> None:
        self.stage: Stage = self.recipe.stages[self.name]
        self.folder = self.out / self.name
        self.seed = {} if self.stage.kind == "calibrate" else {"seed": self.recipe.seed}  # a calibration has its own
        # Without the defaults: a setting that a newer version adds changes no recipe.
        settings = TypeAdapter(Stage).dump_python(self.stage, mode="json", exclude_defaults=True)
        for name in (*OF_A_SESSION, *self.seed):
            settings[self.stage.kind].pop(name, None)
        if robot := settings[self.stage.kind].get("env", {}).get("robot"):
            settings[self.stage.kind]["env"]["robot"] = robot_label(robot)
        self.digest = digest(json.dumps(settings | self.seed, sort_keys=True))
        self.inputs = {
            setting: self.out / str(path) / TAKEN[setting] if str(path) in self.recipe.stages else path
            for setting, path in self.stage.inputs().items()
        }

    def run(self) -> None:
        """Run the stage, unless it is finished, and write its record."""
        leads = distributed.rank() == 0
        self.stop.check()
        if self.stage.kind == "train":
            distributed.barrier()  # the first process makes what this stage takes
        elif not leads:
            return
        if read_record(self.folder / RECORD) is not None:
            return
        self.folder.mkdir(parents=True, exist_ok=True)
        processes = distributed.size() if self.stage.kind == "train" else 1
        spent = _Spent(self.folder, self.digest, processes) if leads else None
        config = replaced(self.stage.config, {**self.inputs, **self.seed})
        if isinstance(config, TrainConfig):
            steps, discarded, figures = self._train(config, spent)
        else:
            steps, discarded, figures = self._calibrate(config, spent)
        if spent is None:
            return
        spent.write()
        self._write_record(config.seed, steps, discarded, figures, spent)
        self.say(f"{self.name}: finished, {spent.core_seconds / 3600.0:.2f} core-hours")
        for path in [*self.folder.glob("checkpoint*"), self.folder / SPENT, self.folder / ROUNDS]:
            path.unlink(missing_ok=True)
        shutil.rmtree(self.folder / BEST_FOLDER, ignore_errors=True)

    def check(self) -> None:
        """Raise RecipeError if the stage began with other settings."""
        finished = read_record(self.folder / RECORD)
        begun = finished.settings if finished is not None else _Spent.begun(self.folder)
        if begun is not None and begun != self.digest:
            raise RecipeError(
                f"the recipe has changed since stage {self.name} began. Give another --out, or remove "
                f"{self.folder} and the folders of the stages after it, to make them again"
            )

    def _train(self, config: TrainConfig, spent: "_Spent | None") -> tuple[float, float, dict[str, float | None]]:
        resumed = (self.folder / CHECKPOINT_NAME).exists()
        start = None if resumed else config.start_from
        trainer = Trainer(
            dataclasses.replace(config, out=self.folder, resume=resumed, start_from=start, hours=_NO_LIMIT)
        )
        trainer.stop = self.stop
        if trainer.remark:
            self.say(trainer.remark)

        def report(row: dict[str, float], gates: dict[str, str]) -> None:
            if spent is not None:
                spent.write()
            self.report(self.name, row | {"progress": min(1.0, trainer.run_steps / config.steps)}, gates)

        trainer.run(report)
        if trainer.run_steps < config.steps:
            raise StoppedError
        steps = trainer.best.get("steps", trainer.steps) - trainer.begin["steps"]
        if spent is not None and trainer.best:  # in the first process only: others know the best after a resumption
            for name in KINDS:
                write_whole(self.folder / name, (self.folder / BEST_FOLDER / name).read_bytes())
        return steps, trainer.run_steps - steps, dict(trainer.best)

    def _calibrate(self, config: CalibrationConfig, spent: "_Spent | None") -> tuple[float, float, dict[str, Any]]:
        def noted(found: _Found) -> _Found:
            if spent is not None:
                spent.write()
            self.stop.check()
            return found

        def on_round(number: int, error: float) -> None:
            self.say(f"{self.name}: round {number} of {config.rounds}, mean error {error:.4f}")
            self.report(self.name, {"progress": (number + 1.0) / (config.rounds + 1.0)}, {})

        executed, stop = self.arena.executed, self.arena.stop
        arena = Arena(lambda *given: noted(executed(*given)), lambda *given: noted(stop(*given)))
        return 0.0, 0.0, calibrate(config, self.folder, arena, on_round)

    def _write_record(
        self, seed: int, steps: float, discarded: float, figures: Mapping[str, float | None], spent: "_Spent"
    ) -> None:
        """Write how the files were made into them and beside them; the record beside them marks the stage finished."""
        given = {setting: str(source) for setting, source in self.stage.inputs().items()}
        parents = {}
        for setting, path in self.inputs.items():
            kind = KINDS[TAKEN[setting]]
            if given[setting] in self.recipe.stages:
                parents[setting] = Parent(stage=given[setting], digest=content_digest(path, kind))
            else:
                parents[setting], _ = origin(path, kind)
        files = [self.folder / name for name in KINDS if (self.folder / name).exists()]
        record = StageRecord(
            stage=self.name,
            kind=self.stage.kind,
            recipe=self.recipe.name,
            settings=self.digest,
            seed=seed,
            commits=tuple(spent.commits),
            versions=versions(),
            steps=steps,
            discarded_steps=discarded,
            core_seconds=spent.core_seconds,
            figures=dict(figures),
            parents=parents,
            outputs={path.name: content_digest(path, KINDS[path.name]) for path in files},
            ended=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        )
        ancestry = Ancestry(recipe=self.recipe.source, stages=(*self._ancestors(), record))
        for path in files:
            seal(path, ancestry)
        content = TypeAdapter(StageRecord).dump_python(record, mode="json")
        write_whole(self.folder / RECORD, json.dumps(content, indent=1) + "\n")

    def _ancestors(self) -> Sequence[StageRecord]:
        """Return the records of the stages that led to this one: those of a file from outside, then the recipe's."""
        line = self.recipe.line(self.name)
        outside = [
            record
            for setting, source in self.recipe.stages[line[-1]].inputs().items()
            for record in origin(source, KINDS[TAKEN[setting]])[1]
        ]
        records = [read_record(self.out / name / RECORD) for name in reversed(line[1:])]
        return [*outside, *(record for record in records if record is not None)]


class _Spent:
    """What all sessions have spent on a stage so far, and with which code.

    Attributes:
        commits: commits of the source tree.
    """

    def __init__(self, folder: pathlib.Path, settings: str, processes: int) -> None:
        self._path, self._settings, self._processes = folder / SPENT, settings, processes
        before = json.loads(self._path.read_text()) if self._path.exists() else {"commits": [], "core_seconds": 0.0}
        self.commits = list(dict.fromkeys([*before["commits"], source_commit(policies=False)]))
        self._before, self._began = before["core_seconds"], _cpu_seconds()
        self.write()

    @staticmethod
    def begun(folder: pathlib.Path) -> str | None:
        """Return the digest of the settings with which a stage was begun; None if it was not."""
        path = folder / SPENT
        return json.loads(path.read_text())["settings"] if path.exists() else None

    @property
    def core_seconds(self) -> float:
        """Processor time of all sessions [s]; each process of a training counts like this one with its children."""
        return self._before + self._processes * (_cpu_seconds() - self._began)

    def write(self) -> None:
        """Write what was spent so far; what a process that is then killed has spent since is lost."""
        content = {"settings": self._settings, "commits": self.commits, "core_seconds": self.core_seconds}
        write_whole(self._path, json.dumps(content) + "\n")


def _cpu_seconds() -> float:
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)
