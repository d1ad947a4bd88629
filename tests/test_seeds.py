import dataclasses

from hugwbc.evaluation.episode import Settings
from hugwbc.learned.config import RecordConfig, TrainConfig
from hugwbc.settings import REPORT_SEEDS, SELECTION_SEEDS, TRAINING_SEEDS, seed_class


def test_every_seed_has_one_class():
    assert [seed_class(seed) for seed in (0, 3, 4, 999)] == ["selection"] * 4
    assert seed_class(1000) == seed_class(1999) == "report" and seed_class(2000) == seed_class(2999) == "training"
    assert seed_class(3000) == seed_class(10**12) == "own"
    classes = (SELECTION_SEEDS, REPORT_SEEDS, TRAINING_SEEDS)
    assert len({seed for seeds in classes for seed in seeds}) == sum(map(len, classes)), "no seed has two classes"


def test_defaults_are_of_the_class_of_their_use():
    assert seed_class(Settings().seed) == "report"
    fields = [f for kind in (TrainConfig, RecordConfig) for f in dataclasses.fields(kind)]
    assert [seed_class(field.default) for field in fields if field.name == "seed"] == ["training"] * 2
