"""Which controllers and protocols a report is about: what to run, and what to say of how it was made."""

import dataclasses
import functools
import pathlib
from collections.abc import Sequence

from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.evaluation.engine import Cell, CellResult
from hugwbc.evaluation.protocols import all_protocols
from hugwbc.evaluation.protocols.intervention import TRAINED
from hugwbc.learned.policy import shipped_policies
from hugwbc.learned.policy.records import versions
from hugwbc.report.profiles import profile_cells
from hugwbc.report.report_page import Report, all_figures
from hugwbc.report.training_curve import TRAINING_FILE, read_training
from hugwbc.runtime.controllers import ControllerSpec
from hugwbc.seeds import REPORT_SEED
from hugwbc.viz.framing import check_count


@dataclasses.dataclass(frozen=True)
class ReportPlan:
    """The subject of a report.

    Attributes:
        profile: a key of `profiles.PROFILES`.
        controllers: 1 to 4 controllers, as `ControllerSpec.parse` takes them.
        ablation: policies that take part only in the protocols of the ablation, by name or path; None for the shipped
            ones of a training that no controller has.
        protocols: names of the protocols; all of the profile if empty.
        seed: seed of all protocols.

    Raises:
        ConfigError: if controllers are too many, too few or not unique, the training record cannot be used, or a
            protocol needs what is not installed.
        UnknownNameError: if there is no such profile, controller or protocol.
    """

    profile: str
    controllers: tuple[str, ...]
    ablation: tuple[str, ...] | None = None
    protocols: tuple[str, ...] = ()
    seed: int = REPORT_SEED

    def __post_init__(self) -> None:
        check_count(len(self.controllers), "controllers")
        labels = [spec.label for spec in (*self.specs, *self.further)]
        if len(set(labels)) < len(labels):
            raise ConfigError(f"controllers are {labels}; give at least one, each once")
        protocols, known = all_protocols(), tuple(dict.fromkeys(cell.protocol for cell in self._all_cells))
        for name in self.protocols:
            if reason := protocols[name].unavailable() if name in protocols else "":
                raise ConfigError(reason)
            if name not in known:
                raise UnknownNameError("protocol of the report", name, known)
        if self.training is not None:  # now, and not only when all episodes have run
            read_training(self.training)

    @functools.cached_property
    def specs(self) -> list[ControllerSpec]:
        """The controllers."""
        return [ControllerSpec.parse(words) for words in self.controllers]

    @functools.cached_property
    def further(self) -> list[ControllerSpec]:
        """The policies that take part only in the protocols of the ablation."""
        if self.ablation is not None:
            return [ControllerSpec("learned", name) for name in self.ablation]
        trainings = {spec.training for spec in self.specs}
        shipped = [ControllerSpec("learned", name) for name in shipped_policies()]
        return [spec for spec in shipped if spec.training not in trainings]

    @functools.cached_property
    def _all_cells(self) -> list[Cell]:
        return profile_cells(self.profile, self.specs, self.further, seed=self.seed)

    @property
    def cells(self) -> list[Cell]:
        """What to run: each chosen protocol with each controller."""
        return [cell for cell in self._all_cells if not self.protocols or cell.protocol in self.protocols]

    @functools.cached_property
    def training(self) -> pathlib.Path | None:
        """The training record of the first learned policy that has one."""
        records = (file.parent / TRAINING_FILE for spec in self.specs for file in spec.files())
        return next((path for path in records if path.is_file()), None)

    def report(self, results: Sequence[CellResult]) -> Report:
        """Build the report from the results of all cells."""
        labels = [spec.label for spec in self.specs]
        episodes = sum(len(entry.result["rows"]) for entry in results)
        return Report(all_figures(results), results, labels, self._notes(episodes), self.training)

    def _notes(self, episodes: int) -> list[str]:
        """Say how the report was made, and what it lacks."""
        words = [f"--profile {self.profile}", f"--controllers {' '.join(self.controllers)}", f"--seed {self.seed}"]
        words += [f"--ablation {' '.join(self.ablation)}"] if self.ablation is not None else []
        words += [f"--protocols {' '.join(self.protocols)}"] if self.protocols else []
        made = ", ".join(f"{name} {version}" for name, version in versions().items())
        notes = [f"Made by `hugwbc report {' '.join(words)}`: {episodes} episodes in simulation, with {made}."]
        if self.profile == "quick":
            notes.append(
                "The quick profile has few and short episodes: its intervals are wide, and of very few episodes too "
                "narrow. `--profile full` has the paper's sizes."
            )
        for protocol in all_protocols().values():
            reason = protocol.unavailable()
            if protocol.report_title and reason and not self.protocols:
                notes.append(f"The section '{protocol.report_title}' is missing: {reason}.")
        trainings = {spec.training for spec in (*self.specs, *self.further)}
        missing = [words for training, words in TRAINED.items() if training not in trainings]
        ablation = {name for name, protocol in all_protocols().items() if protocol.ablation}
        if missing and (not self.protocols or ablation & set(self.protocols)):
            notes.append(f"Of the paper's ablation there is no policy {', nor '.join(missing)}: see `--ablation`.")
        return notes
