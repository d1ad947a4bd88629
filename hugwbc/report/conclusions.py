"""Sentences and tables that are computed from the figures; none of them is written by hand."""

from collections import Counter
from collections.abc import Iterable, Sequence

from hugwbc.evaluation.figures import Figure, Verdict, against
from hugwbc.evaluation.tables import Table
from hugwbc.report.figure_tables import times

THE_PAPERS_COLUMN = (
    "The paper's column was not measured under our conditions: its policies were trained and tested in another "
    "simulator (Isaac Gym, 4096 environments), with wider randomisation, and with its own description of the robot "
    "(51.65 kg)."
)
THE_TEACHER = (
    "The QP helped the shipped policy: up to three in ten episodes of its training began in motion that the QP drove. "
    "It imitated no action of the QP."
)
SHIPPED = "learned"  # label of the shipped policy
_GOOD = (Verdict.BETTER, Verdict.UNCLEAR_BETTER)
_MOST_NAMED = 4  # quantities named in one sentence


def conclusions(figures: Sequence[Figure], first: str, second: str) -> list[str]:
    """Return sentences that compare two controllers with the paper, and with each other.

    Args:
        figures: figures of all tables.
        first: label of one controller.
        second: label of the other one; the same label for a report on a single controller.
    """
    lines = [line for name in dict.fromkeys((first, second)) for line in _overall(figures, name)]
    return lines if first == second else lines + _total_duel(figures, first, second)


def provenance(figures: Sequence[Figure], controllers: Sequence[str]) -> list[str]:
    """Return sentences on where the compared figures come from.

    Args:
        figures: figures of all tables.
        controllers: labels of the controllers; "learned" is the shipped policy.
    """
    lines = [THE_PAPERS_COLUMN] if any(figure.paper is not None for figure in figures) else []
    return [*lines, THE_TEACHER] if SHIPPED in controllers else lines


def _overall(figures: Sequence[Figure], controller: str) -> list[str]:
    """Compare a controller with the paper over all tables that have the paper's figures."""
    compared = [f for f in figures if f.controller == controller and f.verdict is not Verdict.NONE]
    if not compared:
        return []
    counts = Counter(figure.verdict for figure in compared)
    better = sum(counts[verdict] for verdict in _GOOD)
    worse = [figure for figure in compared if figure.verdict not in _GOOD]
    line = (
        f"Against the paper, {controller} is as good or better in {better} of {len(compared)} figures, worse in "
        f"{len(worse)} ({counts[Verdict.UNCLEAR_WORSE]} of them by less than the uncertainty)."
    )
    if worse:
        worst = sorted(worse, key=lambda figure: -_ratio(figure))[:_MOST_NAMED]
        named = "; ".join(
            f"{_name(f)} ({f.table}) {times(_ratio(f))}, {f.value:.3g} against {f.paper:.3g}" for f in worst
        )
        line += f" Furthest behind: {named}."
    return [line]


def _name(figure: Figure) -> str:
    return f"{figure.quantity} [{figure.unit}]" if figure.unit else figure.quantity


def _ratio(figure: Figure) -> float:
    assert figure.ratio is not None
    return figure.ratio[0]


def _pairs(figures: Iterable[Figure], first: str, second: str) -> list[tuple[Figure, Verdict]]:
    """Return the first controller's figures that the second one has as well, and how they compare."""
    others = {(f.table, f.quantity): f for f in figures if f.controller == second}
    mine = [f for f in figures if f.controller == first and (f.table, f.quantity) in others]
    pairs = [(figure, against(figure, others[figure.table, figure.quantity])) for figure in mine]
    return [(figure, verdict) for figure, verdict in pairs if verdict is not Verdict.NONE]


def duel_table(figures: Sequence[Figure], first: str, second: str) -> Table:
    """Return a table that lists, for each table of figures, where each of two controllers is clearly better."""
    rows = []
    for table in dict.fromkeys(figure.table for figure in figures):
        pairs = _pairs([figure for figure in figures if figure.table == table], first, second)
        wins = [_name(figure) for figure, verdict in pairs if verdict is Verdict.BETTER]
        losses = [_name(figure) for figure, verdict in pairs if verdict is Verdict.WORSE]
        if pairs:
            rows.append(
                (table, ", ".join(wins) or None, ", ".join(losses) or None, len(pairs) - len(wins) - len(losses))
            )
    return Table(
        f"{first} against {second}", ("", f"{first} is better", f"{second} is better", "too close to call"), rows
    )


def _total_duel(figures: Sequence[Figure], first: str, second: str) -> list[str]:
    counts = Counter(verdict for _, verdict in _pairs(figures, first, second))
    total = sum(counts.values())
    if not total:
        return []
    unclear = counts[Verdict.UNCLEAR_BETTER] + counts[Verdict.UNCLEAR_WORSE]
    return [
        f"In all {total} figures that both have, {first} is better in {counts[Verdict.BETTER]}, {second} in "
        f"{counts[Verdict.WORSE]}; {unclear} too close to call."
    ]
