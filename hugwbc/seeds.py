"""Classes of seeds: selection, report, training.

A figure is only as honest as its seed. If many policies are tried on one seed and the best is kept, that seed's figures
flatter it. So the seeds with which something is chosen are not those with which it is reported:

- selection, 0 to 999: everything that is tried, tuned or chosen, and the evaluations inside a training. Seeds 3 and 4
  belong here: they chose and reported before there were classes.
- report, 1000 to 1999: published figures. Nothing is chosen by what they show.
- training, 2000 to 2999: the random numbers of a training. Trainings before there were classes had seeds 1, 2 and 4.
- own, from 3000 on: free.
"""

SELECTION_SEEDS = range(1000)
REPORT_SEEDS = range(1000, 2000)
TRAINING_SEEDS = range(2000, 3000)

SELECTION_SEED, REPORT_SEED, TRAINING_SEED = SELECTION_SEEDS[0], REPORT_SEEDS[0], TRAINING_SEEDS[0]  # the defaults

_CLASSES = {"selection": SELECTION_SEEDS, "report": REPORT_SEEDS, "training": TRAINING_SEEDS}


def seed_class(seed: int) -> str:
    """Return the class of a seed: "selection", "report", "training", or "own" for the free ones."""
    return next((name for name, seeds in _CLASSES.items() if seed in seeds), "own")
