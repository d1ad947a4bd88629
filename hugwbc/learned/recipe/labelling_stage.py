"""Stages that collect labels: imitation of the QP, and distillation of several policies into one.

A leg of the work ends with everything on the disk: labels in a file of the leg's own, networks and moments in one file.
A run that was killed goes on from the end of its last leg, and its result is that of an uninterrupted run.
"""

import pathlib
import time
from typing import Any

from hugwbc.learned.imitation import Distiller, Imitator
from hugwbc.learned.policy import checkpoint
from hugwbc.learned.recipe.recipe_records import LABELS, usual_file
from hugwbc.learned.recipe.stage_work import Outcome, StageWork, write_state
from hugwbc.robot import load_robot

_LEG, _LABELS = "leg.safetensors", "leg-*-labels.safetensors"


def run_labelling(work: StageWork) -> Outcome:
    """Collect labels and fit a network to them, leg by leg, as the stage's settings say.

    Raises:
        StoppedError: if the run was asked to stop.
        PolicyFileError: if a file of an earlier leg is damaged.
    """
    stage, folder = work.stage, work.folder
    keep = {"keep_labels": _takes_labels(work)} if stage.kind == "imitate" else {}
    config = stage.config(own={"out": folder, "seed": work.seed(), **keep, **work.paths})
    dagger: Imitator | Distiller
    if stage.kind == "imitate":
        dagger = Imitator(config, work.services.teacher(load_robot(config.env.robot)))
    else:
        dagger = Distiller(config)
    # Counts of labels by leg, and how many of the first legs are no longer in the memory.
    state: dict[str, Any] = {"counts": [], "dropped": 0, "seconds": 0.0}
    if (folder / _LEG).exists():
        tensors, state = checkpoint.load_file(folder / _LEG, "leg")
        dagger.load_state(tensors)
        kept = range(state["dropped"], len(state["counts"]))
        parts = (checkpoint.load_file(_labels(folder, leg), "leg labels")[0] for leg in kept)
        # A leg with more labels than the memory holds has stored its newest ones only.
        stored = sum(min(count, dagger.memory.capacity) for count in state["counts"][state["dropped"] :])
        dagger.memory.restore(parts, sum(state["counts"]) - stored)
    last = dagger.samples

    def report(figures: dict[str, float]) -> None:
        nonlocal last
        work.session.work(labels=figures["samples"] - last)
        last = int(figures["samples"])
        work.progress(min(1.0, figures["samples"] / config.samples))
        work.stop.check()

    for leg in range(len(state["counts"]), stage.segments):
        begin, before = time.monotonic(), dagger.samples
        dagger.begin_leg(leg)
        dagger.advance(min(stage.end_of(leg), config.samples), report)
        counts = [*state["counts"], dagger.samples - before]
        checkpoint.save_file(_labels(folder, leg), dagger.memory.newest(counts[-1]), "leg labels", {})
        dropped = state["dropped"]
        while dropped < len(counts) and sum(counts[dropped + 1 :]) >= dagger.memory.capacity:
            dropped += 1  # a later leg alone fills the memory
        state = {"counts": counts, "dropped": dropped, "seconds": state["seconds"] + time.monotonic() - begin}
        work.session.write()  # what the file holds is in the ledger before
        # One file, so that networks and counts cannot disagree.
        checkpoint.save_file(folder / _LEG, dagger.state(), "leg", state)
        write_state(folder, {"progress": dagger.progress, "labels": dagger.samples})
        for old in range(dropped):
            _labels(folder, old).unlink(missing_ok=True)
        work.say(f"{stage.name}: {dagger.samples} of {config.samples:.0f} labels")
    dagger.write(state["seconds"])
    return Outcome(labels=float(dagger.samples), seeds=(config.seed,))


def _takes_labels(work: StageWork) -> bool:
    """Return whether a later stage takes the labels themselves; they are many, and written only then."""
    sources = [
        source if "/" in source else f"{source}/{usual_file(name, work.recipe.stage(source))}"
        for stage in work.recipe.stages
        for name, source in stage.inputs.items()
    ]
    return f"{work.stage.name}/{LABELS}" in sources


def clean_labelling(folder: pathlib.Path) -> None:
    """Remove what only an unfinished stage needs."""
    for path in [*folder.glob(_LABELS), folder / _LEG]:
        path.unlink(missing_ok=True)


def _labels(folder: pathlib.Path, leg: int) -> pathlib.Path:
    return folder / _LABELS.replace("*", f"{leg:03d}")
