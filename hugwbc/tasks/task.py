"""A task: a scene, a behaviour that acts in it, and a judge of the result."""

import dataclasses
import pathlib
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Annotated, TypeAlias

from pydantic import Field

from hugwbc.behaviours import BehaviourSource, Course, View
from hugwbc.behaviours.similar import similar
from hugwbc.errors import ConfigError
from hugwbc.robot import DEFAULT_ROBOT, Robot, load_robot
from hugwbc.settings import Positive, settings
from hugwbc.sim import Scene, load_scene
from hugwbc.tasks.record import TaskRecord
from hugwbc.tasks.verdict import Milestone, Verdict, judged

SCENES = pathlib.Path(__file__).parent / "scenes"
# What a behaviour is told of an object beside what is seen of it: its form, and not its mass, friction or springs.
_TOLD = ("size", "height", "radius", "boards", "handle", "hinge", "travel", "cup_radius", "cup_height")

_SHORTEST = 0.85  # reach of the arms, in proportion to the height of the shoulders, with which tasks are done

Shapes: TypeAlias = Mapping[str, Mapping[str, object]]
"""Dimensions of each object of a scene by its name, as a data sheet has them: its sizes, heights and hinges."""


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
        behaviour: does the task, told the dimensions of the objects. It is the same for every controller.
        limit: longest duration of an episode [s].
        milestones: what an episode must show, in order.
        idealised: what is not as on a robot, such as "attach"; empty for nothing.
        size: lengths of robot and scene, as a multiple of those for which behaviour and milestones are made (`sized`).
    """

    name: str
    about: str
    scene: Scene
    behaviour: Callable[[View, Shapes], Course]
    limit: Positive
    milestones: Annotated[tuple[Milestone, ...], Field(min_length=1)]
    idealised: tuple[str, ...] = ()
    size: Positive = 1.0

    def sized(self, robot: Robot) -> "Task":
        """Return the task for a robot: a similar one, in proportion to the height of the shoulders.

        Raises:
            ConfigError: if the arms are too short for that.
        """
        made_for = load_robot(self.scene.robot or DEFAULT_ROBOT)
        size = (robot.nominal_height + robot.shoulder[2]) / (made_for.nominal_height + made_for.shoulder[2])
        reach = (robot.upper_arm + robot.forearm) / (made_for.upper_arm + made_for.forearm)
        if reach < _SHORTEST * size:
            raise ConfigError(
                f"task '{self.name}' is made for {made_for.name}; it is {size:.2f} times as large for {robot.name}, "
                f"whose arms reach only {reach:.2f} times as far; make a task of your own (docs/how-to/add-a-task.md)"
            )
        return dataclasses.replace(self, scene=self.scene.scaled(size / self.size), size=size)

    def source(self, scene: Scene) -> BehaviourSource:
        """Return what commands the robot in a drawn scene."""
        shapes = shapes_of(scene.scaled(1.0 / self.size))
        return BehaviourSource(similar(lambda view: self.behaviour(view, shapes), self.size))

    def check(self, first: TaskRecord) -> None:
        """Refuse milestones that cannot be judged, by the first sample of an episode."""
        for milestone in self.milestones:
            milestone.share(first.scaled(1.0 / self.size))

    def judge(self, record: TaskRecord) -> Verdict:
        """Return success, or the reason why not, from the true states of robot and objects."""
        return judged(record.scaled(1.0 / self.size), self.milestones)


def scene_of(name: str) -> Scene:
    """Return the shipped scene of a task."""
    return load_scene(SCENES / f"{name}.yaml")
