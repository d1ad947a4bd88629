"""The paper's tables of tracking errors and of the feet's displacement while the arms are under external control.

Every kind of intervention gets the same sampled commands, so that two of them differ in the arms alone. The paper's
ablation crosses what moves the arms in the test with what moved them in training, and prints policies of all
`TRAININGS`. A learned policy is compared with the paper's policy of the same training, and any other controller with
the paper's best one.

Foot displacement is how far the feet of a robot that should stand travel: the summed path length of both; a robot that
has to step to stay up has a long one. Feet that stand firmly still creep a little in MuJoCo. That creep is part of the
displacement and is also given separately (`metrics.foot_travel`). Episodes with a fall would have short paths: they are
left out, and counted.
"""

import dataclasses
import math
from typing import Literal

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
from hugwbc.settings import Count, settings

ERROR_OF = {name: f"E_{name.replace('_', '')}" for name in COMMAND_NAMES}  # the paper's names; v_x at all speeds
ARMS = {"noise": "arms moved by noise", "motion": "arms moved by motions", "none": "arms free"}
DISPLACEMENT = "foot displacement, {} commanded"
STOOD = 20.0  # [s], of the paper's displacement
UNTRAINED_AGAINST = "noise"  # the training of the paper's policy that is compared with untrained controllers


@settings(kw_only=True)
class InterventionSettings(CountedSettings):
    """Settings of intervention."""

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


def adapt(settings: InterventionSettings, spec: ControllerSpec) -> InterventionSettings:
    """Compare with the paper's policy of the same training, unless the settings name another one."""
    return dataclasses.replace(settings, training=settings.training or spec.training or UNTRAINED_AGAINST)


def figures(settings: InterventionSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return errors, displacement of the feet of a stand and falls, a table for each intervention.

    The paper's figures of other trainings follow.
    """
    found, seconds = [], settings.duration - settings.settle
    commands = sampled_commands(settings.gaits[0], settings.robot)
    units = {ERROR_OF[name]: unit for name, unit in COMMAND_UNITS.items()}
    units |= {DISPLACEMENT.format(name): f"m in {seconds:g} s" for name in COMMAND_NAMES}
    for arms in INTERVENTIONS:
        table, part = f"Intervention, {settings.gait}, {ARMS[arms]}", rows.filter(pl.col("intervention") == arms)
        paper, trained = printed(settings, arms, str(settings.training)), TRAININGS[str(settings.training)]
        for name in commands:
            estimate = bootstrap_mean(part.filter(pl.col("command") == name)["error"])
            error = ERROR_OF[name]
            found.append(Figure(table, error, units[error], estimate, paper.get(error), reference=trained))
        for name in commands if settings.gaits[0] is Gait.STANDING else ():
            kept, path = part.filter((pl.col("command") == name) & ~pl.col("fell")), DISPLACEMENT.format(name)
            travel, creep = bootstrap_mean(kept["foot_travel"]), bootstrap_mean(kept["foot_creep"])
            found.append(Figure(table, path, units[path], travel, paper.get(path), reference=trained))
            found.append(Figure(table, f"{path}, creep in it", units[path], creep, reference=trained))
        found.append(falls_figure(table, part["fell"], trained))
        if part["arm_error"].null_count() < len(part):
            error = bootstrap_mean(part["arm_error"])
            found.append(Figure(table, "arm joints, distance to their targets", "rad", error, reference=trained))
        found += [
            Figure(table, quantity, units[quantity], None, value, reference=words)
            for training, words in TRAININGS.items()
            for quantity, value in printed(settings, arms, training).items()
            if training != settings.training
        ]
    return found


def printed(settings: InterventionSettings, arms: str, training: str) -> dict[str, float]:
    """Return the paper's figures of a training by quantity; those of feet only for a stand as long as the paper's."""
    found = dict(intervention_errors(settings.gaits[0], arms, training))
    if settings.gaits[0] is Gait.STANDING and math.isclose(settings.duration - settings.settle, STOOD):
        found |= {DISPLACEMENT.format(name): length for name, length in foot_displacement(arms, training).items()}
    return found


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
        "people, ours are generated or given. The displacement is the summed path length of both feet of a robot that "
        "should stand for 20 s. Episodes with a fall are left out of it and counted.",
        quick=lambda: [
            InterventionSettings(gait=gait, episodes=count, duration=duration)
            for gait, count, duration in (("standing", 9, 21.0), ("walking", 24, 5.0), ("jumping", 24, 5.0))
        ],
        full=lambda: [
            InterventionSettings(gait=gait, episodes=3 * 256, duration=21.0)
            for gait in ("standing", "walking", "jumping")  # for which the paper has figures
        ],
    ),
)
