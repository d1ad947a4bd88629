"""`hugwbc compare`: play one script with each controller; write the figures, a report, a replay and a video."""

import dataclasses
import pathlib
from collections.abc import Sequence
from typing import Any, Literal

import tyro

from hugwbc.behaviours import Behaviour, load_plan
from hugwbc.cli import output
from hugwbc.cli.output import progress, say
from hugwbc.errors import ConfigError
from hugwbc.evaluation import comparison
from hugwbc.evaluation.segment_figures import segment_spans
from hugwbc.evaluation.tables import format_table
from hugwbc.report.comparison_page import link_video, write_comparison
from hugwbc.runtime.controllers import ControllerSpec
from hugwbc.runtime.trace import Trace
from hugwbc.scripts.script import Script, while_walking
from hugwbc.seeds import REPORT_SEED
from hugwbc.sim import Arena, load_scene
from hugwbc.tasks import Task, load_task
from hugwbc.viz.framing import Chapter, check_count
from hugwbc.viz.video import write_video


@dataclasses.dataclass(frozen=True)
class CompareOptions:
    """Play one command script with each controller, hand targets solved by IK, and compare the results."""

    script: str = "loco_manipulation"  # Shipped script or behaviour, file (.yaml), or FILE.py:NAME
    scene: str | None = None  # Objects around the robot: name of a shipped scene, or a file (.yaml)
    task: str | None = None  # Do a task instead: one of the suite, such as fetch_box, or FILE.py (docs/tasks.md)
    walk: float | None = None  # Walk ahead at this velocity [m/s] wherever the script commands no walk of its own
    # Controllers to compare: learned, qp, hold, the name of a plug-in, FILE.py:NAME, the path of a policy or contract
    # (docs/evaluation.md); NAME=POLICY gives one its own policy, such as unitree-h1=motion.pt
    controllers: tuple[str, ...] = ("learned", "qp")
    policy: str | None = None  # Name of a shipped policy, or path of a policy file, for the learned controller
    seed: int = REPORT_SEED  # Seed of the sensor noise, and of what varies in the scene
    out: pathlib.Path = pathlib.Path("out/compare")  # Folder for summary.json, report.html, replay.html and the video
    video: bool = True  # Write a video if the machine can render one
    # Layers of marks to leave out of the video; replay.html has switches for them
    hide: tuple[Literal["hands", "steps", "forces", "balance", "phases"], ...] = ()
    json: pathlib.Path | None = None  # Write the summary to this file as well; without a path, to standard output
    arena: tyro.conf.OmitArgPrefixes[Arena] = dataclasses.field(default_factory=Arena)


def run(words: Sequence[str]) -> int:
    """Parse, play, print, write."""
    options = output.parse_settings(CompareOptions, words, "compare", CompareOptions.__doc__)
    check_count(len(options.controllers), "controllers")
    played = _task(options) if options.task is not None else _script(options)
    scene = None if options.scene is None else load_scene(options.scene)
    script = played if isinstance(played, Script) else None
    controllers = [spec.told(options.arena).build() for spec in _specs(options)]
    comparison.check_names(controllers)
    output.check_writable(options.json)
    output.say_arena(options.arena, options.json)
    with output.output_folder(options.out):
        with progress(f"{options.task or options.script} with {', '.join(options.controllers)}") as advance:
            settings: dict[str, Any] = {"seed": options.seed, "arena": options.arena}
            if isinstance(played, Task):
                runs = comparison.compare_task(controllers, played, **settings, on_progress=advance)
                traces = [run.trace for run in runs]
                outcomes = {run.trace.name: comparison.summarise_task(run) for run in runs}
            else:
                outcomes: dict[str, dict[str, Any]] = {controller.name: {} for controller in controllers}
                traces = comparison.compare(
                    controllers,
                    played,
                    **settings,
                    scene=scene,
                    on_progress=advance,
                    on_end=lambda name, ending: outcomes[name].update(ending=ending),
                )
                for trace in traces:
                    outcomes[trace.name] |= comparison.summarise(trace)
        figures = comparison.figure_table(outcomes)
        summary = comparison.comparison_summary(played, outcomes, **settings)
        say(format_table(figures.columns, figures.rows), options.json)
        for trace in traces:
            for message in trace.safety.messages:
                say(f"safety filter of {trace.name}: {message}", options.json)
        output.write_json(options.json, summary)
        written = write_comparison(options.out, summary, figures, traces, script=script)
        say("\nwrote " + ", ".join(str(path) for path in written), options.json)
        if options.video:
            _write_video(options, traces, script)
    return 0


def _script(options: CompareOptions) -> Script | Behaviour:
    script = load_plan(options.script)
    if options.walk is None:
        return script
    if not isinstance(script, Script):
        raise ConfigError("--walk is for timed scripts; a behaviour walks by itself")
    return while_walking(script, options.walk)


def _task(options: CompareOptions) -> Task:
    if options.script != CompareOptions.script or options.walk is not None or options.scene is not None:
        raise ConfigError("a task and a script, a walk or a scene are both given; give one or the other")
    return load_task(str(options.task))


def _specs(options: CompareOptions) -> list[ControllerSpec]:
    """Return the controllers, the learned one with `--policy`."""
    specs = [ControllerSpec.parse(words) for words in options.controllers]
    if options.policy is None:
        return specs
    if ControllerSpec("learned") not in specs:
        raise ConfigError(
            f"--policy is for learned, and the controllers are {', '.join(options.controllers)}; add learned, or leave "
            "the policy out"
        )
    return [ControllerSpec("learned", options.policy) if spec == ControllerSpec("learned") else spec for spec in specs]


def _write_video(options: CompareOptions, traces: Sequence[Trace], script: Script | None) -> None:
    """Write the video and link it in the report; if the machine cannot render, print why."""
    chapters = [] if script is None else [Chapter(begin, label) for label, begin, _ in segment_spans(script)]
    path = options.out / "compare.mp4"
    with progress("video, the pages are ready") as advance:
        obstacle = write_video(path, traces, hide=options.hide, chapters=chapters, on_progress=advance)
    if obstacle is None:
        link_video(options.out / "report.html", path)
    say(obstacle or f"wrote {path}", options.json)
