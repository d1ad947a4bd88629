"""How long does the QP take over states that make no sense? `python -m hugwbc.benchmarks.absurd_states`.

Two kinds of states: absurd ones, with numbers up to 1e7, any orientation, and NaN or infinity in every tenth; and hard
ones, with every joint anywhere in its range, leaning by up to 0.8 rad about each axis, whose joints and pelvis move
fast at random. No robot walks through either.
"""

import argparse
import collections
import dataclasses
import sys
import time

import numpy as np

from hugwbc import rotations
from hugwbc.commands import Command
from hugwbc.controller import UpperBody
from hugwbc.gait import Gait
from hugwbc.mbc import WholeBodyController
from hugwbc.robot import Robot, load_robot
from hugwbc.state import RobotState

LONGEST = 2.0  # [ms], the QP's period
_EPISODE = 5  # states in a row before the controller is reset
_FIELDS = ("q", "dq", "orientation", "angular_velocity", "position", "velocity")


@dataclasses.dataclass(frozen=True)
class TickTimes:
    """Computing time of many ticks.

    Attributes:
        median, p99, longest: [ms] of the processor.
        late: number of ticks that took longer than 2 ms.
        ticks: number of all.
        outputs: number of ticks by where the joint command came from.
    """

    median: float
    p99: float
    longest: float
    late: int
    ticks: int
    outputs: dict[str, int]


def absurd_state(rng: np.random.Generator, robot: Robot) -> RobotState:
    """Return a state with numbers up to 1e7, in every tenth case with a NaN or an infinity."""
    scale, joints = 10.0 ** rng.uniform(0.0, 7.0), len(robot.joint_names)
    orientation = rng.normal(size=4)
    state = RobotState(
        q=scale * rng.normal(size=joints),
        dq=scale * rng.normal(size=joints),
        orientation=orientation / np.linalg.norm(orientation),
        angular_velocity=scale * rng.normal(size=3),
        position=scale * rng.normal(size=3),
        velocity=scale * rng.normal(size=3),
    )
    if rng.uniform() > 0.1:
        return state
    name = str(rng.choice(_FIELDS))
    values = getattr(state, name).copy()
    values[rng.integers(values.size)] = rng.choice([np.nan, np.inf, -np.inf])
    return dataclasses.replace(state, **{name: values})


def hard_state(rng: np.random.Generator, robot: Robot) -> RobotState:
    """Return a state within the limits of the body, in which no robot is."""
    joints = len(robot.joint_names)
    return RobotState(
        q=rng.uniform(robot.lower, robot.upper),
        dq=rng.choice([0.1, 0.5, 2.0]) * rng.uniform(-1.0, 1.0, joints) * robot.velocity_limit,
        orientation=rotations.from_yaw_pitch_roll(*rng.uniform(-0.8, 0.8, 3)),
        angular_velocity=rng.uniform(-5.0, 5.0, 3),
        position=np.array([0.0, 0.0, 0.9]),
        velocity=rng.uniform(-2.0, 2.0, 3),
    )


KINDS = {"absurd": absurd_state, "hard": hard_state}


def measure(kind: str, ticks: int, seed: int) -> TickTimes:
    """Return the times of ticks at random states under random commands.

    Args:
        kind: of the states, a key of `KINDS`.
        ticks: number of states.
        seed: of states and commands.
    """
    rng, controller, robot = np.random.default_rng(seed), WholeBodyController(), load_robot()
    gaits, times, outputs = list(Gait), np.zeros(ticks), collections.Counter[str]()
    for tick in range(ticks):
        state = KINDS[kind](rng, robot)
        command = Command.from_array(
            rng.normal(size=8) * 10.0 ** rng.uniform(0.0, 9.0), gaits[rng.integers(len(gaits))]
        )
        if tick % _EPISODE == 0:
            controller.reset(state)
        begin = time.process_time()
        controller.act(state, command, UpperBody.none())
        times[tick] = 1e3 * (time.process_time() - begin)
        outputs[controller.diagnostics.output.value] += 1
    median, p99 = np.percentile(times, [50.0, 99.0])
    return TickTimes(float(median), float(p99), float(times.max()), int((times > LONGEST).sum()), ticks, dict(outputs))


def main(words: list[str] | None = None) -> int:
    """Measure both kinds and print a line of each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ticks", type=int, default=2000, help="states of each kind (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=1000, help="seed (default: %(default)s)")
    options = parser.parse_args(words)
    if options.ticks < 1 or options.seed < 0:
        parser.error("give at least 1 tick and a seed from 0")
    for kind in KINDS:
        t = measure(kind, options.ticks, options.seed)
        where = ", ".join(f"{name} {count}" for name, count in sorted(t.outputs.items()))
        sys.stdout.write(
            f"{kind} states: median {t.median:.2f} ms, 99 % {t.p99:.2f} ms, longest {t.longest:.2f} ms, "
            f"{t.late} of {t.ticks} above {LONGEST:g} ms; {where}\n"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
