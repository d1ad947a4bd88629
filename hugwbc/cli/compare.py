"""`hugwbc compare`: one script, each controller, and what came of it: figures, a report, a replay and a video."""

import dataclasses
import pathlib
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

from hugwbc.cli.output import check_folder, check_writable, parse, progress, say, write_json
from hugwbc.commands import COMMAND_UNITS
from hugwbc.errors import ConfigError
from hugwbc.evaluation.tables import Table, format_table, hand_rows

if TYPE_CHECKING:
    from hugwbc.evaluation.comparison import Outcome
    from hugwbc.runtime.controllers import ControllerSpec
    from hugwbc.runtime.trace import Trace


@dataclasses.dataclass(frozen=True)
class CompareOptions:
    """Play one command script with each controller, hand targets solved by IK, and show how each did."""

    script: str = "loco_manipulation"
    """Name of a shipped script, or path of a script file (.yaml)."""
    walk: float | None = None
    """Play the script while walking ahead at this velocity [m/s], where it says nothing else."""
    controllers: tuple[str, ...] = ("learned", "qp")
    """Which controllers: learned, qp, hold, plug-ins' names, paths of policies or contracts (docs/evaluation.md), or
    with a policy of their own, as unitree-h1=motion.pt."""
    policy: str | None = None
    """Name of a shipped policy, or path of a policy file, for the learned controller."""
    seed: int = 0
    """Of the sensor noise."""
    noise: bool = False
    """Give the sensors a real robot's noise and latency, and estimate the state; else it is true and nothing random."""
    out: pathlib.Path = pathlib.Path("out/compare")
    """Folder for summary.json, report.html, replay.html and the video."""
    video: bool = True
    """Write a video where the machine can render one."""
    hide: tuple[Literal["hands", "steps", "forces", "balance", "phases"], ...] = ()
    """Layers of marks that the video does not show; replay.html has switches for them."""
    json: pathlib.Path | None = None
    """Write the summary to this file as well; without a path, to standard output."""


def run(words: Sequence[str]) -> int:
    """Parse, play, print, write."""
    options = parse(CompareOptions, words, "compare", CompareOptions.__doc__)
    from hugwbc.evaluation.comparison import check_names, compare, summarise
    from hugwbc.scripts.script import while_walking
    from hugwbc.scripts.script_file import load_script
    from hugwbc.viz.framing import check_count

    check_count(len(options.controllers))
    script = load_script(options.script)
    if options.walk is not None:
        script = while_walking(script, options.walk)
    controllers = [spec.build() for spec in _specs(options)]
    check_names(controllers)
    check_folder(options.out)
    check_writable(options.json)
    with progress(f"{script.name} with {', '.join(options.controllers)}") as advance:
        traces = compare(controllers, script, seed=options.seed, noise=options.noise, on_progress=advance)
    outcomes = {trace.name: summarise(trace) for trace in traces}
    summary = {
        "script": script.name,
        "duration": script.duration,
        "seed": options.seed,
        "noise": options.noise,
        "controllers": {name: dataclasses.asdict(outcome) for name, outcome in outcomes.items()},
    }
    rows = figure_rows(outcomes)
    say(format_table(("", *outcomes), rows), options.json)
    for name, outcome in outcomes.items():
        for message in outcome.safety["messages"]:
            say(f"safety filter of {name}: {message}", options.json)
    write_json(options.json, summary)
    written = _write_files(options, summary, Table("Figures", ("", *outcomes), rows), traces)
    say("\nwrote " + ", ".join(str(path) for path in written), options.json)
    return 0


def _specs(options: CompareOptions) -> list["ControllerSpec"]:
    """The controllers, the learned one with `--policy`.

    Raises:
        ConfigError: if there is a policy and nobody to take it.
    """
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


def figure_rows(outcomes: Mapping[str, "Outcome"]) -> list[tuple[Any, ...]]:
    """Name and unit of each figure, and its value of every controller."""
    rows: list[tuple[Any, ...]] = [
        ("fell", *(outcome.fell for outcome in outcomes.values())),
        ("survived [s]", *(outcome.survived_s for outcome in outcomes.values())),
    ]
    for name in next(iter(outcomes.values())).errors:
        label = f"error {name} [{COMMAND_UNITS[name]}]"
        rows.append((label, *(outcome.errors[name] for outcome in outcomes.values())))
    rows += hand_rows([outcome.hand_error_m for outcome in outcomes.values()])
    for part in ("p50", "p99"):
        rows.append((f"tick {part} [ms]", *(outcome.tick_ms[part] for outcome in outcomes.values())))
    for part in ("p50", "p99"):
        rows.append((f"hand IK {part} [ms]", *(outcome.ik_ms[part] for outcome in outcomes.values())))
    rows.append(("control steps", *(outcome.steps for outcome in outcomes.values())))
    return [*rows, ("footsteps", *(outcome.footsteps for outcome in outcomes.values()))]


def _write_files(
    options: CompareOptions, summary: Mapping[str, Any], figures: Table, traces: Sequence["Trace"]
) -> list[pathlib.Path]:
    """Write everything that there is to show, and return the paths."""
    from hugwbc.report.comparison_page import summary_table, write_report
    from hugwbc.viz.replay import write_replay

    out = options.out
    title = f"hugwbc compare: {summary['script']}"
    write_json(out / "summary.json", summary)
    safety = {name: outcome["safety"] for name, outcome in summary["controllers"].items()}
    counters = {name: {k: v for k, v in report.items() if k != "messages"} for name, report in safety.items()}
    tables = [figures, summary_table("Safety filter", counters)]
    links = {"Replay in three dimensions": "replay.html", "Figures as JSON": "summary.json"}
    write_replay(out / "replay.html", traces, title=title)
    written = [out / "summary.json", out / "report.html", out / "replay.html"]
    if options.video:
        written += _write_video(options, traces)
    sensors = f"Sensors with noise, seed {options.seed}." if options.noise else "Exact sensors, nothing random."
    write_report(out / "report.html", title, traces, tables, subtitle=sensors, links=links)
    return written


def _write_video(options: CompareOptions, traces: Sequence["Trace"]) -> list[pathlib.Path]:
    """The video's path if the machine could render it; otherwise a line says why not."""
    from hugwbc.viz.video import write_video

    path = options.out / "compare.mp4"
    with progress("video") as advance:
        obstacle = write_video(path, traces, hide=options.hide, on_progress=advance)
    if obstacle is None:
        return [path]
    say(obstacle, options.json)
    return []
