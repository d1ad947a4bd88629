"""A behaviour of the user's own, repeated: how often it succeeds, how long it takes, why it fails."""

import polars as pl

from hugwbc import extensions
from hugwbc.behaviours import Behaviour, BehaviourSource, Status, load_behaviour
from hugwbc.controller import Controller
from hugwbc.errors import ConfigError
from hugwbc.evaluation.episode import CountedSettings, Row, Settings, ending
from hugwbc.evaluation.experiment import Experiment, numbered
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import bootstrap_mean, wilson_of, wilson_percentage
from hugwbc.evaluation.plans import Plan
from hugwbc.runtime.rollout import rollout
from hugwbc.settings import Count, Positive, settings
from hugwbc.sim import Engine, Scene, load_scene
from hugwbc.upper_ik import UpperBodySource


@settings(kw_only=True)
class BehavioursSettings(CountedSettings):
    """Settings of behaviours."""

    # number of episodes; what varies in the scene, and the sensors' errors, differ from one to the next
    episodes: Count = 10
    behaviour: str = "fetch_cup"  # name of a shipped behaviour, or FILE.py:NAME
    scene: str = "cupboard"  # name of a shipped scene, a YAML file, or FILE.py:NAME of a scene
    duration: Positive = 120.0  # longest time of an episode [s]

    def __post_init__(self) -> None:
        super().__post_init__()
        scene_of(self.scene)
        load_behaviour(self.behaviour)


def scene_of(words: str) -> Scene:
    """Return a scene by name, path or `FILE.py:NAME`."""
    if not extensions.names_object(words):
        return load_scene(words)
    found = extensions.load_object(words, "scene")
    if not isinstance(found, Scene):
        raise ConfigError(f"{words} is a {type(found).__name__}; give a Scene")
    return found


def play(
    controller: Controller, settings: Settings, plan: Plan, behaviour: Behaviour, scene: Scene
) -> tuple[Row, Engine]:
    """Play a behaviour; return how it ended, and the simulation after it.

    - `success`: whether the behaviour ended with success; `seconds`: when, None if not [s]; `ending`: what it said.
    """
    conditions, source = settings.conditions, BehaviourSource(behaviour)
    simulation = conditions.simulation(settings.duration, (settings.seed, plan.draw), scene)
    trace = rollout(
        controller,
        source,
        simulation,
        UpperBodySource(robot=simulation.known_robot),
        duration=settings.duration,
        estimator=conditions.estimator(),
        until=lambda: source.done,
        strict=False,
    )
    success = source.status is Status.SUCCESS and not trace.fell
    seconds = simulation.time if success else None
    how = "a fall" if trace.fell else source.ending
    return {**ending(trace), "success": success, "seconds": seconds, "ending": how}, simulation


def episode(controller: Controller, settings: BehavioursSettings, plan: Plan) -> Row:
    """Return how the behaviour ended, and where the objects then were [m]."""
    row, simulation = play(controller, settings, plan, load_behaviour(settings.behaviour), scene_of(settings.scene))
    return row | {"objects": {name: pose.position.round(3).tolist() for name, pose in simulation.objects.items()}}


def figures(settings: BehavioursSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return how often it was done, its time, and the other endings."""
    table, done = settings.behaviour, rows.filter(pl.col("success"))
    success = wilson_percentage(rows["success"].to_list())
    endings = rows.filter(~pl.col("success")).group_by("ending", maintain_order=True).len()
    return [
        Figure(table, "done", "% of episodes", success, higher_is_better=True),
        Figure(table, "time", "s", bootstrap_mean(done["seconds"])),
        *(Figure(table, words, "% of episodes", wilson_of(n, len(rows))) for words, n in endings.iter_rows()),
        falls_figure(table, rows["fell"]),
    ]


EXPERIMENT = Experiment(
    "behaviours",
    "a behaviour of your own, again and again: how often it is done, and why not",
    BehavioursSettings,
    numbered,
    episode,
    figures,
)
