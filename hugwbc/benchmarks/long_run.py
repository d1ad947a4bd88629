"""Does a robot that runs for hours need ever more memory? `python -m hugwbc.benchmarks.long_run --minutes 60`.

In one process, each gait runs in episodes of 20 s with random commands: controller, estimator and simulation stay, as
in a program of a user. The first episode fills caches; what counts is by how much the peak of the memory grows from
there to the end. Falls end an episode, and are counted.
"""

import argparse
import dataclasses
import resource
import sys

import numpy as np

from hugwbc.commands import Command, sample_all
from hugwbc.errors import HugwbcError
from hugwbc.gait import Gait
from hugwbc.runtime import Constant, load_controller, rollout
from hugwbc.runtime.estimation import estimator_for
from hugwbc.sim import ARENAS

EPISODE = 20.0  # [s]


@dataclasses.dataclass(frozen=True)
class LongRun:
    """A gait that ran for long.

    Attributes:
        ticks: number of ticks of the controller.
        falls: number of episodes that ended in a fall.
        growth: growth of the peak of the memory after the first episode, as a share of it.
    """

    ticks: int
    falls: int
    growth: float


def run(controller_name: str, gait: Gait, minutes: float, seed: int) -> LongRun:
    """Run a gait in arena 2.

    Args:
        controller_name: of the controller.
        gait: one gait.
        minutes: simulated time, rounded up to whole episodes but for falls.
        seed: of the commands and of the sensors' errors.

    Raises:
        HugwbcError: if the controller cannot be loaded.
    """
    rng, arena = np.random.default_rng(seed), ARENAS[2]
    controller, estimator = load_controller(controller_name), estimator_for(arena)
    simulation = arena.simulation(seed=seed)
    seconds, ticks, falls, first = 0.0, 0, 0, 0
    while seconds < 60.0 * minutes:
        command = Command.from_array(sample_all(gait, rng, 1)[0], gait)
        trace = rollout(controller, Constant(command), simulation, duration=EPISODE, estimator=estimator)
        seconds, ticks, falls = seconds + simulation.time, ticks + len(trace.time), falls + trace.fell
        first = first or resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return LongRun(ticks, falls, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / first - 1.0)


def main(words: list[str] | None = None) -> int:
    """Run all gaits with each controller, and print a line of each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--controllers", nargs="+", default=["learned", "qp"], help="names (default: %(default)s)")
    parser.add_argument("--minutes", type=float, default=2.0, help="simulated time of each gait (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=1000, help="seed (default: %(default)s)")
    options = parser.parse_args(words)
    if not 0.0 < options.minutes < float("inf") or options.seed < 0:
        parser.error("give a time above 0 and a seed from 0")
    try:
        for name in options.controllers:
            for gait in Gait:
                r = run(name, gait, options.minutes, options.seed)
                sys.stdout.write(f"{name}, {gait.label}: {r.ticks} ticks, {r.falls} falls, memory {r.growth:+.2%}\n")
                sys.stdout.flush()
    except HugwbcError as error:
        parser.error(str(error))
    return 0


if __name__ == "__main__":
    sys.exit(main())
