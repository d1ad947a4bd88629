"""The runs of a report, and its statement of how it was made.

The paper says how long an episode is (1000 steps of 20 ms), but not how many its tables average over; the full profile
takes 256 for each gait, and for each intervention.
"""

import dataclasses
import functools
from typing import Any, Literal

from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.evaluation.experiment import Result
from hugwbc.evaluation.study import Entry, run_study
from hugwbc.learned.policy.records import versions
from hugwbc.report.report_page import Report, sections
from hugwbc.runtime.controllers import ControllerSpec, labels
from hugwbc.settings import REPORT_SEED
from hugwbc.sim.engine import check_seed
from hugwbc.source import short_commit
from hugwbc.viz.framing import check_count


@dataclasses.dataclass(frozen=True)
class ReportPlan:
    """The subject of a report."""

    profile: Literal["quick", "full"]  # quick, with few and short episodes; or full, with the paper's sizes
    controllers: tuple[str, ...]  # 1 to 4 controllers, as `ControllerSpec.parse` takes them
    experiments: tuple[str, ...] = ()  # names of the experiments; all with a section if empty
    seed: int = REPORT_SEED  # seed of all experiments

    def __post_init__(self) -> None:
        check_count(len(self.controllers), "controllers")
        check_seed(self.seed)
        _ = self.labels
        known = {experiment.name: section for experiment, section in sections()}
        for name in self.experiments:
            if name not in known:
                raise UnknownNameError("experiment of the report", name, known)
            if reason := known[name].unavailable():
                raise ConfigError(reason)

    @functools.cached_property
    def specs(self) -> list[ControllerSpec]:
        """The controllers."""
        return [ControllerSpec.parse(words) for words in self.controllers]

    @functools.cached_property
    def labels(self) -> dict[ControllerSpec, str]:
        """What each controller is called."""
        return dict(zip(self.specs, labels(self.specs), strict=True))

    @functools.cached_property
    def entries(self) -> list[Entry]:
        """What to run, all controllers side by side, so that an early stop leaves pairs."""
        return [
            Entry(experiment, dataclasses.replace(settings, seed=self.seed), spec, self.labels[spec])
            for experiment, section in sections()
            if (not self.experiments or experiment.name in self.experiments) and not section.unavailable()
            for settings in (section.quick() if self.profile == "quick" else section.full())
            for spec in self.specs
        ]

    def run(self, **options: Any) -> Report:  # noqa: ANN401
        """Run what is not stored yet, and build the report; the options are those of `run_study`."""
        results = run_study(self.entries, **options)
        return Report(results, [self.labels[spec] for spec in self.specs], self._notes(results))

    def _notes(self, results: list[Result]) -> list[str]:
        """Say how the report was made, and what it lacks."""
        words = [f"--profile {self.profile}", f"--controllers {' '.join(self.controllers)}", f"--seed {self.seed}"]
        words += [f"--experiments {' '.join(self.experiments)}"] if self.experiments else []
        made = ", ".join(f"{name} {version}" for name, version in versions().items())
        episodes = sum(len(result.rows) for result in results)
        notes = [
            f"Made by `hugwbc report {' '.join(words)}`: {episodes} episodes in simulation, at commit "
            f"{short_commit()} with {made}."
        ]
        if self.profile == "quick":
            notes.append(
                "The quick profile has few and short episodes: its intervals are wide, and of very few episodes too "
                "narrow. `--profile full` has the paper's sizes."
            )
        if not self.experiments:
            missing = [(section.title, section.unavailable()) for _, section in sections()]
            notes += [f"The section '{title}' is missing: {reason}." for title, reason in missing if reason]
        return notes
