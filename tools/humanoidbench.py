"""Play tasks of HumanoidBench (Sferrazza et al., RSS 2024), on which neither controller was trained.

    git clone https://github.com/carlosferrazza/humanoid-bench
    pip install --no-deps dm-control
    export PYTHONPATH=humanoid-bench
    python tools/humanoidbench.py --controllers qp learned --tasks walk reach --seeds 10

Robot `h1` under position control at 50 Hz, the benchmark's own returns and bars. Each task is a script of at most
twenty lines that knows where goals, poles and walls are. Episodes that are stored already are not played again, unless
the code, the policy, this file, the packages or the benchmark have changed.
"""

import argparse
import functools
import importlib.util
import json
import math
import pathlib
import sys
import types
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hugwbc import Command, Gait, rotations
from hugwbc.behaviours import (
    BehaviourSource,
    Course,
    View,
    lift,
    place,
    reach,
    squeeze,
    standing,
    wait,
    walk_to,
)
from hugwbc.evaluation.episode import Row
from hugwbc.evaluation.plans import Plan
from hugwbc.evaluation.store import DEFAULT_FOLDER, StoredTable, controller_digest
from hugwbc.files import digest, digest_of
from hugwbc.learned.policy.records import versions
from hugwbc.mbc import WholeBodyController
from hugwbc.robot import SIDES
from hugwbc.runtime import MujocoRobot, UpperBodySource, load_controller
from hugwbc.runtime.controllers import ControllerSpec
from hugwbc.scripts.view import Action
from hugwbc.settings import REPORT_SEED
from hugwbc.source import source_commit
from hugwbc.targets import HandTargets

PERIOD = 0.02  # [s]
LEFT = 0.2  # [m], how far left of the pelvis a reaching hand is
CONTROLLERS = ("qp", "learned")
Environment = Any  # of the benchmark, which has no types


# --- the scripts


def walk(v_x: float, **others: float) -> Command:
    """Return the command to walk ahead at a speed [m/s]."""
    return Command(v_x=v_x, gait=Gait.WALKING, **others)


def along(view: View, path: list[tuple[float, float]], speed: float, near: float = 0.35, slow: int = 2) -> Course:
    """Walk past points, x and y in the world [m], the more slowly the further they are aside; stand at the last."""
    for x, y in path:
        while (way := np.array([x, y]) - view.position[:2]) @ way > near**2:
            turn = float(rotations.wrap_angle(math.atan2(way[1], way[0]) - view.state.yaw))
            ahead = speed * max(math.cos(turn), 0.0) ** slow * min(1.0, float(np.hypot(*way)))
            command = walk(max(ahead, 0.15), omega=float(np.clip(1.5 * turn, -0.8, 0.8)))
            view = yield Action(command, view.last.hands)
    return (yield from wait(view, 1.0))


def maze(view: View, env: Environment) -> Course:
    """Walk from corner to corner, without a swing outwards to the walls."""
    view = yield from along(view, [tuple(corner[:2]) for corner in env.task.checkpoints[1:4]], 1.1, near=0.5, slow=6)
    return (yield from wait(view, math.inf))


def pole(view: View, env: Environment) -> Course:
    """Walk on the line that is equally far from the poles of all rows."""
    while True:
        aside = 0.375 - view.position[1]
        turn = float(np.clip(1.5 * aside, -0.6, 0.6)) - view.state.yaw
        view = yield Action(walk(1.1, omega=float(np.clip(1.5 * turn, -0.8, 0.8))))


def touch(view: View, env: Environment) -> Course:
    """Walk up to the goal and hold the left hand at it, with the whole body."""
    goal = env.task.goal.copy()
    yaw = math.atan2(goal[1], goal[0])
    x, y = goal[:2] - rotations.rotation_z(yaw)[:2, :2] @ [0.35, LEFT]
    if math.hypot(x - view.position[0], y - view.position[1]) > 0.5:
        view = yield from along(view, [(x, y)], 0.8, near=0.25)
    view = yield from walk_to(view, (float(x), float(y)), yaw, tolerance=0.08)
    view = yield from reach(view, left=tuple(goal.tolist()), frame="world", whole_body=True, tolerance=0.03, timeout=8)
    return (yield from wait(view, math.inf))


def push(view: View, env: Environment) -> Course:
    """Put a hand behind the box, seen from the goal, and keep it there while the box moves."""
    goal, box = env.task.goal.copy(), view.objects["object"].position
    side = "right" if goal[1] > 0.0 else "left"
    end = view.time + 0.9
    while view.time < end:  # to the table
        view = yield Action(walk(0.25))
    point = np.zeros(3)
    for behind, height in ((0.3, 0.2), (0.2, 0.02)):
        way = (goal - box) / np.linalg.norm(goal - box)
        point = box - behind * way - [0.06 * abs(way[1]), 0.0, -height]
        left, right = (tuple(point.tolist()) if one == side else None for one in SIDES)
        view = yield from reach(view, left, right, frame="world", whole_body=True, speed=0.8, tolerance=0.06, timeout=2)
    while True:
        box = view.objects["object"].position
        way = (goal - box) / np.linalg.norm(goal - box)
        wanted = box - 0.05 * way - [0.06 * abs(way[1]), 0.0, -0.02]
        point = point + np.clip(wanted - point, -0.004, 0.004)
        left, right = (point if one == side else None for one in SIDES)
        view = yield Action(standing(view), HandTargets.of(left, right, "world", whole_body=True))


def package(view: View, env: Environment) -> Course:
    """Walk to the package, lift it between the hands, and put it down at its destination."""
    name, goal = "package_a", env.data.site("destination_loc").xpos.copy()
    x, y, _ = view.objects[name].position
    view = yield from along(view, [(x - 0.9, y)], 0.7, near=0.2)
    view = yield from walk_to(view, before=name, distance=0.6, tolerance=0.06)
    view = yield from squeeze(view, name, width=0.25, at=(0.0, 0.0, 0.25), whole_body=True)
    view = yield from lift(view, name, 0.08)
    view = yield from walk_to(view, (float(goal[0]) - 0.45, float(goal[1])), 0.0, speed=0.4)
    view = yield from place(view, name, at=(float(goal[0]), float(goal[1])))
    return (yield from wait(view, math.inf))


def door(view: View, env: Environment) -> Course:
    """Press the handle down with the left hand: the door opens towards the robot, and no hand can pull it."""
    view = yield from walk_to(view, (0.25, 0.1), 0.0, tolerance=0.06)
    for height in (1.4, 1.1):
        view = yield from reach(view, left=(0.69, 0.27, height), frame="world", tolerance=0.05, timeout=5)
    return (yield from wait(view, math.inf))


# A command, commands by controller, or a behaviour that gets the environment.
SCRIPTS: dict[str, Any] = {
    "stand": Command(),
    "walk": walk(1.1),
    "run": {"qp": walk(1.75), "learned": walk(2.0)},
    "reach": touch,
    "push": push,
    "maze": maze,
    "pole": pole,
    "door": door,
    "package": package,
    "slide": walk(0.8),
    "stair": walk(0.5, l=0.35),
    "hurdle": walk(1.75, l=0.3),
    "sit_simple": Command(h=-0.15),
    "balance_simple": Command(),
}


# --- the benchmark


class _Absent(types.ModuleType):
    """A package that the benchmark imports for its hands' policies, which are not used here."""

    def __getattr__(self, name: str) -> type:
        if name.startswith("__"):
            raise AttributeError(name)
        return object


def make(task: str, seed: int) -> Environment:
    """Return a task of the benchmark, reset with a seed; it draws goals from NumPy's global generator."""
    _prepare()
    from humanoid_bench.env import HumanoidEnv  # pyright: ignore[reportMissingImports]

    np.random.seed(seed)
    env = HumanoidEnv(robot="h1", control="pos", task=task, render_mode=None)
    env.reset(seed=seed)
    return env


@functools.cache
def _prepare() -> None:
    """Let the benchmark be imported without its learners' packages, and with MuJoCo 4."""
    for name in ("jax", "jax.numpy", "flax", "flax.linen"):
        sys.modules.setdefault(name, _Absent(name))
    from humanoid_bench.dmc_deps import dmc_index, dmc_sizes  # pyright: ignore[reportMissingImports]

    indexer = dmc_index.struct_indexer

    def present(struct: object, name: str, axes: object) -> object:
        """Skip the fields that newer versions of MuJoCo do not have."""
        sizes = dmc_sizes.array_sizes
        sizes[name] = {field: size for field, size in sizes[name].items() if hasattr(struct, field)}
        return indexer(struct, name, axes)

    dmc_index.struct_indexer = present


def stored(folder: pathlib.Path, controller: str) -> StoredTable:
    """Return the episodes of a controller that are stored, of this code, policy, file, packages and benchmark."""
    benchmark = importlib.util.find_spec("humanoid_bench")
    folders = (benchmark and benchmark.submodule_search_locations) or ()
    paths = sorted(path for folder in folders for path in pathlib.Path(folder).rglob("*"))
    sources = [path for path in paths if path.suffix in (".py", ".xml")]
    key = {
        "experiment": "humanoidbench",
        "controller": controller,
        "digest": controller_digest(ControllerSpec(controller)),
        "commit": source_commit(policies=False),
        "versions": versions(),
        "files": {"script": digest_of(__file__), "benchmark": digest(str([digest_of(path) for path in sources]))},
    }
    return StoredTable(folder / f"humanoidbench-{controller}-{digest(json.dumps(key))[:16]}.jsonl", key)


def play(task: str, controller: str, seed: int) -> Row:
    """Play an episode and return its row: return, bar, steps and what went wrong."""
    env, script = make(task, seed), SCRIPTS[task]
    robot = MujocoRobot(env.model, env.data)
    qp = controller == "qp"
    chosen = WholeBodyController(robot=robot.robot, period=PERIOD) if qp else load_controller(controller)
    script = script[controller] if isinstance(script, dict) else script
    source = script if isinstance(script, Command) else BehaviourSource(lambda view: script(view, env))
    hands = None if isinstance(script, Command) else UpperBodySource(robot=robot.robot)
    control = robot.control_period(chosen, source, hands)
    control.start(robot.state(), env.data.time)
    total, step, low, high = 0.0, 0, env.action_low, env.action_high
    for step in range(env.task.max_episode_steps):
        control.observe(robot.state(), env.data.time)
        targets = np.zeros(env.model.nu)
        targets[robot.actuators] = robot.controls(control.decide(PERIOD * step))
        _, reward, terminated, _, _ = env.step(2.0 * (targets - low) / (high - low) - 1.0)
        total += float(reward)
        if terminated:
            break
    ending = "" if isinstance(source, Command) else source.ending
    return {
        "task": task,
        "controller": controller,
        "seed": seed,
        "return": round(total, 1),
        "bar": env.task.success_bar,
        "steps": step + 1,
        "height": round(float(env.data.qpos[2]), 2),
        "ending": ending,
    }


def table(found: Mapping[tuple[str, str], Sequence[Row]]) -> None:
    """Print rows, by task and controller, as a table: mean return of each task, and episodes above the bar."""
    print("| task (bar) | QP | policy |\n|---|---|---|")
    for task in dict.fromkeys(task for task, _ in found):
        played = {controller: rows for (name, controller), rows in found.items() if name == task}
        bar = next(iter(played.values()))[0]["bar"]
        print(f"| {task} ({bar}) | {' | '.join(_cell(played.get(controller, ())) for controller in CONTROLLERS)} |")


def _cell(rows: Sequence[Row]) -> str:
    if not rows:
        return ""
    passed = sum(row["return"] > row["bar"] for row in rows)
    return f"{np.mean([row['return'] for row in rows]):.0f}; {passed} of {len(rows)}"


def main() -> None:
    """Play the episodes that are missing, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--controllers", nargs="+", choices=CONTROLLERS, default=CONTROLLERS, help="who plays")
    parser.add_argument("--tasks", nargs="+", choices=SCRIPTS, default=list(SCRIPTS), help="which tasks")
    parser.add_argument("--seeds", type=int, default=10, help="how many seeds, from --first on")
    parser.add_argument("--first", type=int, default=REPORT_SEED, help="the first seed")
    parser.add_argument("--out", type=pathlib.Path, default=DEFAULT_FOLDER, help="folder of the stored episodes")
    given = parser.parse_args()
    if given.seeds < 1:
        parser.error(f"--seeds is {given.seeds}; give a whole number above 0")
    found: dict[tuple[str, str], list[Row]] = {}
    for controller in given.controllers:
        episodes = stored(given.out, controller)
        for task in given.tasks:
            for seed in range(given.first, given.first + given.seeds):
                plan = Plan(seed, tags={"task": task})
                row = episodes.get(plan)
                if row is None:
                    row = episodes.add(plan, play(task, controller, seed))
                    print(row, flush=True)
                found.setdefault((task, controller), []).append(row)
    table(found)


if __name__ == "__main__":
    main()
