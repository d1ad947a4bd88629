"""`hugwbc imitate`: a policy that imitates the controller `qp`, for reinforcement learning to start from."""

import pathlib
from collections.abc import Callable, Sequence

from hugwbc.cli import INTERRUPTED
from hugwbc.cli.output import output_folder, parse_settings, progress, say
from hugwbc.learned.config import ImitationConfig

_LINE_SAMPLES = 10_000


def run(words: Sequence[str]) -> int:
    """Parse, imitate, report."""
    description = "Imitate the controller qp on the student's states; 'hugwbc train --start-from' continues from it."
    config = parse_settings(ImitationConfig, words, "imitate", description)
    from hugwbc.learned.imitation import Imitator
    from hugwbc.mbc import WholeBodyController
    from hugwbc.robot import load_robot

    with output_folder(config.out), progress(f"imitation {config.out}") as advance:
        robot = load_robot(config.env.robot)
        if config.env.drives == "ideal":
            robot = robot.with_ideal_drives()
        imitator = Imitator(config, lambda period: WholeBodyController(period=period, robot=robot))
        imitator.run(reporter(config.samples, _LINE_SAMPLES, advance))
    return closing(imitator.samples, config.samples, config.out)


def reporter(total: float, interval: float, advance: Callable[[float], None]) -> Callable[[dict[str, float]], None]:
    """Return a callback that shows the progress of collecting labels.

    Args:
        total: number of labels to collect.
        interval: labels between two lines of figures.
        advance: moves the progress bar to a fraction.
    """
    falls, steps, last = 0.0, 0.0, 0.0

    def report(figures: dict[str, float]) -> None:
        nonlocal falls, steps, last
        advance(min(1.0, figures["samples"] / total))
        falls, steps = falls + figures["falls"], steps + figures["steps"]
        if figures["samples"] - last >= interval:
            say(
                f"labels {figures['samples']:.0f}  loss {figures['imitation_loss']:.3f}  "
                f"estimation {figures['estimation_loss']:.3f}  falls in 1000 steps {1000.0 * falls / steps:.2f}"
            )
            falls, steps, last = 0.0, 0.0, figures["samples"]

    return report


def closing(samples: int, asked: float, out: pathlib.Path) -> int:
    """Say how many labels there are and where the policy is; return the exit code.

    Args:
        samples: number of labels collected.
        asked: number that was asked for; with fewer, the work was stopped.
        out: folder of the policy.
    """
    if samples < asked:
        say(f"stopped after {samples} of {asked:.0f} labels; saved in {out}")
        return INTERRUPTED
    say(f"{samples} labels; saved in {out}")
    return 0
