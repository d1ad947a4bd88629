"""Ticks at states that make no sense: every one ends in a solution or a named fallback."""

import pytest

from hugwbc.benchmarks.absurd_states import KINDS, main, measure
from hugwbc.mbc.whole_body import Output


@pytest.mark.parametrize("kind", KINDS)
def test_every_tick_has_a_named_outcome(kind):
    times = measure(kind, 10, seed=1)
    assert sum(times.outputs.values()) == times.ticks == 10
    assert set(times.outputs) <= {output.value for output in Output}
    assert 0.0 < times.median <= times.p99 <= times.longest


def test_the_command_prints_a_line_for_each_kind(capsys):
    assert main(["--ticks", "3"]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == list(KINDS)
    with pytest.raises(SystemExit):
        main(["--ticks", "0"])
