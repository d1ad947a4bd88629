"""`hugwbc compare`: one run with each controller, with report, replay and video; or many, with a table for a paper."""

import dataclasses
import pathlib
from collections.abc import Sequence
from typing import Any, Literal

import tyro

from hugwbc.behaviours import Behaviour, load_plan
from hugwbc.cli import evaluate, output
from hugwbc.cli.output import progress, say
from hugwbc.commands import Command
from hugwbc.errors import ConfigError
from hugwbc.evaluation import comparison, study
from hugwbc.evaluation.comparison import segment_spans
from hugwbc.evaluation.experiment import Experiment
from hugwbc.evaluation.experiments import EXPERIMENTS, experiment_of
from hugwbc.evaluation.tables import format_table
from hugwbc.gait import Gait
from hugwbc.report.comparison_page import COMPARISON_FILES, REPORT, link_video, write_comparison
from hugwbc.report.paper_table import PAIRED_NOTE, PAPER_FILES, write_paper
from hugwbc.runtime.controllers import ControllerSpec, labels
from hugwbc.runtime.trace import Trace
from hugwbc.scripts.script import Script, while_walking
from hugwbc.settings import REPORT_SEED
from hugwbc.sim import Arena, load_scene
from hugwbc.tasks import Task, load_task
from hugwbc.viz.framing import Chapter, check_count
from hugwbc.viz.video import write_video

_VIDEO = "compare.mp4"
_FILES = (*COMPARISON_FILES, _VIDEO, *PAPER_FILES)  # with one run of each controller, or with many


@dataclasses.dataclass(frozen=True)
class CompareOptions:
    """Play one command script, or one task, with each controller, and compare the results.

    With `--experiment NAME`, or with `--task` and `--episodes`, an experiment of `hugwbc evaluate` runs with each
    instead: figures with intervals and paired differences, as table.tex, figures.csv and figure.svg.
    `hugwbc compare --experiment NAME --help` lists its options.
    """

    script: str = "loco_manipulation"  # Shipped script or behaviour, file (.yaml), or FILE.py:NAME
    scene: str | None = None  # Objects around the robot: name of a shipped scene, or a file (.yaml)
    task: str | None = None  # Do a task instead: one of the suite, such as fetch_box, or FILE.py (docs/tasks.md)
    walk: float | None = None  # Walk ahead at this velocity [m/s] wherever the script commands no walk of its own
    # Controllers to compare: learned, qp, hold, the name of a plug-in, FILE.py:NAME, the path of a policy or contract
    # (docs/evaluation.md); NAME=POLICY gives one its own policy, such as unitree-h1=motion.pt
    controllers: tuple[str, ...] = ("learned", "qp")
    seed: int = REPORT_SEED  # Seed of the sensor noise, and of what varies in the scene
    out: pathlib.Path = pathlib.Path("out/compare")  # Folder for summary.json, report.html, replay.html and the video
    video: bool = True  # Write a video if the machine can render one
    # Layers of marks to leave out of the video; replay.html has switches for them
    hide: tuple[Literal["hands", "steps", "forces", "balance", "phases"], ...] = ()
    json: pathlib.Path | None = None  # Write the summary to this file as well; without a path, to standard output
    arena: tyro.conf.OmitArgPrefixes[Arena] = dataclasses.field(default_factory=Arena)


@dataclasses.dataclass(frozen=True)
class TableOptions:
    """Which controllers are compared, and where the table goes."""

    # controllers as of `hugwbc compare`; differences are from the first one
    controllers: tuple[str, ...] = CompareOptions.controllers
    out: pathlib.Path = CompareOptions.out  # folder for table.tex, figures.csv and figure.svg


def run(words: Sequence[str]) -> int:
    """Parse, play or measure, print, write."""
    names = {word.partition("=")[0] for word in words}
    return _measure(words) if names & {"--experiment", "--episodes"} else _play(words)


def _measure(words: Sequence[str]) -> int:
    """Run an experiment with each controller, and write a table with their differences."""
    experiment, words = _experiment(words)
    options = evaluate.parse_options(f"compare --experiment {experiment.name}", experiment, words, TableOptions)
    chosen, place = options.controller, options.execution
    check_count(len(chosen.controllers), "controllers")
    specs = [ControllerSpec.parse(words) for words in chosen.controllers]
    entries = [
        study.Entry(experiment, options.experiment, spec, label)
        for spec, label in zip(specs, labels(specs), strict=True)
    ]
    output.check_writable(place.json)
    with output.output_folder(chosen.out):
        results = evaluate.measured(entries, place)
        tables = evaluate.tables_of(results)
        notes = [PAIRED_NOTE.format(results[0].controller), *evaluate.notes(entries, results)]
        evaluate.say_figures(tables, notes, place.json)
        output.write_json(place.json, [evaluate.to_json(result) for result in results])
        written = write_paper(chosen.out, results, tables, notes)
    say("\nwrote " + ", ".join(map(str, written)), place.json)
    _say_left(chosen.out, written, place.json)
    return 0


def _experiment(words: Sequence[str]) -> tuple[Experiment[Any], list[str]]:
    """Return the experiment that the words name, tasks where they name a task, and the other words."""
    name, others = output.take(words, "compare", "--experiment", nargs="?", const="")
    if name:
        return experiment_of(name), others
    if name is not None:
        raise ConfigError(f"--experiment needs a name; experiments are {', '.join(EXPERIMENTS)}")
    if not any(word.partition("=")[0] == "--task" for word in words):
        raise ConfigError("--episodes is for a task or an experiment; add --task or --experiment, or leave it out")
    return EXPERIMENTS["tasks"], others


def _play(words: Sequence[str]) -> int:
    options = output.parse_settings(CompareOptions, words, "compare")
    check_count(len(options.controllers), "controllers")
    played = _task(options) if options.task is not None else _script(options)
    scene = None if options.scene is None else load_scene(options.scene)
    script = played if isinstance(played, Script) else None
    specs = [ControllerSpec.parse(words) for words in options.controllers]
    controllers = {label: spec.told(options.arena).build() for label, spec in zip(labels(specs), specs, strict=True)}
    output.check_writable(options.json)
    output.say_arena(options.arena, options.json)
    with output.output_folder(options.out):
        settings: dict[str, Any] = {"seed": options.seed, "arena": options.arena}
        with progress(f"{options.task or options.script} with {', '.join(controllers)}") as advance:
            runs = comparison.compare(controllers, played, **settings, scene=scene, on_progress=advance)
        traces, outcomes = [run.trace for run in runs], {run.trace.name: run.outcome for run in runs}
        figures = comparison.figure_table(outcomes)
        summary = comparison.comparison_summary(played, outcomes, **settings, scene=options.scene)
        say(format_table(figures.columns, figures.rows), options.json)
        for trace in traces:
            for message in trace.safety.messages:
                say(f"safety filter of {trace.name}: {message}", options.json)
            for problem in trace.problems:
                say(f"scene of {trace.name}: {problem}", options.json)
        output.write_json(options.json, summary)
        written = write_comparison(options.out, summary, figures, traces, script=script)
        say("\nwrote " + ", ".join(str(path) for path in written), options.json)
        if options.video:
            written += _write_video(options, traces, script)
        _say_left(options.out, written, options.json)
    return 0


def _say_left(folder: pathlib.Path, written: Sequence[pathlib.Path], json: pathlib.Path | None) -> None:
    """Name the files of a comparison in a folder that this run has not written."""
    if left := [str(path) for path in map(folder.joinpath, _FILES) if path.exists() and path not in written]:
        say(f"left from an earlier run: {', '.join(left)}", json)


def _script(options: CompareOptions) -> Script | Behaviour:
    script = load_plan(options.script, options.arena.known_robot)
    if options.walk is None:
        return script
    if not isinstance(script, Script):
        raise ConfigError("--walk is for timed scripts; a behaviour walks by itself")
    robot = options.arena.known_robot
    Command.from_mapping({"v_x": options.walk}, Gait.WALKING, robot).validate(robot)
    return while_walking(script, options.walk)


def _task(options: CompareOptions) -> Task:
    if options.script != CompareOptions.script or options.walk is not None or options.scene is not None:
        raise ConfigError("a task and a script, a walk or a scene are both given; give one or the other")
    return load_task(str(options.task)).sized(options.arena.known_robot)


def _write_video(options: CompareOptions, traces: Sequence[Trace], script: Script | None) -> list[pathlib.Path]:
    """Write the video, link it in the report, and return its path; if the machine cannot render, print why."""
    chapters = [] if script is None else [Chapter(begin, label) for label, begin, _ in segment_spans(script)]
    path = options.out / _VIDEO
    with progress("video, the pages are ready") as advance:
        obstacle = write_video(path, traces, hide=options.hide, chapters=chapters, on_progress=advance)
    if obstacle is None:
        link_video(options.out / REPORT, path)
    say(obstacle or f"wrote {path}", options.json)
    return [path] if obstacle is None else []
