"""`hugwbc check`: try every part of this installation and print what works."""

import dataclasses
from collections.abc import Sequence

from hugwbc.cli.output import parse, progress, say
from hugwbc.evaluation.installation import run_checks

CHECK_FAILED = 1


@dataclasses.dataclass(frozen=True)
class CheckOptions:
    """Verify the models, versions, controllers and the training environment; exit code 1 if anything is wrong."""


def run(words: Sequence[str]) -> int:
    """Run all checks and print a line for each."""
    parse(CheckOptions, words, "check", CheckOptions.__doc__)
    with progress("check") as advance:
        outcomes = run_checks(advance)
    failed = sum(not outcome.passed for outcome in outcomes)
    say("\n".join(f"{'ok   ' if outcome.passed else 'FAIL '} {outcome.name}: {outcome.text}" for outcome in outcomes))
    say("all is well" if not failed else f"{failed} of {len(outcomes)} checks failed")
    return CHECK_FAILED if failed else 0
