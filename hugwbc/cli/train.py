"""`hugwbc train`: reinforcement learning of a policy."""

import sys
from collections.abc import Sequence

from hugwbc.cli.output import parse
from hugwbc.learned.config import TrainConfig


def run(words: Sequence[str]) -> int:
    """Parse, train, report after every iteration."""
    description = "Train a policy; Ctrl-C saves and stops. Every setting of the training is an option."
    config = parse(TrainConfig, words, "train", description)
    from hugwbc.learned.train import train

    trainer = train(config, _report)
    print(f"stopped after {trainer.iteration} iterations, {trainer.steps:.3g} steps; saved in {config.out}")
    return 0


def _report(figures: dict[str, float], gates: dict[str, str]) -> None:
    line = (
        f"iteration {figures['iteration']:.0f}  steps {figures['steps']:.3g}  "
        f"{figures['steps_per_second']:.0f} steps/s  reward {figures['reward']:.3f}  "
        f"episode {figures['episode_length']:.0f} steps  falls {figures['falls']:.0f}"
    )
    words = "; ".join(f"{gate}: {state}" for gate, state in gates.items())
    print(f"{line}  {words}".rstrip(), file=sys.stderr, flush=True)
