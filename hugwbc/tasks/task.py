"""A task: a scene, a behaviour that is meant to do something in it, and a judge of whether it was done."""

import dataclasses
import pathlib
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TypeAlias

from hugwbc.errors import ConfigError
from hugwbc.scripts.behaviours import Behaviour
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


@dataclasses.dataclass(frozen=True, kw_only=True)
class Task:
    """A task of loco-manipulation.

    Attributes:
        name: name on the command line and in tables.
        about: what is to be done, a sentence.
        scene: the objects around the robot, with what varies from episode to episode.
        behaviour: makes the behaviour of one episode from the dimensions of the objects. It is the same for every
            controller.
        limit: longest duration of an episode [s].
        milestones: what an episode must show, in order.
        idealised: what is not as on a robot, such as "attach"; empty for nothing.
    """

    name: str
    about: str
    scene: Scene
    behaviour: Callable[[Shapes], Behaviour]
    limit: float
    milestones: tuple[Milestone, ...]
    idealised: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.milestones:
            raise ConfigError(f"task '{self.name}' has no milestones; give at least one, or nothing can be a success")
        if not 0.0 < self.limit < float("inf"):
            raise ConfigError(f"the time limit of task '{self.name}' is {self.limit} s; give a finite time above 0 s")

    def judge(self, record: TaskRecord) -> Verdict:
        """Return success, or the reason why not, from the true states of robot and objects."""
        return judged(record, self.milestones)


def scene_of(name: str) -> Scene:
    """Return the shipped scene of a task."""
    return load_scene(SCENES / f"{name}.yaml")
