"""The paper's table of foot displacement: how far the feet of a standing robot travel while its arms are moved.

In an episode of 20 s, one of h, p and w is commanded and the others are at their defaults. The displacement is the
summed path length of both feet; a robot that has to step to stay up has a long one. Feet that stand firmly still creep
a little in MuJoCo. That creep is part of the displacement and is also given separately (`metrics.foot_travel`).
Episodes with a fall would have short paths: they are left out, and counted.
"""

import polars as pl

from hugwbc.evaluation.conditions import INTERVENTIONS
from hugwbc.evaluation.experiment import Experiment, Section
from hugwbc.evaluation.experiments.intervention import ARMS, TRAINED, InterventionSettings, adapt, paper_alone, plan
from hugwbc.evaluation.experiments.single_command import episode, sampled_commands
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import bootstrap_mean
from hugwbc.evaluation.paper import TRAININGS, foot_displacement
from hugwbc.gait import Gait
from hugwbc.settings import Count, Positive, settings


@settings(kw_only=True)
class FootDisplacementSettings(InterventionSettings):
    """Settings of foot-displacement."""

    gait: str = "standing"  # standing; other gaits are refused
    # number of episodes in all, split evenly over the interventions, and each share over h, p and w
    episodes: Count = 36
    duration: Positive = 21.0  # length of an episode [s]: the paper's 20 s, and the settling time
    possible = ("standing",)


def figures(settings: FootDisplacementSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return displacement, creep and falls, a table for each intervention; and the paper's of other trainings."""
    found, names, trained = [], sampled_commands(Gait.STANDING), TRAINED[str(settings.training)]
    for arms in INTERVENTIONS:
        table, part = f"Foot displacement, {ARMS[arms]}", rows.filter(pl.col("intervention") == arms)
        paper = foot_displacement(arms, str(settings.training))
        for name in names:
            kept = part.filter((pl.col("command") == name) & ~pl.col("fell"))
            travel, creep = bootstrap_mean(kept["foot_travel"]), bootstrap_mean(kept["foot_creep"])
            found.append(Figure(table, f"{name} commanded", "m", travel, paper.get(name), reference=trained))
            found.append(Figure(table, f"{name} commanded, creep in it", "m", creep, reference=trained))
        found.append(falls_figure(table, part["fell"], trained))
        for training in TRAININGS:
            lengths = {f"{name} commanded": length for name, length in foot_displacement(arms, training).items()}
            if training != settings.training:
                found += paper_alone(table, lengths, dict.fromkeys(lengths, "m"), training)
    return found


EXPERIMENT = Experiment(
    "foot-displacement",
    "path length of the feet of a standing robot while its arms are moved",
    FootDisplacementSettings,
    plan,
    episode,
    figures,
    adapt=adapt,
    section=Section(
        "Foot displacement",
        "Summed path length of both feet of a robot that should stand for 20 s. Episodes with a fall are left out of "
        "the length and counted.",
        lambda: [FootDisplacementSettings(episodes=9)],
        lambda: [FootDisplacementSettings(episodes=3 * 96)],
        ablation=True,
    ),
)
