"""A task: a scene, a behaviour that acts in it, and a judge of the result."""

import pathlib
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Annotated, TypeAlias

from pydantic import Field

from hugwbc.behaviours import BehaviourSource, Course, View
from hugwbc.settings import Positive, settings
from hugwbc.sim import Scene, load_scene
from hugwbc.tasks.record import TaskRecord
from hugwbc.tasks.verdict import Milestone, Verdict, judged

SCENES = pathlib.Path(__file__).parent / "scenes"
# What a behaviour is told of an object beside what is seen of it: its form, and not its mass, friction or springs.
_TOLD = ("size", "height", "radius", "boards", "handle", "hinge", "travel", "cup_radius", "cup_height")

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
    """

    name: str
    about: str
    scene: Scene
    behaviour: Callable[[View, Shapes], Course]
    limit: Positive
    milestones: Annotated[tuple[Milestone, ...], Field(min_length=1)]
    idealised: tuple[str, ...] = ()

    def source(self, scene: Scene) -> BehaviourSource:
        """Return what commands the robot in a drawn scene."""
        shapes = shapes_of(scene)
        return BehaviourSource(lambda view: self.behaviour(view, shapes))

    def check(self, first: TaskRecord) -> None:
        """Refuse milestones that cannot be judged, by the first sample of an episode."""
        for milestone in self.milestones:
            milestone.share(first)

    def judge(self, record: TaskRecord) -> Verdict:
        """Return success, or the reason why not, from the true states of robot and objects."""
        return judged(record, self.milestones)


def scene_of(name: str) -> Scene:
    """Return the shipped scene of a task."""
    return load_scene(SCENES / f"{name}.yaml")
