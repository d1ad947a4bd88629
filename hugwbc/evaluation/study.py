"""A study: experiments with several controllers, and by how much these differ over the same episodes.

`hugwbc evaluate`, `compare`, `report` and the tables of the documents are studies.
"""

import dataclasses
import functools
import math
import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from hugwbc.errors import ConfigError
from hugwbc.evaluation.episode import Settings
from hugwbc.evaluation.execution import Execution
from hugwbc.evaluation.experiment import Experiment, Result, frame_of, run_experiment, stored_episodes
from hugwbc.evaluation.figures import Difference, Figure
from hugwbc.evaluation.intervals import FEW, Estimate, exact_test, paired_difference, wilson_of
from hugwbc.evaluation.store import Store
from hugwbc.runtime.controllers import ControllerSpec

TELLING = 6  # episodes that must differ, all in the same way, for an exact p below 0.05
_ROUNDING = 1e-9  # relative
_SHARE = "% of episodes"
Values = dict[tuple[str, str], dict[str, float]]
"""What each episode alone would give, by table and quantity of a figure, and by the episode's plan."""


@dataclasses.dataclass(frozen=True)
class Entry:
    """One experiment with one controller."""

    experiment: Experiment[Any]
    settings: Settings
    spec: ControllerSpec
    label: str = ""  # of the controller, where its own does not tell it from others

    @property
    def work(self) -> float:
        """The simulated seconds that are planned; a search takes more."""
        return len(self.experiment.plan(self.settings)) * self.settings.duration


def each_result(
    entries: Sequence[Entry],
    *,
    execution: Execution | None = None,
    store: Store | None = None,
    on_progress: Callable[[float], object] = lambda done: None,
    tell: Callable[[str], object] = lambda words: None,
) -> Iterator[Result]:
    """Run what is not stored, and yield a result for each entry, as `run_experiment` does, as soon as it is there.

    `on_progress` is called with the part of the work that is done, at first with what is stored; `tell` gets a line
    that says how much that is.

    Raises:
        ConfigError: if the conditions tell another robot, and neither an estimator nor a controller takes it.
    """
    _check_told(entries)
    counts = [stored_episodes(entry.experiment, entry.settings, entry.spec, store) for entry in entries]
    stored, planned = (sum(column) for column in zip(*counts, strict=True)) if counts else (0, 0)
    if stored:
        tell(f"{'all' if stored == planned else f'{stored} of'} {planned} episodes are stored")
    parts, works = [have / max(count, 1) for have, count in counts], [entry.work for entry in entries]

    def advance(number: int, part: float) -> None:
        parts[number] = part
        on_progress(sum(map(operator.mul, parts, works)) / (sum(works) or 1.0))

    if parts:
        advance(0, parts[0])
    for number, entry in enumerate(entries):
        result = run_experiment(
            entry.experiment,
            entry.settings,
            entry.spec,
            label=entry.label,
            execution=execution,
            store=store,
            on_progress=functools.partial(advance, number),
        )
        advance(number, 1.0)
        yield result


def _check_told(entries: Sequence[Entry]) -> None:
    """Refuse a told robot where no sensors need an estimator, and no controller takes a robot."""
    told = [entry for entry in entries if entry.settings.conditions.told is not None]
    if told and not any(entry.settings.conditions.chosen.estimates or entry.spec.takes_robot for entry in told):
        conditions = told[0].settings.conditions
        raise ConfigError(
            f"told is {conditions.told}, but with sensing {conditions.sensing} no state is estimated, and "
            f"{' and '.join(dict.fromkeys(entry.label or entry.spec.label for entry in told))} takes no robot; leave "
            "out --told or --sensing, or choose a controller that takes a robot, such as qp"
        )


def run_study(entries: Sequence[Entry], **options: Any) -> list[Result]:  # noqa: ANN401
    """Return the results of entries; the options are those of `each_result`.

    The figures of a controller have their difference from those of the first one with the same experiment and settings.
    """
    return _with_differences(entries, list(each_result(entries, **options)))


def _with_differences(entries: Sequence[Entry], results: Sequence[Result]) -> list[Result]:
    """Return the results; the figures of all but the first controller have their differences from the first one's."""
    keys, first, found = [(entry.experiment.name, repr(entry.settings)) for entry in entries], {}, []
    for key, entry, result in zip(keys, entries, results, strict=True):
        same = [other for other, of_key in zip(results, keys, strict=True) if of_key == key]
        figures = [*result.figures, *_never_happened(result, same)]
        result = dataclasses.replace(result, figures=figures)
        if keys.count(key) > 1:
            values = values_alone(entry.experiment, result)
            if key in first:
                figures = [_compared(figure, values, *first[key]) for figure in figures]
            else:
                first[key] = result, values
        found.append(dataclasses.replace(result, figures=figures))
    return found


def _never_happened(result: Result, others: Sequence[Result]) -> list[Figure]:
    """Return 0 % for what happened in episodes of other controllers alone, such as a reason of failures."""
    own = {(figure.table, figure.quantity) for figure in result.figures}
    counts = {
        f.table: f.estimate.samples for f in reversed(result.figures) if f.unit == _SHARE and f.estimate is not None
    }
    found = {}
    for figure in (figure for other in others for figure in other.figures):
        key = figure.table, figure.quantity
        if figure.unit == _SHARE and key not in own and figure.table in counts:
            estimate = wilson_of(0, counts[figure.table])
            found[key] = dataclasses.replace(figure, estimate=estimate, controller=result.controller, difference=None)
    return list(found.values())


def values_alone(experiment: Experiment[Any], result: Result) -> Values:
    """Return the figures of each episode alone; a figure that is a mean over episodes is the mean of these.

    A percentage of episodes that only those have in which something happened is 0 in the others.
    """
    rows, found, plans = frame_of(result.rows), Values(), dict[str, dict[str, float]]()
    for number, plan in enumerate(result.plans):
        for figure in experiment.figures(result.settings, rows[number : number + 1]):
            plans.setdefault(figure.table, {})[repr(plan)] = 0.0
            if figure.estimate is not None and figure.estimate.value is not None:
                found.setdefault((figure.table, figure.quantity), {})[repr(plan)] = figure.estimate.value
    for figure in result.figures:
        alone, every = found.get((figure.table, figure.quantity), {}), plans.get(figure.table, {})
        counted = figure.unit == _SHARE and figure.estimate is not None and figure.estimate.samples == len(every)
        if counted and {*alone.values()} <= {100.0}:
            found[figure.table, figure.quantity] = every | alone
    return found


def _compared(figure: Figure, values: Values, other: Result, theirs: Values) -> Figure:
    """Return a figure with its difference from another controller's, if it is a mean of the same episodes."""
    key = figure.table, figure.quantity
    same = next((f for f in other.figures if (f.table, f.quantity) == key and f.estimate is not None), None)
    if figure.estimate is None or same is None or same.estimate is None:
        return figure
    alone = values.get(key, {}), theirs.get(key, {})
    powers = _power(figure.estimate, alone[0]), _power(same.estimate, alone[1])
    both = [plan for plan in alone[0] if plan in alone[1]]
    if not all(powers) or not both:
        return figure
    mine, reference = ([found[plan] for plan in both] for found in alone)
    estimate, p = paired_difference(mine, reference, max(powers)), None
    if figure.unit.startswith("%") and {*mine, *reference} <= {0.0, 100.0}:
        # A bootstrap would give few episodes that agree an interval without width.
        signs = [a > b for a, b in zip(mine, reference, strict=True) if a != b]
        estimate, p = dataclasses.replace(estimate, low=None, high=None), exact_test(sum(signs), signs.count(False))
    judged = figure.judged and same.judged
    return dataclasses.replace(figure, difference=Difference(other.controller, estimate, p, judged))


def _power(estimate: Estimate, alone: Mapping[str, float]) -> int:
    """Return 1 for an estimate that is the mean of its episodes' own, 2 for their RMS, and 0 for anything else."""
    if estimate.value is not None and estimate.low is not None and alone:
        for power in (1, 2):
            mean = math.fsum(value**power for value in alone.values()) / len(alone)
            if math.isclose(mean, estimate.value**power, rel_tol=_ROUNDING, abs_tol=_ROUNDING):
                return power
    return 0


def remarks(results: Sequence[Result]) -> list[str]:
    """Say which results lack values of falls, and which figures rest on too few episodes for what is shown of them."""
    found: list[str] = []
    for result in results:
        if lost := _lost(result):
            found.append(
                f"{result.experiment}, {result.controller}: {lost} of {len(result.rows)} episodes fell and lack values "
                "that others have; means are without these."
            )
    figures = [figure for result in results for figure in result.figures]
    few = {
        figure.quantity: figure.estimate.samples
        for figure in figures
        if figure.estimate is not None and figure.estimate.low is not None and not figure.unit.startswith("% of")
        if figure.estimate.samples < FEW
    }
    if few:
        names, least = list(few), min(few.values())
        found.append(
            f"Too few episodes: {', '.join(names[:3])}{f' and {len(names) - 3} more' * (len(names) > 3)} rest on "
            f"{least}{' or more' * (max(few.values()) > least)} each; below {FEW} an interval is too narrow."
        )
    pairs = [figure.difference.estimate.samples for figure in figures if figure.difference and figure.difference.p]
    if pairs and max(pairs) < TELLING:
        found.append(
            f"Too few episodes: percentages of {max(pairs)} pairs cannot be told apart; p < 0.05 takes {TELLING} "
            "episodes that differ."
        )
    return found


def _lost(result: Result) -> int:
    """Return how many episodes fell and lack a value that an upright one of the same case has.

    Episodes whose tags have the same texts are of one case; those of another case may measure something else.
    """
    cases = [tuple(tag for tag in plan.tags.values() if isinstance(tag, str)) for plan in result.plans]
    rows = list(zip(cases, result.rows, strict=True))
    measured = {(case, name) for case, row in rows if not row.get("fell") for name in row if row[name] is not None}
    return sum(
        any(row.get(name) is None for of, name in measured if of == case) for case, row in rows if row.get("fell")
    )
