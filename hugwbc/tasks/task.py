"""A task: a scene, a behaviour that acts in it, and a judge of the result; and the tasks of the suite, by name.

A task of the suite is the constant `TASK` of the module of its name, loaded on request. Tasks of the user's own are
entry points in the group `hugwbc.tasks`, or Python files with a constant `TASK`.

Modules of tasks are not imported by name here: stored results depend on all code that a module imports, and a change to
one task would then invalidate the results of all others.
"""

import dataclasses
import functools
import importlib
import pathlib
from collections.abc import Callable, Mapping
from importlib.metadata import EntryPoint
from types import MappingProxyType
from typing import Annotated, Any, TypeAlias

from pydantic import Field

from hugwbc import extensions
from hugwbc.behaviours import Behaviour, Course, View
from hugwbc.behaviours.hands import stature
from hugwbc.behaviours.similar import similar
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.robot import Robot, load_robot
from hugwbc.robot_tables import DEFAULT_ROBOT
from hugwbc.settings import Positive, settings
from hugwbc.sim import Scene, load_scene
from hugwbc.tasks.record import TaskRecord, displaced
from hugwbc.tasks.verdict import Milestone, Verdict, judged

SCENES = pathlib.Path(__file__).parent / "scenes"
# What a behaviour is told of an object beside what is seen of it: its form, and not its mass, friction or springs.
_TOLD = ("size", "height", "radius", "boards", "handle", "hinge", "travel", "cup_radius", "cup_height")

# Least reach of the arms, in proportion to the height of the shoulders; 1 for the robot that a task is made for.
_SHORTEST = 0.85

LONGEST = 120.0  # [s], that an episode of any task may take

Shapes: TypeAlias = Mapping[str, Mapping[str, Any]]
"""Dimensions of each object of a scene by its name, as a data sheet has them: those fields of its class that are
lengths, such as `shapes["box"]["size"]`, `height`, `radius` and `travel`."""


def shapes_of(scene: Scene) -> Shapes:
    """Return what a behaviour is told of the objects of a drawn scene."""
    return MappingProxyType(
        {
            thing.name: MappingProxyType({name: getattr(thing, name) for name in _TOLD if hasattr(thing, name)})
            for thing in scene.objects
        }
    )


@settings(kw_only=True)
class Task:
    """A task of loco-manipulation.

    Attributes:
        name: name on the command line and in tables.
        about: the task in a sentence.
        scene: the objects around the robot, with what varies from episode to episode.
        behaviour: does the task, told the dimensions of the objects. It is the same for every controller;
            `behaviour_in` returns it for robot and scene of another size.
        limit: longest duration of an episode, at most 120 [s].
        milestones: what an episode must show, in order.
        idealised: what is not as on a robot, such as "attach"; empty for nothing.
        size: lengths of robot and scene, as a multiple of those for which behaviour and milestones are made (`sized`).
    """

    name: str
    about: str
    scene: Scene
    behaviour: Callable[[View, Shapes], Course]
    limit: Annotated[float, Field(gt=0, le=LONGEST)]
    milestones: Annotated[tuple[Milestone, ...], Field(min_length=1)]
    idealised: tuple[str, ...] = ()
    size: Positive = 1.0

    def sized(self, robot: Robot) -> "Task":
        """Return the task for a robot: a similar one, in proportion to the height of the shoulders.

        Raises:
            ConfigError: if the arms are too short for that.
        """
        made_for = self._made_for
        size = stature(robot) / stature(made_for)
        reach = (robot.upper_arm + robot.forearm) / (made_for.upper_arm + made_for.forearm)
        if reach < _SHORTEST * size:
            raise ConfigError(
                f"task '{self.name}' is made for {made_for.name}; it is {size:.2f} times as large for {robot.name}, "
                f"whose arms reach only {reach:.2f} times as far; make a task of your own (docs/how-to/add-a-task.md)"
            )
        return dataclasses.replace(self, scene=self.scene.scaled(size / self.size), size=size)

    def behaviour_in(self, scene: Scene) -> Behaviour:
        """Return the behaviour for a drawn scene, in the size of the robot."""
        shapes = shapes_of(scene.scaled(1.0 / self.size))
        return similar(lambda view: self.behaviour(view, shapes), self.size, self._made_for)

    @property
    def _made_for(self) -> Robot:
        return load_robot(self.scene.robot or DEFAULT_ROBOT)

    def check(self, first: TaskRecord) -> None:
        """Refuse milestones that cannot be judged, by the first sample of an episode."""
        for milestone in self.milestones:
            milestone.share(first.scaled(1.0 / self.size))

    def judge(self, record: TaskRecord) -> Verdict:
        """Return success, or the reason why not, from the true states of robot and objects."""
        verdict = judged(record.scaled(1.0 / self.size), self.milestones)
        if verdict.success:
            return verdict
        return dataclasses.replace(verdict, detail="; ".join(filter(None, (verdict.detail, *displaced(record)))))


def scene_of(name: str) -> Scene:
    """Return the shipped scene of a task."""
    return load_scene(SCENES / f"{name}.yaml")


GROUP = "hugwbc.tasks"
TASK_NAMES = (
    "press_button",
    "fetch_box",
    "deliver_box",
    "lift_from_stool",
    "push_cart",
    "open_door",
    "open_drawer",
    "carry_tray",
    "wipe_table",
    "stack_boxes",
    "hold_payload",
)


@functools.cache
def registered_tasks() -> dict[str, EntryPoint]:
    """Return the tasks that other packages register, by name."""
    ours = {name: f"hugwbc.tasks.{name}:TASK" for name in TASK_NAMES}
    return {name: entry for name, entry in extensions.registered(GROUP, "task", ours).items() if name not in ours}


def load_task(name: str) -> Task:
    """Return a task.

    Args:
        name: one of `TASK_NAMES`, the name of a registered task, or the path of a Python file with a `TASK`, which ends
            in .py; it is run.
    """
    if name in TASK_NAMES:
        return importlib.import_module(f"hugwbc.tasks.{name}").TASK
    if name in registered_tasks():
        return _registered(registered_tasks()[name])
    path = pathlib.Path(name)
    if path.suffix != extensions.SUFFIX:
        named = extensions.names_object(name)
        file = extensions.split_object(name)[0] if named else pathlib.Path(f"{name}{extensions.SUFFIX}")
        if file.is_file():
            raise ConfigError(f"there is no task '{name}' in the suite; for the TASK of the file, give {file}")
        raise UnknownNameError("task", name, (*TASK_NAMES, *registered_tasks(), "or a file that ends in .py"))
    task = getattr(extensions.run_file(path, "TASK"), "TASK", None)
    if not isinstance(task, Task):
        raise ConfigError(f"{path} has no task; give it a constant TASK, as docs/how-to/add-a-task.md says")
    return task


def _registered(entry: EntryPoint) -> Task:
    task = extensions.load_entry(entry, "task")
    if not isinstance(task, Task):
        raise ConfigError(
            f"task '{entry.name}' ({entry.value}) is a {type(task).__name__}; register a hugwbc.tasks.Task"
        )
    if task.name != entry.name:
        raise ConfigError(f"task '{entry.name}' ({entry.value}) calls itself '{task.name}'; give both one name")
    return task
