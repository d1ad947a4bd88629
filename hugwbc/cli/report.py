"""`hugwbc report`: the tables and figures of the paper, for any controllers, as a page and CSV."""

import dataclasses
import pathlib
from collections.abc import Sequence
from typing import Literal

from hugwbc.cli.output import output_folder, parse, progress, remark, say
from hugwbc.evaluation.execution import Execution
from hugwbc.evaluation.store import DEFAULT_FOLDER, Store
from hugwbc.settings import REPORT_SEED


@dataclasses.dataclass(frozen=True)
class ReportOptions:
    """Run the paper's experiments and some of ours with each controller; write figures beside the paper's."""

    # quick: few episodes, about 8 minutes on two cores. full: the paper's sizes; on two cores hours for a policy, days
    # for qp.
    profile: Literal["quick", "full"] = "quick"
    # Controllers, as --controller of `hugwbc evaluate`, or with a policy of their own, as learned=runs/mine or
    # unitree-h1=motion.pt; the first two are compared with each other
    controllers: tuple[str, ...] = ("learned", "qp")
    experiments: tuple[str, ...] = ()  # Run only these experiments; by default all of the report
    seed: int = REPORT_SEED  # Seed of all experiments
    workers: int = 2  # Number of processes that share the episodes
    cluster: str | None = None  # Address of a Dask scheduler that runs the episodes instead. Needs the extra [cluster].
    # Folder in which finished episodes are stored; those already stored are not run again
    results: pathlib.Path = DEFAULT_FOLDER
    fresh: bool = False  # Run all episodes again; the new rows take the place of the stored ones
    out: pathlib.Path = pathlib.Path("out/report")  # Folder for report.html and figures.csv


def run(words: Sequence[str]) -> int:
    """Parse, run what is not stored yet, and write the report."""
    options = parse(ReportOptions, words, "report")
    from hugwbc.report.report_plan import ReportPlan

    plan = ReportPlan(options.profile, options.controllers, options.experiments, options.seed)
    execution, store = Execution(options.workers, cluster=options.cluster), Store(options.results, fresh=options.fresh)
    with output_folder(options.out), output_folder(options.results):
        with progress(f"report, {options.profile}") as advance, execution:
            report = plan.run(
                execution=execution, store=store, on_progress=advance, tell=lambda text: remark(f"report: {text}")
            )
        paths = report.write(options.out)
    say(report.summary)
    say(f"\nwrote {', '.join(map(str, paths))}")
    return 0
