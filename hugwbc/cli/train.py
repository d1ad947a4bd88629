"""`hugwbc train`: reinforcement learning of a policy."""

import math
import time
from collections.abc import Callable, Sequence

from hugwbc.cli.output import output_folder, parse_settings, progress, say
from hugwbc.learned.config import TrainConfig

LINE_INTERVAL = 10.0  # [s] between two lines of figures


def run(words: Sequence[str]) -> int:
    """Parse the options, train, report."""
    description = "Train a policy. Ctrl-C saves and stops; --resume continues."
    config = parse_settings(TrainConfig, words, "train", description)
    with output_folder(config.out), progress(f"training {config.out}") as advance:
        from hugwbc.learned.rl import train

        trainer = train(config, _reporter(config.steps, advance), say)
    if trainer.leads:
        say(f"stopped after {trainer.iteration} iterations, {trainer.steps:.3g} steps; saved in {config.out}")
    return 0


def _reporter(total_steps: float, advance: Callable[[float], None]) -> Callable[[dict, dict], None]:
    last = -LINE_INTERVAL

    def report(figures: dict[str, float], gates: dict[str, str]) -> None:
        nonlocal last
        advance(figures["steps"] / total_steps)
        evaluation = {name: value for name, value in figures.items() if name.startswith("evaluation/")}
        if any(math.isfinite(value) for value in evaluation.values()):
            parts = [f"{name.removeprefix('evaluation/')} {value:.3f}" for name, value in evaluation.items()]
            say(f"evaluation at iteration {figures['iteration']:.0f}: {', '.join(parts)}")
        if time.monotonic() - last < LINE_INTERVAL:
            return
        last = time.monotonic()
        say(
            f"iteration {figures['iteration']:.0f}  steps {figures['steps']:.3g}  "
            f"{figures['steps_per_second']:.0f} steps/s  reward {figures['reward']:.3f}  "
            f"episode {figures['episode_length']:.0f} steps  falls {figures['falls']:.0f}  "
            + "; ".join(f"{gate}: {state}" for gate, state in gates.items())
        )

    return report
