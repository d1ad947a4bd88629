"""The interface of a protocol: one object that runs an experiment, describes its result and gives its figures.

A new protocol is a subclass in a file of this folder and an entry in `hugwbc.evaluation.protocols.PROTOCOLS`. The
command line takes its options from `settings`, and the report its sections, tables and pictures from the object.
Protocols must not import that registry: stored results depend on all code that a protocol imports, and a change to one
protocol would then invalidate the results of all others.
"""

import abc
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, ClassVar, Generic, TypeVar

from hugwbc.evaluation.engine import ControllerFactory, EpisodePlan, Judge, Row
from hugwbc.evaluation.figures import Figure
from hugwbc.evaluation.intervals import Estimate, wilson_of
from hugwbc.evaluation.picture_data import Picture
from hugwbc.evaluation.protocols.episodes import GaitSettings, ProtocolResult, run_episodes

Settings = TypeVar("Settings", bound=GaitSettings)
Result = TypeVar("Result", bound=ProtocolResult[Any])
Measured = tuple[str, Mapping[str, Any]]  # a controller's label, and the result of a protocol as JSON


class Protocol(abc.ABC, Generic[Settings, Row, Result]):
    """An experiment for any controller, with the texts and pictures of its result.

    Class attributes:
        name: name on the command line and in reports.
        summary: a line for `hugwbc evaluate --help`.
        settings: dataclass of its settings. Each field is an option of the command line, explained by its entry in the
            docstring, and its default is the option's default.
        fixed: fields of `Conditions` and of the settings that the protocol sets itself; they are not options.
        stores_episodes: whether episodes are stored and shared between workers, as `run_episodes` does.
        ablation: whether the report also runs it with policies of other trainings, as the paper's ablation does.
        report_title: heading of its section in the report; empty for a protocol that the report leaves out.
        report_text: how its figures are measured.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    settings: type[Settings]
    fixed: ClassVar[frozenset[str]] = frozenset()
    stores_episodes: ClassVar[bool] = True
    ablation: ClassVar[bool] = False
    report_title: ClassVar[str] = ""
    report_text: ClassVar[str] = ""

    @abc.abstractmethod
    def run(
        self, factory: ControllerFactory, settings: Settings, on_episode: Callable[[Row], None] | None = None
    ) -> Result:
        """Run the experiment.

        Args:
            factory: makes the controller; it must be picklable if there is more than one worker.
            settings: of the protocol.
            on_episode: called with the row of every finished episode, in order.
        """

    @abc.abstractmethod
    def describe(self, result: Result) -> str:
        """Return the result as text for a terminal."""

    def total(self, settings: Settings) -> int:
        """Return the number of episodes in all, for the progress; of a search, about how many there will be."""
        return int(getattr(settings, "episodes", 1))

    def unavailable(self) -> str:
        """Return why this installation cannot run it, as a sentence for a report; empty if it can."""
        return ""

    def for_training(self, settings: Settings, training: str | None) -> Settings:
        """Return the settings for a controller, given what moved the arms in its training (None: nothing is known)."""
        return settings

    def quick(self) -> Sequence[Settings]:
        """Return the settings of its runs in the report's quick profile: few and short episodes."""
        return ()

    def full(self) -> Sequence[Settings]:
        """Return the settings of its runs in the report's full profile: the paper's sizes."""
        return ()

    def figures(self, controller: str, result: Mapping[str, Any]) -> list[Figure]:
        """Return the report's figures of one result, given as JSON, with the paper's values."""
        return []

    def published(self, measured: Sequence[Measured]) -> list[Figure]:
        """Return figures that stand in the same tables as the measured ones but were not measured here."""
        return []

    def across(self, results: Mapping[str, Sequence[Measured]]) -> list[Figure]:
        """Return figures that take the results of other protocols as well, for the tables of `figures`.

        Args:
            results: results of all protocols by their names.
        """
        return []

    def pictures(self, measured: Sequence[Measured], controllers: Sequence[str]) -> Sequence[Picture]:
        """Return the report's pictures of all results.

        Args:
            measured: the results of this protocol.
            controllers: labels of the report's controllers, in the order of their colours.
        """
        return []


class PlannedProtocol(Protocol[Settings, Row, Result]):
    """A protocol whose episodes are all planned before the first one runs.

    Class attributes:
        result: dataclass of its result.
    """

    result: type[Result]

    @abc.abstractmethod
    def plans(self, settings: Settings) -> Sequence[EpisodePlan]:
        """Return the plan of every episode."""

    @abc.abstractmethod
    def judge(self, settings: Settings) -> Judge[Row]:
        """Return what makes a row of numbers from each episode; it must be picklable."""

    @abc.abstractmethod
    def summarise(self, settings: Settings, rows: Sequence[Row]) -> Mapping[str, Any]:
        """Return the fields of the result that follow from the rows of all episodes."""

    def total(self, settings: Settings) -> int:
        """Return the number of episodes in all; `settings.episodes` may be that of each group."""
        return len(self.plans(settings))

    def run(
        self, factory: ControllerFactory, settings: Settings, on_episode: Callable[[Row], None] | None = None
    ) -> Result:
        """Run all planned episodes, those with stored rows excepted, and summarise them; arguments as in `Protocol`."""
        rows = run_episodes(factory, self.plans(settings), self.judge(settings), settings, on_episode)
        return self.result.of(factory, settings, rows, **self.summarise(settings, rows))


INTERVAL = "95 % interval"
INTERVAL_NOTE = "95 % intervals: of means by bootstrap over episodes; of falls, in brackets, Wilson's score interval"


def beside_paper(name: str, value: float | None, estimate: Estimate | None, paper: float | None) -> tuple[object, ...]:
    """Return a table row: name, measured value, its interval, the paper's value, and the ratio of the two values.

    The values have four decimals; with the paper's three some of them would print as zero.
    """
    ratio = value / paper if value is not None and paper else None
    return name, four_decimals(value), interval_text(estimate), four_decimals(paper), ratio


def interval_text(estimate: Estimate | None, decimals: int = 4) -> str | None:
    """Format the bounds of an interval; None without bounds."""
    if estimate is None or estimate.low is None or estimate.high is None:
        return None
    return f"{estimate.low:.{decimals}f} to {estimate.high:.{decimals}f}"


def count_text(times: int, count: int, noun: str = "episodes") -> str:
    """Say in how many episodes something happened, with its percentage and score interval."""
    share = wilson_of(times, count)
    if share.value is None:
        return f"{times} of {count} {noun}"
    return f"{times} of {count} {noun} ({share.value:.1f} %) [{share.low:.1f}, {share.high:.1f}]"


def four_decimals(value: float | None) -> str | None:
    """Format a value with four decimals; None stays None."""
    return None if value is None else f"{value:.4f}"


def failure_lines(rows: Iterable[Any]) -> list[str]:
    """Return a line that counts the controller's exceptions over all rows, nothing if there were none."""
    count = sum(row.failures for row in rows)
    return [f"the controller raised {count} exceptions, which the safety filter caught"] if count else []
