"""`hugwbc compare`: play one script with each controller; write the figures, a report, a replay and a video."""

import dataclasses
import pathlib
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Literal

import tyro

from hugwbc.cli.output import check_writable, output_folder, parse_settings, progress, say, say_arena, write_json
from hugwbc.errors import ConfigError
from hugwbc.evaluation.tables import format_table
from hugwbc.seeds import REPORT_SEED
from hugwbc.sim import Arena

if TYPE_CHECKING:
    from hugwbc.controller import Controller
    from hugwbc.evaluation.tables import Table
    from hugwbc.runtime.controllers import ControllerSpec
    from hugwbc.runtime.trace import Trace
    from hugwbc.scripts.script import Script

    Played = tuple[list[Trace], Table, dict[str, Any]]
    Play = Callable[[list[Controller], Callable[[float], None]], Played]


@dataclasses.dataclass(frozen=True)
class CompareOptions:
    """Play one command script with each controller, hand targets solved by IK, and compare the results."""

    script: str = "loco_manipulation"
    """Name of a shipped script or behaviour, or path of a file (.yaml)."""
    scene: str | None = None
    """Objects around the robot: name of a shipped scene, or a file (.yaml)."""
    task: str | None = None
    """Do this task of the suite instead of a script (docs/tasks.md), such as fetch_box."""
    walk: float | None = None
    """Walk ahead at this velocity [m/s] wherever the script commands no walk of its own."""
    controllers: tuple[str, ...] = ("learned", "qp")
    """Controllers to compare: learned, qp, hold, the name of a plug-in, FILE.py:NAME, the path of a policy or contract
    (docs/evaluation.md); NAME=POLICY gives one its own policy, such as unitree-h1=motion.pt."""
    policy: str | None = None
    """Name of a shipped policy, or path of a policy file, for the learned controller."""
    seed: int = REPORT_SEED
    """Seed of the sensor noise."""
    out: pathlib.Path = pathlib.Path("out/compare")
    """Folder for summary.json, report.html, replay.html and the video."""
    video: bool = True
    """Write a video if the machine can render one."""
    hide: tuple[Literal["hands", "steps", "forces", "balance", "phases"], ...] = ()
    """Layers of marks to leave out of the video; replay.html has switches for them."""
    json: pathlib.Path | None = None
    """Write the summary to this file as well; without a path, to standard output."""
    arena: tyro.conf.OmitArgPrefixes[Arena] = dataclasses.field(default_factory=Arena)


def run(words: Sequence[str]) -> int:
    """Parse, play, print, write."""
    options = parse_settings(CompareOptions, words, "compare", CompareOptions.__doc__)
    from hugwbc.evaluation.comparison import check_names
    from hugwbc.report.comparison_page import write_comparison
    from hugwbc.viz.framing import check_count

    check_count(len(options.controllers), "controllers")
    play, script = (_task(options), None) if options.task is not None else _script(options)
    controllers = [spec.told(options.arena).build() for spec in _specs(options)]
    check_names(controllers)
    check_writable(options.json)
    say_arena(options.arena, options.json)
    with output_folder(options.out):
        with progress(f"{options.task or options.script} with {', '.join(options.controllers)}") as advance:
            traces, figures, summary = play(controllers, advance)
        say(format_table(figures.columns, figures.rows), options.json)
        for trace in traces:
            for message in trace.safety.messages:
                say(f"safety filter of {trace.name}: {message}", options.json)
        write_json(options.json, summary)
        written = write_comparison(options.out, summary, figures, traces, script=script)
        say("\nwrote " + ", ".join(str(path) for path in written), options.json)
        if options.video:
            _write_video(options, traces, script)
    return 0


def _script(options: CompareOptions) -> tuple["Play", "Script | None"]:
    """Return a player of the script for each controller, and the script if its segments have given times."""
    from hugwbc.behaviours import load_plan
    from hugwbc.evaluation.comparison import compare, comparison_summary, figure_table, summarise
    from hugwbc.scripts.script import Script, while_walking
    from hugwbc.sim import load_scene

    scene = None if options.scene is None else load_scene(options.scene)
    script = load_plan(options.script)
    if options.walk is not None:
        if not isinstance(script, Script):
            raise ConfigError("--walk is for timed scripts; a behaviour walks by itself")
        script = while_walking(script, options.walk)

    def play(controllers: list["Controller"], advance: Callable[[float], None]) -> "Played":
        traces = compare(controllers, script, seed=options.seed, arena=options.arena, scene=scene, on_progress=advance)
        outcomes = {trace.name: summarise(trace) for trace in traces}
        summary = comparison_summary(script, outcomes, seed=options.seed, arena=options.arena)
        return traces, figure_table(outcomes), summary

    return play, script if isinstance(script, Script) else None


def _task(options: CompareOptions) -> "Play":
    """Return a runner of the task for each controller."""
    from hugwbc.evaluation.comparison import compare_task, task_summary, task_table
    from hugwbc.tasks import load_task

    if options.script != CompareOptions.script or options.walk is not None or options.scene is not None:
        raise ConfigError("a task and a script, a walk or a scene are both given; give one or the other")
    task = load_task(str(options.task))

    def play(controllers: list["Controller"], advance: Callable[[float], None]) -> "Played":
        runs = compare_task(controllers, task, seed=options.seed, arena=options.arena, on_progress=advance)
        summary = task_summary(task, runs, seed=options.seed, arena=options.arena)
        return [run.trace for run in runs], task_table(runs), summary

    return play


def _specs(options: CompareOptions) -> list["ControllerSpec"]:
    """Return the controllers, the learned one with `--policy`."""
    from hugwbc.runtime.controllers import ControllerSpec

    specs = [ControllerSpec.parse(words) for words in options.controllers]
    if options.policy is None:
        return specs
    if ControllerSpec("learned") not in specs:
        raise ConfigError(
            f"--policy is for learned, and the controllers are {', '.join(options.controllers)}; add learned, or leave "
            "the policy out"
        )
    return [ControllerSpec("learned", options.policy) if spec == ControllerSpec("learned") else spec for spec in specs]


def _write_video(options: CompareOptions, traces: Sequence["Trace"], script: "Script | None") -> None:
    """Write the video and link it in the report; if the machine cannot render, print why."""
    from hugwbc.evaluation.segment_figures import segment_spans
    from hugwbc.report.comparison_page import link_video
    from hugwbc.viz.framing import Chapter
    from hugwbc.viz.video import write_video

    chapters = [] if script is None else [Chapter(begin, label) for label, begin, _ in segment_spans(script)]
    path = options.out / "compare.mp4"
    with progress("video, the pages are ready") as advance:
        obstacle = write_video(path, traces, hide=options.hide, chapters=chapters, on_progress=advance)
    if obstacle is None:
        link_video(options.out / "report.html", path)
    say(obstacle or f"wrote {path}", options.json)
