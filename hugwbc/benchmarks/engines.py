"""Do the controllers do the same in both physics engines? Errors and falls of single commands, side by side.

python -m hugwbc.benchmarks.engines                                    # the true state, ideal drives
python -m hugwbc.benchmarks.engines --sensing robot --drives real      # as every comparison runs
python -m hugwbc.benchmarks.engines --controllers qp --seeds 10        # one controller, more episodes

Every episode starts from a stand and gets one light push, whose direction and time depend on the seed. Without it,
all episodes with exact sensors would be the same.
"""

import argparse
import dataclasses
import sys
from collections.abc import Iterable, Sequence

import numpy as np

from hugwbc.commands import Command
from hugwbc.evaluation.metrics import tracking_errors
from hugwbc.gait import Gait
from hugwbc.robot import DEFAULT_ROBOT
from hugwbc.runtime.controllers import ControllerSpec
from hugwbc.runtime.estimation import estimator_for
from hugwbc.runtime.rollout import rollout
from hugwbc.scripts.command_source import Constant
from hugwbc.sim import Arena, Force
from hugwbc.sim.arena import ENGINES

COMMANDS = {
    "walk back": Command(v_x=-0.3, gait=Gait.WALKING),
    "walk": Command(v_x=0.5, gait=Gait.WALKING),
    "walk fast": Command(v_x=1.0, gait=Gait.WALKING),
    "turn": Command(omega=0.5, gait=Gait.WALKING),
    "squat": Command(h=-0.2, gait=Gait.STANDING),
    "stand": Command(gait=Gait.STANDING),
}
FIGURES = {"v_x": "m/s", "v_y": "m/s", "omega": "rad/s"}
PUSH, PUSH_TIME = 50.0, 0.1  # [N], [s]: 5 N*s, or 0.08 m/s


@dataclasses.dataclass(frozen=True)
class Episode:
    """One episode in one engine.

    Attributes:
        controller: name of the controller.
        command: name of the command.
        engine: name of the engine.
        seed: seed of the push and of the sensors' errors.
        fell: whether the robot fell.
        errors: mean absolute errors of the measured commands by name.
    """

    controller: str
    command: str
    engine: str
    seed: int
    fell: bool
    errors: dict[str, float]


def episode(controller: str, command: str, engine: str, seed: int, arena: Arena, duration: float) -> Episode:
    """Run a controller with one of `COMMANDS` in one of `ENGINES`.

    Args:
        controller: name of the controller.
        command: name of the command.
        engine: name of the engine.
        seed: seed of the push and of the sensors' errors.
        arena: robot, drives, sensors and ground.
        duration: length of the episode [s].

    Raises:
        ConfigError: if the engine is not installed.
    """
    rng = np.random.default_rng(seed)
    angle, start = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(1.0, 2.0)
    push = Force((PUSH * np.cos(angle), PUSH * np.sin(angle), 0.0), start=start, duration=PUSH_TIME, link="pelvis")
    trace = rollout(
        ControllerSpec(controller).told(arena).build(),
        Constant(COMMANDS[command]),
        arena.simulation_in(ENGINES[engine], seed=seed),
        duration=duration,
        estimator=estimator_for(arena),
        forces=(push,),
    )
    return Episode(controller, command, engine, seed, trace.fell, tracking_errors(trace))


def table(episodes: Iterable[Episode]) -> str:
    """Return the errors of all commands in both engines, their ratios, and the falls, as a table in Markdown."""
    episodes = list(episodes)
    heads = [f"E_{name} [{unit}]: MuJoCo, PhysX, ratio" for name, unit in FIGURES.items()]
    lines = [f"| controller | command | {' | '.join(heads)} | falls: MuJoCo, PhysX |", "|---" * (len(heads) + 3) + "|"]
    for controller, command in dict.fromkeys((e.controller, e.command) for e in episodes):
        runs = [
            [e for e in episodes if (e.controller, e.command, e.engine) == (controller, command, engine)]
            for engine in ENGINES
        ]
        if not all(runs):
            continue
        cells = [controller, command]
        for name in FIGURES:
            one, other = (float(np.mean([run.errors[name] for run in group])) for group in runs)
            cells.append(f"{one:.4f}, {other:.4f}, {other / one:.2f}")
        cells.append(", ".join(f"{sum(run.fell for run in group)} of {len(group)}" for group in runs))
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main(words: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--controllers", nargs="+", default=["qp", "learned"], help="who is commanded")
    parser.add_argument("--commands", nargs="+", default=list(COMMANDS), choices=COMMANDS, help="what they are told")
    parser.add_argument("--seeds", type=int, default=3, help="episodes of each command in each engine")
    parser.add_argument("--duration", type=float, default=20.0, help="length of an episode [s]")
    parser.add_argument("--robot", default=DEFAULT_ROBOT, help="robot of models/h1/h1.yaml")
    parser.add_argument("--drives", default="ideal", help="ideal or real")
    parser.add_argument("--sensing", default="exact", help="exact or robot")
    options = parser.parse_args(words)
    arena = Arena(options.robot, options.drives, options.sensing, "firm")
    episodes = []
    for controller in options.controllers:
        for command in options.commands:
            for seed in range(options.seeds):
                for engine in ENGINES:
                    done = episode(controller, command, engine, seed, arena, options.duration)
                    episodes.append(done)
                    shown = ", ".join(f"{done.errors[name]:.4f}" for name in FIGURES)
                    fell = ", fell" if done.fell else ""
                    print(f"{controller}, {command}, {engine}, {seed}: {shown}{fell}", file=sys.stderr, flush=True)
    print(table(episodes))


if __name__ == "__main__":
    main()
