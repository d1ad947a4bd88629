"""The paper's table of tracking errors while the arms are under external control, and of the feet's displacement then.

Every kind of intervention gets the same sampled commands, so that two of them differ in the arms alone. The paper's
ablation crosses what moves the arms in the test with what moved them in training, and prints policies of all
`TRAININGS`. A learned policy is compared with the paper's policy of the same training, and a controller that was not
trained with the paper's best one.
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import Literal, TypeVar

import polars as pl

from hugwbc.commands import COMMAND_NAMES, COMMAND_UNITS
from hugwbc.errors import ConfigError
from hugwbc.evaluation.conditions import INTERVENTIONS
from hugwbc.evaluation.episode import CountedSettings
from hugwbc.evaluation.experiment import Experiment, Section
from hugwbc.evaluation.experiments.single_command import episode, sampled_commands, stratified_samples
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import bootstrap_mean
from hugwbc.evaluation.paper import TRAININGS, foot_displacement, intervention_errors
from hugwbc.evaluation.plans import Plan
from hugwbc.gait import Gait
from hugwbc.runtime.controllers import ControllerSpec
from hugwbc.settings import Count, Positive, settings

ERROR_OF = {name: f"E_{name.replace('_', '')}" for name in COMMAND_NAMES}  # the paper's names; v_x at all speeds
ARMS = {"noise": "arms moved by noise", "motion": "arms moved by motions", "none": "arms free"}
STOOD = 20.0  # [s], in which the paper's feet go so far
UNTRAINED_AGAINST = "noise"  # the training of the paper's policy that is compared with untrained controllers


@settings(kw_only=True)
class InterventionSettings(CountedSettings):
    """Settings of the experiments that move the arms."""

    episodes: Count = 96  # number of episodes in all, split evenly over the interventions and the commands of the gait
    # training of the paper's policy to compare with: noise, motion or none; by default the one that the policy's own
    # file names, and noise for other controllers
    training: Literal["noise", "motion", "none"] | None = None
    varied = frozenset({"intervention"})

    def __post_init__(self) -> None:
        super().__post_init__()
        commands = len(sampled_commands(self.gaits[0], self.robot))
        if self.episodes < (least := len(INTERVENTIONS) * commands):
            raise ConfigError(
                f"episodes is {self.episodes}; give {least} or more: {len(INTERVENTIONS)} interventions and {commands} "
                "commands"
            )


S = TypeVar("S", bound=InterventionSettings)


def plan(settings: InterventionSettings) -> list[Plan]:
    """Return the same stratified samples of single commands under every intervention."""
    # The same draw under every intervention: ground and sensor noise are the same as well.
    return [
        Plan(
            draw,
            command,
            {"intervention": intervention, "command": name},
            conditions=dataclasses.replace(settings.conditions, intervention=intervention),
        )
        for intervention in INTERVENTIONS
        for draw, (name, command) in enumerate(stratified_samples(settings, settings.episodes // len(INTERVENTIONS)))
    ]


def adapt(settings: S, spec: ControllerSpec) -> S:
    """Compare with the paper's policy of the same training, unless the settings name another one."""
    return dataclasses.replace(settings, training=settings.training or spec.training or UNTRAINED_AGAINST)


def figures(settings: InterventionSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return errors and falls, a table for each intervention; and the paper's of other trainings."""
    found, gait = [], settings.gaits[0]
    for arms in INTERVENTIONS:
        table, part = f"Intervention, {settings.gait}, {ARMS[arms]}", rows.filter(pl.col("intervention") == arms)
        paper, trained = intervention_errors(gait, arms, str(settings.training)), TRAININGS[str(settings.training)]
        for name in sampled_commands(gait, settings.robot):
            estimate = bootstrap_mean(part.filter(pl.col("command") == name)["error"])
            error = ERROR_OF[name]
            found.append(Figure(table, error, COMMAND_UNITS[name], estimate, paper.get(error), reference=trained))
        found.append(falls_figure(table, part["fell"], trained))
        if part["arm_error"].null_count() < len(part):
            error = bootstrap_mean(part["arm_error"])
            found.append(Figure(table, "arm joints, distance to their targets", "rad", error, reference=trained))
        units = {ERROR_OF[name]: unit for name, unit in COMMAND_UNITS.items()}
        for training in TRAININGS:
            if training != settings.training:
                found += paper_alone(table, intervention_errors(gait, arms, training), units, training)
    return found


def paper_alone(table: str, values: Mapping[str, float], units: Mapping[str, str], training: str) -> list[Figure]:
    """Return figures of the paper's policy of a training that is not the controller's."""
    return [
        Figure(table, quantity, units[quantity], None, value, reference=TRAININGS[training])
        for quantity, value in values.items()
    ]


INTERVENTION = Experiment(
    "intervention",
    "the same single commands with the arms moved by noise, by motions, and not at all",
    InterventionSettings,
    plan,
    episode,
    figures,
    adapt=adapt,
    section=Section(
        "Intervention",
        "The same single commands while the arms are moved from outside. A policy is compared with the paper's policy "
        "of the same training (noise, motions or nothing), and an untrained controller with the one trained with "
        "noise. Where we have no policy, the paper's figures stand alone. The paper's motions are recorded from "
        "people, ours are generated or given.",
        quick=lambda: [
            InterventionSettings(gait=gait, episodes=count, duration=5.0)
            for gait, count in {"standing": 9, "walking": 24, "jumping": 24}.items()
        ],
        full=lambda: [
            InterventionSettings(gait=gait, episodes=3 * 256, duration=21.0)
            for gait in ("standing", "walking", "jumping")  # for which the paper has figures
        ],
    ),
)


# The paper's table of foot displacement: how far the feet of a standing robot travel while its arms are moved.
#
# In an episode of 20 s, one of h, p and w is commanded and the others are at their defaults. The displacement is the
# summed path length of both feet; a robot that has to step to stay up has a long one. Feet that stand firmly still
# creep a little in MuJoCo. That creep is part of the displacement and is also given separately (`metrics.foot_travel`).
# Episodes with a fall would have short paths: they are left out, and counted.


@settings(kw_only=True)
class FootDisplacementSettings(InterventionSettings):
    """Settings of foot-displacement."""

    gait: str = "standing"  # standing; other gaits are refused
    # number of episodes in all, split evenly over the interventions, and each share over h, p and w
    episodes: Count = 36
    duration: Positive = 21.0  # length of an episode [s]: the paper's 20 s, and the settling time
    possible = ("standing",)


def displacement_figures(settings: FootDisplacementSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return displacement, creep and falls, a table for each intervention.

    Only a stand as long as the paper's has its figures beside it, and those of its other trainings.
    """
    found, trained, seconds = [], TRAININGS[str(settings.training)], settings.duration - settings.settle
    printed = foot_displacement if math.isclose(seconds, STOOD) else lambda arms, training: {}
    names = sampled_commands(Gait.STANDING, settings.robot)
    for arms in INTERVENTIONS:
        table, part = f"Foot displacement in {seconds:g} s, {ARMS[arms]}", rows.filter(pl.col("intervention") == arms)
        paper = printed(arms, str(settings.training))
        for name in names:
            kept = part.filter((pl.col("command") == name) & ~pl.col("fell"))
            travel, creep = bootstrap_mean(kept["foot_travel"]), bootstrap_mean(kept["foot_creep"])
            found.append(Figure(table, f"{name} commanded", "m", travel, paper.get(name), reference=trained))
            found.append(Figure(table, f"{name} commanded, creep in it", "m", creep, reference=trained))
        found.append(falls_figure(table, part["fell"], trained))
        for training in TRAININGS:
            lengths = {f"{name} commanded": length for name, length in printed(arms, training).items()}
            if training != settings.training:
                found += paper_alone(table, lengths, dict.fromkeys(lengths, "m"), training)
    return found


FOOT_DISPLACEMENT = Experiment(
    "foot-displacement",
    "path length of the feet of a standing robot while its arms are moved",
    FootDisplacementSettings,
    plan,
    episode,
    displacement_figures,
    adapt=adapt,
    section=Section(
        "Foot displacement",
        "Summed path length of both feet of a robot that should stand for 20 s. Episodes with a fall are left out of "
        "the length and counted.",
        lambda: [FootDisplacementSettings(episodes=9)],
        lambda: [FootDisplacementSettings(episodes=3 * 96)],
    ),
)
