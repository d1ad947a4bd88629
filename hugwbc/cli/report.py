"""`hugwbc report`: every table and figure of the paper, for any controllers, as a page, Markdown and CSV."""

import dataclasses
import pathlib
from collections.abc import Sequence
from typing import TYPE_CHECKING

from hugwbc.cli.output import check_folder, parse, progress, say
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.evaluation.engine import DEFAULT_FOLDER, ResultStore
from hugwbc.files import write_whole

if TYPE_CHECKING:
    from hugwbc.evaluation.engine import Cell
    from hugwbc.runtime.controllers import ControllerSpec


@dataclasses.dataclass(frozen=True)
class ReportOptions:
    """Run all protocols with each controller and write what came of it beside the paper's figures."""

    profile: str = "quick"
    """quick: few episodes, about 8 minutes on two cores. full: the paper's sizes; on two
    cores hours for a policy, days for the QP."""
    controllers: tuple[str, ...] = ("learned", "qp")
    """Which controllers, as --controller of `hugwbc evaluate`, or with a policy of their own, as learned=runs/mine and
    unitree-h1=motion.pt; the first two are held against each other."""
    ablation: tuple[str, ...] | None = None
    """Further policies, by name or path, in the protocols of intervention alone: the paper's ablation of what moved
    the arms in training, which a policy's file says. By default the shipped ones of a training that --controllers has
    no policy of."""
    protocols: tuple[str, ...] = ()
    """Only these protocols; by default all of the profile."""
    seed: int = 0
    """Of all protocols."""
    workers: int = 2
    """Processes that share the episodes."""
    cluster: str | None = None
    """Address of a Dask scheduler that runs the episodes instead. Needs the extra [cluster]."""
    results: pathlib.Path = DEFAULT_FOLDER
    """Folder where finished episodes are kept, and read from when they are asked for again."""
    fresh: bool = False
    """Run all episodes anew; the files of earlier results are kept under other names."""
    out: pathlib.Path = pathlib.Path("out/report")
    """Folder for report.html, report.md and figures.csv."""


def run(words: Sequence[str]) -> int:
    """Parse, run what is not stored yet, write."""
    options = parse(ReportOptions, words, "report", ReportOptions.__doc__)
    from hugwbc.evaluation.engine import Execution, run_cells
    from hugwbc.report.profiles import profile_cells
    from hugwbc.report.report_page import Report, report_markdown, report_page
    from hugwbc.report.sections import all_figures
    from hugwbc.report.written import figures_csv
    from hugwbc.runtime.controllers import ControllerSpec
    from hugwbc.viz.framing import check_count

    check_count(len(options.controllers))
    specs = [ControllerSpec.parse(words) for words in options.controllers]
    further = _further(specs, options.ablation)
    labels, others = ([spec.label for spec in some] for some in (specs, further))
    if len({*labels, *others}) < len(labels) + len(others):
        raise ConfigError(f"controllers are {[*labels, *others]}; give at least one, each once")
    cells = _wanted(profile_cells(options.profile, specs, further, seed=options.seed), options.protocols)
    training = _training_file(specs)
    store = ResultStore(options.results, fresh=options.fresh)
    execution = Execution(options.workers, cluster=options.cluster, store=store)
    check_folder(options.out)
    check_folder(options.results)
    with progress(f"report, {options.profile}") as advance, execution:
        results = run_cells(cells, execution, advance)
    total = sum(len(result.result["rows"]) for result in results)
    figures = all_figures(results)
    report = Report(figures, results, labels, _notes(options, total, [*specs, *further]), training)
    contents = {
        "report.html": report_page(report),
        "report.md": report_markdown(report),
        "figures.csv": figures_csv(figures),
    }
    for name, content in contents.items():
        write_whole(options.out / name, content)
    say("\n".join(report.conclusions()))
    say(f"\nwrote {', '.join(str(options.out / name) for name in contents)}")
    return 0


def _wanted(cells: Sequence["Cell"], protocols: Sequence[str]) -> list["Cell"]:
    """The cells of some protocols, all without names.

    Raises:
        UnknownNameError: if there is none of a protocol.
    """
    known = tuple(dict.fromkeys(cell.protocol for cell in cells))
    for name in protocols:
        if name not in known:
            raise UnknownNameError("protocol of the report", name, known)
    return [cell for cell in cells if not protocols or cell.protocol in protocols]


def _further(specs: Sequence["ControllerSpec"], ablation: tuple[str, ...] | None) -> list["ControllerSpec"]:
    """The policies of the ablation that are not among the controllers: those given, or the shipped ones."""
    from hugwbc.learned.policy.policy import shipped_policies
    from hugwbc.runtime.controllers import ControllerSpec

    if ablation is not None:
        return [ControllerSpec("learned", name) for name in ablation]
    trainings = {spec.training for spec in specs}
    shipped = [ControllerSpec("learned", name) for name in shipped_policies()]
    return [spec for spec in shipped if spec.training not in trainings]


def _notes(options: ReportOptions, episodes: int, specs: Sequence["ControllerSpec"]) -> list[str]:
    """How the report was made, and what it lacks."""
    from hugwbc.learned.policy.policy_contract import versions
    from hugwbc.report.ablation import PROTOCOLS, TRAINED

    words = [f"--profile {options.profile}", f"--controllers {' '.join(options.controllers)}", f"--seed {options.seed}"]
    words += [f"--ablation {' '.join(options.ablation)}"] if options.ablation is not None else []
    words += [f"--protocols {' '.join(options.protocols)}"] if options.protocols else []
    made = ", ".join(f"{name} {version}" for name, version in versions().items())
    notes = [f"Made by `hugwbc report {' '.join(words)}`: {episodes} episodes in simulation, with {made}."]
    if options.profile == "quick":
        notes.append(
            "The quick profile has few and short episodes: its intervals are wide, and of very few episodes too "
            "narrow. `--profile full` has the paper's sizes."
        )
    trainings = {spec.training for spec in specs}
    missing = [words for training, words in TRAINED.items() if training not in trainings]
    if missing and (not options.protocols or set(PROTOCOLS) & set(options.protocols)):
        notes.append(f"Of the paper's ablation there is no policy {', nor '.join(missing)}: see `--ablation`.")
    return notes


def _training_file(specs: Sequence["ControllerSpec"]) -> pathlib.Path | None:
    """The training record beside the first learned policy that has one.

    Raises:
        ConfigError: if it cannot be used: now, and not when all episodes have been run.
    """
    from hugwbc.report.training_curve import TRAINING_FILE, read_training

    for spec in specs:
        for file in spec.files():
            if (file.parent / TRAINING_FILE).is_file():
                read_training(file.parent / TRAINING_FILE)
                return file.parent / TRAINING_FILE
    return None
