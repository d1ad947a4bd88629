"""The run of a recipe: one stage after the other, each with a record, from wherever an earlier session ended."""

import dataclasses
import json
import pathlib
from collections.abc import Callable, Iterable, Mapping

from hugwbc.errors import HugwbcError, RecipeError
from hugwbc.files import write_whole
from hugwbc.learned.recipe.ancestry import (
    CHAIN_FILE,
    FORMAT,
    Discarded,
    Record,
    content_digest,
    lineage,
    read_record,
    seal,
    write_record,
)
from hugwbc.learned.recipe.closing_stages import (
    CALIBRATION,
    ONNX,
    UNCALIBRATED,
    run_calibration,
    run_evaluation,
    run_export,
)
from hugwbc.learned.recipe.forecast import forecast
from hugwbc.learned.recipe.labelling_stage import clean_labelling, run_labelling
from hugwbc.learned.recipe.ledger import Session, now, only_process
from hugwbc.learned.recipe.recipe_records import FIGURES, LABELS, POLICY, SNAPSHOT, STARTS, Recipe, Stage
from hugwbc.learned.recipe.run_folder import ABANDONED, PLAN_FILE, RunFolder
from hugwbc.learned.recipe.stage_work import Outcome, Services, StageWork
from hugwbc.learned.recipe.training_stage import TrainingStage, clean_training
from hugwbc.learned.stopping import Stop, StoppedError, stopped_by_signals

OUTPUTS = (POLICY, SNAPSHOT, STARTS, LABELS, FIGURES, CALIBRATION, UNCALIBRATED, ONNX)
RUNNERS: Mapping[str, Callable[[StageWork], Outcome]] = {
    "imitate": run_labelling,
    "train": lambda work: TrainingStage(work).run(),
    "distil": run_labelling,
    "calibrate": run_calibration,
    "evaluate": run_evaluation,
    "export": run_export,
}
CLEANERS: Mapping[str, Callable[[pathlib.Path], None]] = {
    "imitate": clean_labelling,
    "train": clean_training,
    "distil": clean_labelling,
}
_PLAN = ("schedules", "gates", "tables", "every", "score", "keep", "if_given_up")  # fields of a stage in its record
Progress = Callable[[float, float], None]


@dataclasses.dataclass(frozen=True)
class RunOptions:
    """How a recipe is run.

    Attributes:
        out: folder of the run.
        redo: stages to begin again, or "changed".
        workers: processes that evaluations share; None for the stages' own settings.
    """

    out: pathlib.Path
    redo: tuple[str, ...] = ()
    workers: int | None = None


def run_recipe(
    recipe: Recipe,
    options: RunOptions,
    services: Services,
    *,
    progress: Progress = lambda fraction, read: None,
    say: Callable[[str], None] = lambda line: None,
) -> bool:
    """Run a recipe from wherever its folder is, until it is finished or asked to stop.

    Args:
        recipe: the recipe.
        options: folder and what to begin again.
        services: the QP and the evaluations.
        progress: called with the fraction of the work that is done, and the fraction that earlier sessions did.
        say: prints a line.

    Returns:
        Whether the recipe is finished; False if it was stopped by a signal.

    Raises:
        RecipeError: if the run cannot go on; what was finished stays.
        HugwbcError: if a stage fails for another reason.
    """
    with only_process(options.out), stopped_by_signals() as stop:
        folder = RunFolder(options.out)
        session: Session | None = None
        try:
            aside = folder.prepare(recipe, options.redo)
            if aside:
                say(f"set aside in {options.out / ABANDONED}: {', '.join(aside)}")
            session = Session(options.out)
            _Run(recipe, options, services, folder, session, stop, progress, say).all_stages()
            session.end("finished")
        except StoppedError:
            assert session is not None
            session.end("stopped")
            return False
        except OSError as error:
            _end(session, f"error: {error.strerror}")
            raise RecipeError(
                f"cannot write to {options.out}: {error.strerror}. Every file there is whole; make room or give "
                "access, and run the same again: it goes on where it was"
            ) from error
        except HugwbcError as error:
            _end(session, f"error: {error}")
            raise
        except BaseException:
            _end(session, "interrupted")
            raise
    return True


def _end(session: Session | None, how: str) -> None:
    """Write the end of a session as far as that is still possible: the disk may be full."""
    try:
        if session is not None:
            session.end(how)
    except OSError:
        return


@dataclasses.dataclass
class _Run:
    recipe: Recipe
    options: RunOptions
    services: Services
    folder: RunFolder
    session: Session
    stop: Stop
    progress: Progress
    say: Callable[[str], None]

    def all_stages(self) -> None:
        costs = {one.stage: one.cpu_seconds for one in forecast(self.recipe, self.services)}
        everything = max(sum(costs.values()), 1e-9)
        write_whole(self.folder.path / PLAN_FILE, json.dumps(costs, indent=1) + "\n")
        done = read = 0.0
        for stage in self.recipe.stages:
            self.stop.check()
            cost = costs[stage.name] / everything
            if read_record(self.folder.stage(stage.name)) is None:
                read += self._stage(stage, cost, done, read)
            else:
                read += cost
                self._finish_files(stage)
            done += cost
            self.progress(min(done, 1.0), min(read, done, 1.0))

    def _stage(self, stage: Stage, cost: float, done: float, read: float) -> float:
        """Run one stage; return the share of all work that an earlier session has done of it.

        Args:
            stage: the stage.
            cost: its share of all work.
            done: share that is done before it.
            read: share that earlier sessions did.
        """
        begun: float | None = None

        def progress(fraction: float) -> None:
            nonlocal begun
            begun = fraction if begun is None else begun
            self.progress(done + cost * fraction, read + cost * begun)

        place = self.folder.stage(stage.name)
        place.mkdir(parents=True, exist_ok=True)
        inputs = self.folder.inputs(self.recipe, stage)
        self.session.enter(self.folder.key(stage.name))
        work = StageWork(
            self.recipe, stage, place, inputs, self.session, self.services, self.stop, progress, self.say,
            self.options.workers,
        )  # fmt: skip
        outcome = RUNNERS[stage.kind](work)
        self.session.enter(None)
        record = self._record(stage, outcome, inputs)
        write_record(place, record)
        self._finish_files(stage)
        spent = record.spent
        self.say(f"{stage.name}: {record.outcome}, {spent.core_hours:.2f} core-hours")
        return cost * (begun or 0.0)

    def _record(self, stage: Stage, outcome: Outcome, inputs: Mapping[str, pathlib.Path]) -> Record:
        place = self.folder.stage(stage.name)
        sessions = self.folder.sessions()
        mine = [one for one in sessions if any(key.rpartition("~")[0] == stage.name for key in one.spent)]
        spent = self.folder.spent_on_stage(stage.name, sessions)
        discarded = [*outcome.discarded, *_repeated(outcome, spent.steps, spent.labels)]
        parents = {}
        for name in stage.parents():
            parent = read_record(self.folder.stage(name))
            assert parent is not None  # its files were checked before the stage began
            parents[name] = parent.digest
        content = self.recipe.as_dict()
        own = next(one for one in content["stages"] if one["name"] == stage.name)
        return Record(
            stage=stage.name,
            kind=stage.kind,
            outcome=outcome.how,
            recipe=self.recipe.name,
            profile=self.recipe.profile,
            recipe_digest=self.recipe.digest,
            stage_digest=self.recipe.stage_digest(stage.name),
            seeds=outcome.seeds,
            commits=tuple(dict.fromkeys(one.commit for one in mine)),
            uncommitted_changes=any(one.uncommitted_changes for one in mine),
            versions=mine[-1].versions,
            settings=stage.resolved(),
            plan={key: own[key] for key in _PLAN} | ({"measure": content["measure"]} if stage.kind == "train" else {}),
            parents=parents,
            inputs={name: content_digest(path) for name, path in inputs.items()},
            outputs={name: content_digest(place / name) for name in OUTPUTS if (place / name).exists()},
            spent=spent,
            steps=outcome.steps,
            labels=outcome.labels,
            discarded=tuple(discarded),
            figures=outcome.figures,
            run_spent=self.folder.spent(),
            ended=now(),
        )

    def _finish_files(self, stage: Stage) -> None:
        """Write the records into the files of a finished stage, and remove what only an unfinished one needs.

        A process that was killed after the record was written has left this undone; doing it twice changes nothing.
        """
        place, records = self.folder.stage(stage.name), self.folder.records()
        own = records[stage.name]
        done = place / CHAIN_FILE
        if done.exists() and _names(done, own):
            return
        chain = lineage(own, records)
        for name in own.outputs:
            seal(place / name, chain)
        CLEANERS.get(stage.kind, lambda folder: None)(place)
        content = {"format": FORMAT, "records": [record.as_dict() for record in chain]}
        write_whole(done, json.dumps(content, indent=1) + "\n")


def _names(chain: pathlib.Path, record: Record) -> bool:
    """Return whether a stored chain ends with a record."""
    try:
        return json.loads(chain.read_text(encoding="utf-8"))["records"][-1] == record.as_dict()
    except (OSError, ValueError, KeyError, TypeError, IndexError):
        return False


def _repeated(outcome: Outcome, steps: float, labels: float) -> Iterable[Discarded]:
    """Yield what was done beyond the result and the known branches: repeated after kills, or begun again."""
    steps -= outcome.steps + sum(one.steps for one in outcome.discarded)
    labels -= outcome.labels + sum(one.labels for one in outcome.discarded)
    if steps > 0.5 or labels > 0.5:
        yield Discarded("repeated after an interruption, or begun again", max(steps, 0.0), max(labels, 0.0))
