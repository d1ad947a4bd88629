"""`hugwbc tasks`: list the suite of tasks, record demonstrations of them, or replay these."""

import contextlib
import dataclasses
import pathlib
import tempfile
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence

import numpy as np
import tyro

from hugwbc import extensions
from hugwbc.cli.output import output_folder, parse_settings, progress, say, say_arena
from hugwbc.errors import ConfigError, HugwbcError, needing
from hugwbc.files import digest
from hugwbc.learned.policy.network_files import shipped_policies
from hugwbc.learned.policy.records import versions
from hugwbc.robot import load_robot
from hugwbc.runtime.controllers import ControllerSpec, controller_names
from hugwbc.settings import Count, Seed, check_each_once, check_seeds, settings
from hugwbc.sim import Arena
from hugwbc.source import source_commit
from hugwbc.tasks import TASK_NAMES, load_task
from hugwbc.tasks.task import registered_tasks


@settings
class TasksOptions:
    """List the tasks of loco-manipulation; with `--record`, do them and write all episodes as demonstrations.

    `--replay` plays the actions of such episodes again, and says whether the outcome is the same.

    `hugwbc play --task NAME` shows a task, `hugwbc evaluate tasks` gives success rates.
    """

    # Names of tasks, or Python files with tasks of your own; all of the suite by default
    task: tuple[str, ...] = TASK_NAMES
    # New folder for a data set in the layout of LeRobot v3 (docs/demonstrations.md). Needs the extra [record].
    record: pathlib.Path | None = None
    # With `--record`: learned, qp, a plug-in's name, FILE.py:NAME, or the path of a policy or contract
    controller: str = "learned"
    # Name of a shipped policy or path of a policy, for learned; path of a network, for a foreign policy
    policy: str | None = None
    episodes: Count = 10  # With `--record`: number of episodes of each task
    # With `--record`: the scene of episode 0 is drawn with it, that of the next with the seed plus 1, and so on
    seed: Seed = 0
    # With `--record`: films of 224 x 224 pixels that are recorded too: head, front
    cameras: tuple[str, ...] = ()
    # Folder of such a data set, whose actions are played again; `--task FILE.py` for a task of your own
    replay: pathlib.Path | None = None
    episode: int | None = None  # With `--replay`: number of the episode; by default all
    arena: tyro.conf.OmitArgPrefixes[Arena] = dataclasses.field(default_factory=Arena)


def run(words: Sequence[str]) -> int:
    """Parse, then list, record or replay; return 1 where a replay ends otherwise than the recording, else 0."""
    options = parse_settings(TasksOptions, words, "tasks")
    check_each_once("tasks", [load_task(name).name for name in options.task])
    _refuse_idle_options(options)
    if options.replay is not None:
        return _replay(options, options.replay)
    if options.record is None:
        _list(options.task)
        return 0
    say_arena(options.arena)
    _record(options, options.record)
    return 0


def _list(names: Sequence[str]) -> None:
    tasks = [load_task(name) for name in names]
    width = max(len(task.name) for task in tasks)
    for task in tasks:
        idealised = f" Idealised: {', '.join(task.idealised)}." if task.idealised else ""
        say(f"{task.name:<{width}}  {task.about}{idealised}")


def _refuse_idle_options(options: TasksOptions) -> None:
    """Refuse options that would do nothing."""
    values, defaults = (
        {**vars(chosen), **dataclasses.asdict(chosen.arena), "arena": None} for chosen in (options, TasksOptions())
    )
    given = [name for name in values if name != "task" and values[name] != defaults[name]]
    of_mode, hint = [], "add --record FOLDER, or for --episode --replay FOLDER"
    if options.replay is not None:
        of_mode, hint = ["replay", "episode", "controller", "policy"], "a replay has it from its data set"
    elif options.record is not None:
        of_mode = [name for name in given if name != "episode"]
    if idle := [f"--{name}" for name in given if name not in of_mode]:
        raise ConfigError(f"{', '.join(idle)} does nothing here: {hint}, or leave it out")


@contextlib.contextmanager
def _said(words: Callable[[], str]) -> Iterator[None]:
    """Say what there is at the end, also when Ctrl-C or an error has come before it."""
    try:
        yield
    except (KeyboardInterrupt, HugwbcError):
        say(words())
        raise
    say(words())


def _code(task: str) -> list[pathlib.Path]:
    """Return the files of a task in a Python file."""
    path = pathlib.Path(task)
    return extensions.code_of(path) if path.suffix == extensions.SUFFIX else []


def _record(options: TasksOptions, folder: pathlib.Path) -> None:
    from hugwbc.viz.cameras import SIZE, check_cameras, render_films

    check_cameras(options.cameras)
    with needing("record", "--record"):
        from hugwbc.tasks.demonstration import FPS, demonstrate
        from hugwbc.tasks.lerobot_dataset import DatasetWriter
    check_seeds(options.seed, options.episodes)
    arena = options.arena
    tasks = [load_task(name).sized(arena.known_robot) for name in options.task]
    total, done = options.episodes * len(tasks), 0
    spec = ControllerSpec(options.controller, options.policy).told(arena)
    told = [options.controller, options.policy]
    settings = {
        "controller": spec.identity(),
        "told": told,
        "arena": dataclasses.asdict(arena),
        "arena_version": arena.version,
        "commit": source_commit(),
        "versions": versions(),
        "seed": options.seed,
        "tasks": [digest(path.read_bytes()) for name in options.task for path in _code(name)],
    }
    with (
        _said(lambda: f"wrote {done} of {total} episodes to {folder}" if folder.is_dir() else "nothing was written"),
        output_folder(folder.absolute().parent),
        DatasetWriter(folder, tasks, load_robot(arena.robot), dict.fromkeys(options.cameras, SIZE), settings) as writer,
        tempfile.TemporaryDirectory() as films,
        progress(f"{options.controller}, recording: {total} episodes") as advance,
    ):
        controller = spec.build()

        def on_progress(part: float) -> None:
            advance((done + part) / total)

        for task in tasks:
            for seed in range(options.seed, options.seed + options.episodes):
                if (task.name, seed) in writer.recorded:  # by a recording that was killed
                    done += 1
                    continue
                simulation = arena.simulation(seed=seed, scene=task.scene)
                episode = demonstrate(task, controller, simulation, seed=seed, on_progress=on_progress)
                images = {}
                if options.cameras:
                    found = render_films(
                        simulation.model, simulation.robot, episode.qpos, options.cameras, FPS, pathlib.Path(films)
                    )
                    images = {name: (pathlib.Path(films) / f"{name}.mp4", of_it) for name, of_it in found.items()}
                writer.add(episode, images)
                done += 1
                say(f"{task.name}, seed {seed}: {episode.verdict.words}, {len(episode.state) / FPS:.1f} s")


def check_recorded(recorded: Mapping[str, object], allowed: Mapping[str, Collection[str | None]]) -> None:
    """Refuse what a file of data names by a path, which may be a program, unless the user allows it.

    Args:
        recorded: what the file names as controller, policy and task.
        allowed: what the user gives of each.
    """
    policies = shipped_policies()
    known = {
        "controller": (*controller_names(), *policies),
        "policy": policies,
        "task": (*TASK_NAMES, *registered_tasks()),
    }
    for option, names in known.items():
        if isinstance(word := recorded.get(option), str) and word not in names and word not in allowed[option]:
            given = "FILE.py, its file," if option == "task" and not word.endswith(extensions.SUFFIX) else word
            raise ConfigError(f"the recording runs {word}; give --{option} {given} to allow it")


def _replay(options: TasksOptions, folder: pathlib.Path) -> int:
    """Play recorded episodes again, and say which of them end as they were recorded."""
    with needing("record", "--replay"):
        from hugwbc.tasks.demonstration import ACTION, STATE, state_names
        from hugwbc.tasks.lerobot_dataset import read_episodes, read_frames
        from hugwbc.tasks.replay import replay
    rows = read_episodes(folder)
    if options.episode is not None:
        if not 0 <= options.episode < len(rows):
            raise ConfigError(f"episode is {options.episode}; {folder} has 0 to {len(rows) - 1}")
        rows = [rows[options.episode]]
    tasks, same = {task.name: task for task in map(load_task, options.task)}, 0
    for row in rows:
        name, seed, settings = row["suite_task"], row["seed"], row["settings"]
        controller, policy = settings["told"]
        recorded, default = {"controller": controller, "policy": policy}, TasksOptions()
        for option, word in recorded.items():
            if getattr(options, option) not in (getattr(default, option), word):
                raise ConfigError(f"the data set has {option} {word}; leave --{option} out")
        allowed = {"controller": (options.controller,), "policy": (options.policy,), "task": tuple(tasks)}
        check_recorded({**recorded, "task": name}, allowed)
        arena = Arena(**settings["arena"])
        task = (tasks.get(name) or load_task(name)).sized(arena.known_robot)
        spec = ControllerSpec(*settings["told"]).told(arena)
        if spec.identity() != settings["controller"]:
            say(f"controller {spec.label} is not what it was in the recording")
        simulation = arena.simulation(seed=seed, scene=task.scene)
        episode = replay(task, spec.build(), simulation, read_frames(folder, row, ACTION), seed=seed)
        place = [state_names(simulation.robot).index(f"base.{axis}") for axis in "xyz"]
        recorded, count = read_frames(folder, row, STATE)[:, place], len(episode.state)
        off = np.linalg.norm(episode.state[: len(recorded), place] - recorded[:count], axis=1).max()
        was, verdict = "done" if row["success"] else f"not done: {row['reason']}", episode.verdict
        equal = (verdict.success, verdict.reason) == (row["success"], row["reason"])
        same += equal
        words = "as recorded" if equal else f"recorded as {was}"
        about = f"episode {row['episode_index']}: {name}, seed {seed}, {spec.label}"
        say(f"{about}: {verdict.words}, {words}; the base at most {1e3 * off:.1f} mm off")
    say(f"the same outcome in {same} of {len(rows)}")
    return int(same < len(rows))
