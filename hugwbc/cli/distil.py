"""`hugwbc distil`: one policy from several, each the teacher of a gait."""

from collections.abc import Sequence

from hugwbc.cli.imitate import closing, reporter
from hugwbc.cli.output import output_folder, parse_settings, progress
from hugwbc.learned.config import DistillationConfig

_LINE_SAMPLES = 100_000


def run(words: Sequence[str]) -> int:
    """Parse the options, distil, report."""
    description = "Fit one network to several policies, each the teacher of a gait, on the student's own states."
    config = parse_settings(DistillationConfig, words, "distil", description)
    from hugwbc.learned.imitation import Distiller

    with output_folder(config.out), progress(f"distillation {config.out}") as advance:
        distiller = Distiller(config)
        distiller.run(reporter(config.samples, _LINE_SAMPLES, advance))
    return closing(distiller.samples, config.samples, config.out)
