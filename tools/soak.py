"""Two parts of `make soak`: ticks of the QP behind its guard at states that make no sense, and memory over a long run.

Absurd states have numbers up to 1e7, any orientation, and NaN or infinity in every tenth. In hard ones every joint is
anywhere in its range, and joints and a leaning pelvis move fast. Ticks that take longer than a period are counted.

In the long run, controller and simulation stay, as in a user's program, while each gait moves in episodes of 20 s with
random commands. The first episode fills caches; memory that grows by more than 5 % from there is a failure, and so is
a command that is not finite.
"""

import argparse
import collections
import gc
import pathlib
import resource
import sys
import time

import numpy as np

from hugwbc import Command, Gait, Robot, RobotState, UpperBody, load_robot, rotations
from hugwbc.commands import sample_all
from hugwbc.mbc import WholeBodyController
from hugwbc.runtime import Constant, Simulation, load_controller, rollout
from hugwbc.runtime.guard import Guard
from hugwbc.runtime.safety import SafetyFilter, StateCheck
from hugwbc.runtime.safety_report import SafetyLog
from hugwbc.settings import REPORT_SEED

STATES_PER_RESET, EPISODE_S = 5, 20.0
GROWTH = 0.05  # of the memory, as a part of that after the first episode
FIELDS = ("q", "dq", "orientation", "angular_velocity", "position", "velocity")


def absurd_state(rng: np.random.Generator, robot: Robot) -> RobotState:
    """Return a state with numbers up to 1e7, in every tenth case with a NaN or an infinity."""
    scale, sizes = 10.0 ** rng.uniform(0.0, 7.0), (len(robot.joint_names), len(robot.joint_names), 4, 3, 3, 3)
    values = {name: scale * rng.normal(size=size) for name, size in zip(FIELDS, sizes, strict=True)}
    values["orientation"] /= np.linalg.norm(values["orientation"])
    if rng.uniform() < 0.1:
        spoilt = values[str(rng.choice(FIELDS))]
        spoilt[rng.integers(spoilt.size)] = rng.choice([np.nan, np.inf, -np.inf])
    return RobotState(**values)


def hard_state(rng: np.random.Generator, robot: Robot) -> RobotState:
    """Return a state within the limits of the body, in which no robot is."""
    speed = rng.choice([0.1, 0.5, 2.0]) * robot.velocity_limit
    return RobotState(
        q=rng.uniform(robot.lower, robot.upper),
        dq=rng.uniform(-speed, speed),
        orientation=rotations.from_yaw_pitch_roll(*rng.uniform(-0.8, 0.8, 3)),
        angular_velocity=rng.uniform(-5.0, 5.0, 3),
        position=np.array([0.0, 0.0, 0.9]),
        velocity=rng.uniform(-2.0, 2.0, 3),
    )


def memory() -> int:
    """Return the memory that this process holds now [bytes]."""
    gc.collect()
    return int(pathlib.Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


def strange_states(ticks: int, seed: int) -> None:
    """Time the QP at random states under random commands, and print a line for each kind of state.

    Raises:
        SystemExit: at a command that is not finite.
    """
    robot, gaits = load_robot(), list(Gait)
    for kind, draw in (("absurd", absurd_state), ("hard", hard_state)):
        rng, controller, outputs = np.random.default_rng(seed), WholeBodyController(robot), collections.Counter[str]()
        log = SafetyLog()
        guard = Guard(controller, StateCheck(robot), SafetyFilter(robot, log), log)
        times = np.zeros(ticks)  # [ms] of the processor
        for tick in range(ticks):
            state = draw(rng, robot)
            values = rng.normal(size=8) * 10.0 ** rng.uniform(0.0, 9.0)
            command, _ = Command.from_array(values, gaits[rng.integers(len(gaits))]).clamp()
            if tick % STATES_PER_RESET == 0:
                guard.reset(state)
            begin = time.process_time()
            joints = guard.act(state, command, UpperBody.none())
            times[tick] = 1e3 * (time.process_time() - begin)
            if not joints.is_finite:
                sys.exit(f"{kind} state {tick} of seed {seed}: the command is not finite")
            # The guard keeps most absurd states from the controller.
            outputs[controller.diagnostics.status.value if guard.last_tick_s else "kept from it"] += 1
        median, p99, longest = np.percentile(times, [50.0, 99.0, 100.0])
        where = ", ".join(f"{name} {count}" for name, count in sorted(outputs.items()))
        period = 1e3 * controller.period  # [ms]
        print(
            f"{kind} states: median {median:.2f} ms, 99 % {p99:.2f} ms, longest {longest:.2f} ms, "
            f"{(times > period).sum()} of {ticks} above {period:g} ms; {where}"
        )


def long_run(name: str, minutes: float, seed: int) -> float:
    """Run each gait for a simulated time, print ticks, falls and growth of memory, and return the largest growth."""
    largest = 0.0
    for gait in Gait:
        rng, controller, simulation = np.random.default_rng(seed), load_controller(name), Simulation(seed=seed)
        seconds, ticks, falls, first = 0.0, 0, 0, 0
        while seconds < 60.0 * minutes:
            command = Command.from_array(sample_all(gait, rng, 1)[0], gait)
            trace = rollout(controller, Constant(command), simulation, duration=EPISODE_S)
            seconds, ticks, falls = seconds + simulation.time, ticks + trace.steps, falls + trace.fell
            first = first or memory()
        growth = memory() / first - 1.0
        print(f"{name}, {gait.label}: {ticks} ticks, {falls} falls, memory {growth:+.2%}", flush=True)
        largest = max(largest, growth)
    return largest


def main() -> None:
    """Run both parts with both controllers."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ticks", type=int, default=2000, help="states of each kind (default: %(default)s)")
    parser.add_argument("--minutes", type=float, default=1.0, help="simulated time of each gait (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=REPORT_SEED, help="of everything random (default: %(default)s)")
    options = parser.parse_args()
    if 60.0 * options.minutes <= EPISODE_S:
        parser.error(f"memory cannot grow in one episode; give more than {EPISODE_S / 60.0:.2f} minutes")
    strange_states(options.ticks, options.seed)
    growth = max(long_run(name, options.minutes, options.seed) for name in ("learned", "qp"))
    if growth > GROWTH:
        sys.exit(f"the memory grew by {growth:.1%}; more than {GROWTH:.0%} says that something is kept")


if __name__ == "__main__":
    main()
