"""Sentences that follow from the figures: none of them is typed in."""

from collections import Counter
from collections.abc import Iterable, Sequence

from hugwbc.evaluation.report.figures import Figure, Verdict, against

_GOOD = (Verdict.BETTER, Verdict.UNCLEAR_BETTER)
_MOST_NAMED = 4  # quantities in one sentence


def conclusions(figures: Sequence[Figure], first: str, second: str) -> list[str]:
    """What the figures say of each table against the paper, and of two controllers against each other."""
    tables = list(dict.fromkeys(figure.table for figure in figures))
    lines = [line for name in (first, second) for line in _overall(figures, name)]
    for table in tables:
        lines += _duel([figure for figure in figures if figure.table == table], first, second)
    lines += _total_duel(figures, first, second)
    return lines


def _overall(figures: Sequence[Figure], controller: str) -> list[str]:
    """A controller against the paper, over all tables that have the paper's figures."""
    compared = [f for f in figures if f.controller == controller and f.verdict is not Verdict.NONE]
    if not compared:
        return []
    counts = Counter(figure.verdict for figure in compared)
    better = sum(counts[verdict] for verdict in _GOOD)
    worse = [figure for figure in compared if figure.verdict not in _GOOD]
    line = (
        f"Against the paper, {controller} is as good or better in {better} of {len(compared)} figures, worse in "
        f"{len(worse)}, of which {counts[Verdict.UNCLEAR_WORSE]} by less than the uncertainty."
    )
    if worse:
        worst = sorted(worse, key=lambda figure: -_ratio(figure))[:_MOST_NAMED]
        named = "; ".join(f"{f.quantity} ({f.table}) × {_ratio(f):.2g}" for f in worst)
        line += f" Furthest behind: {named}."
    return [line]


def _ratio(figure: Figure) -> float:
    assert figure.ratio is not None
    return figure.ratio[0]


def _pairs(figures: Iterable[Figure], first: str, second: str) -> list[tuple[Figure, Verdict]]:
    """The figures of the first controller that the second one has as well, and how they compare."""
    others = {(f.table, f.quantity): f for f in figures if f.controller == second}
    mine = [f for f in figures if f.controller == first and (f.table, f.quantity) in others]
    pairs = [(figure, against(figure, others[figure.table, figure.quantity])) for figure in mine]
    return [(figure, verdict) for figure, verdict in pairs if verdict is not Verdict.NONE]


def _duel(figures: Sequence[Figure], first: str, second: str) -> list[str]:
    """Two controllers in one table."""
    pairs = _pairs(figures, first, second)
    if not pairs:
        return []
    wins = [figure.quantity for figure, verdict in pairs if verdict is Verdict.BETTER]
    losses = [figure.quantity for figure, verdict in pairs if verdict is Verdict.WORSE]
    won = f"{first} is better in {_listed(wins)}" if wins else ""
    lost = f"{second} {'' if wins else 'is better '}in {_listed(losses)}" if losses else ""
    parts = [won, lost]
    rest = len(pairs) - len(wins) - len(losses)
    if rest:
        parts.append(f"{rest} of {len(pairs)} figures are not told apart")
    return [f"{figures[0].table}: {'; '.join(part for part in parts if part)}."]


def _total_duel(figures: Sequence[Figure], first: str, second: str) -> list[str]:
    counts = Counter(verdict for _, verdict in _pairs(figures, first, second))
    total = sum(counts.values())
    if not total:
        return []
    unclear = counts[Verdict.UNCLEAR_BETTER] + counts[Verdict.UNCLEAR_WORSE]
    return [
        f"In all {total} figures that both have, {first} is better in {counts[Verdict.BETTER]}, {second} in "
        f"{counts[Verdict.WORSE]}; {unclear} are not told apart."
    ]


def _listed(names: Sequence[str]) -> str:
    more = len(names) - _MOST_NAMED
    shown = ", ".join(names[:_MOST_NAMED])
    return f"{shown} and {more} more" if more > 0 else shown
