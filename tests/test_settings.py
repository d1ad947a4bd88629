"""Settings: checked the same from Python, from the command line and from files, where errors name the place."""

import dataclasses
import pickle
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import numpy as np
import pytest
import tyro
from pydantic import Field

from hugwbc.errors import ConfigError, HugwbcError, UnknownNameError
from hugwbc.evaluation.episode import Settings
from hugwbc.learned.config import TrainConfig
from hugwbc.settings import (
    REPORT_SEED,
    REPORT_SEEDS,
    SELECTION_SEEDS,
    TRAINING_SEEDS,
    Beside,
    Count,
    NotNegative,
    Positive,
    Seed,
    Share,
    one_of,
    seed_class,
    settings,
)
from hugwbc.settings_file import LARGEST_FILE, load, parse

PATH = Path("walk.yaml")


@settings
class Step:
    """One step."""

    foot: Literal["left", "right"]
    point: tuple[float, float] = (0.0, 0.0)
    count: Count = 1


@settings(kw_only=True)
class Walk:
    """A walk."""

    speed: Annotated[float, Field(gt=0, le=1.2)]
    pause: NotNegative = 0.0
    label: str = "walk"
    ends: bool = False
    seed: Seed = 0
    steps: tuple[Step, ...] = ()
    share: Share | None = None
    robot: Annotated[str, one_of("robot", lambda: ("h1", "h1-2023"))] = "h1"
    file: Beside | None = None

    def __post_init__(self) -> None:
        if self.pause > 10 * self.speed:
            raise ConfigError(f"a pause of {self.pause:g} s is too long", at=("pause",))


@settings(kw_only=True)
class Run(Walk):
    """A fast walk."""

    flight: Positive = 0.1


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ({"speed": 2}, r"speed is 2; .* less than or equal to 1\.2"),
        ({"speed": float("nan")}, "finite"),
        ({"speed": "fast"}, "'fast'.*number"),
        ({"speed": 0.1, "pause": 2.0}, "too long"),
        ({"speed": 1, "seed": 2.5}, "seed"),
        ({"sped": 1}, "unknown Run field 'sped'. Did you mean 'speed'"),
        ({}, "speed is missing"),
        ({"speed": 1, "robot": "h2"}, "unknown robot 'h2'.*h1-2023"),
        ({"speed": 1, "steps": [3]}, r"steps\.0 is 3; .* fields of a Step"),
        ({"speed": 1, "steps": [{"foot": "lft"}]}, "'lft'. Did you mean 'left'"),
        ({"speed": 1, "flight": 0}, "flight"),
    ],
)
def test_python_and_file_refuse_the_same(values, word) -> None:
    with pytest.raises(HugwbcError, match=word):
        Run(**values)
    with pytest.raises(ConfigError, match=rf"^walk\.yaml:1:\d+: .*{word}"):
        parse(Run, str(values), PATH)


def test_a_model_is_a_frozen_dataclass() -> None:
    values: dict[str, Any] = {"speed": np.float32(0.5), "steps": [Step("left", cast("Any", np.zeros(2)))]}
    walk = Walk(**values)
    assert walk == Walk(speed=0.5, steps=(Step("left"),)) == pickle.loads(pickle.dumps(walk))
    assert hash(walk) != hash(dataclasses.replace(walk, pause=1.0)) and type(walk.speed) is float
    with pytest.raises(ConfigError):
        dataclasses.replace(walk, pause=-1.0)
    with pytest.raises(dataclasses.FrozenInstanceError):
        walk.speed = 1.0
    with pytest.raises(UnknownNameError):
        Step(cast("Any", "lft"))


def test_a_command_line_makes_a_model() -> None:
    assert tyro.cli(Walk, args=["--speed", "0.5", "--ends"]) == Walk(speed=0.5, ends=True)
    with pytest.raises(ConfigError, match="speed"):
        tyro.cli(Walk, args=["--speed", "5"])


GOOD = """\
speed: 1e-1      # YAML 1.1 takes this for text
label: yes
ends: true
steps:
  - foot: left
    point: &p [1, 0x]
  - {foot: right, point: *p}
file: a/b.csv
"""


def test_a_file_makes_a_model(tmp_path) -> None:
    path = tmp_path / "walk.yaml"
    path.write_text("\ufeff" + GOOD.replace("0x", "2"), encoding="utf-8")
    steps = (Step("left", (1, 2)), Step("right", (1, 2)))
    expected = Walk(speed=0.1, label="yes", ends=True, steps=steps, file=tmp_path / "a/b.csv", seed=4)
    assert load(Walk, path, seed=4) == expected


BOMB = "".join(f"- &a{i} [{f'*a{i - 1}, ' * 10}1]\n" for i in range(1, 10)).replace("*a0", "1")


@pytest.mark.parametrize(
    ("text", "place", "word"),
    [
        (GOOD, "6:19", "'0x'"),
        (GOOD.replace("left", "lft").replace("0x", "0"), "5:5", "'left'"),
        (GOOD.replace("1e-1", ".inf").replace("0x", "0"), "1:1", "number"),
        (GOOD.replace("1e-1", "1:30").replace("0x", "0"), "1:1", "number"),
        ("speed: 0.1\npause: 3", "2:1", "too long"),
        ("speed: 1\nends: maybe", "2:1", "bool"),
        ("speed: 1\nsteps: [{foot: left}, {foot: left, wait: 2}]", "2:36", "unknown Step field 'wait'"),
        ("speed: 1\nspeed: 2", "2:1", "twice"),
        ("speed: 1\n? [a]\n: 2", "2:3", "no text"),
        ("speed: !kg 1", "1:8", "tag"),
        ("speed: !!python/object/apply:os.abort []", "1:8", "tag"),
        ("label: \"\\a\"", "1:8", "control"),
        ("speed: [", "2:1", "YAML"),
        ("speed: \x07", "1:1", "YAML"),
        ("3", "1:1", "fields of a Walk"),
        ("", "1:1", "speed is missing"),
        (BOMB, r"\d+:\d+", "values"),
        ("speed: &s [*s]", r"\d+:\d+", "values"),
        ("[" * 100_000, r"\d+:\d+", "levels"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_a_file_is_named_with_its_place(text, place, word) -> None:
    with pytest.raises(ConfigError, match=rf"^walk\.yaml:{place}: .*({word})"):
        parse(Walk, text, PATH)


@pytest.mark.parametrize(
    "text",
    [
        "null", "- a", "speed", "speed:\n\t- a", "speed: {a", "speed: *nope", "speed: 1\n---\nspeed: 1", "3: 3", "~: 3",
        "<<: {speed: [a]}", "{{a: b}: c}", "speed: !!set {a}", "speed: !!omap [a: b]", "speed: !!binary aGk=",
        "speed: !<%zz> []", "%YAML 9.9\n---\nspeed: 1", "%YAML " + "9" * 5000 + ".1\n---\nspeed: 1", "speed:\x00",
        "label: \"\\ud800\"", "label: \"\\UFFFFFFFF\"", "label: \"\\q\"", "x" * 20000 + ": 3",
    ],
    ids=range(22),
)  # fmt: skip
def test_hostile_yaml_is_refused_in_a_line_that_can_be_read(text) -> None:
    with pytest.raises(HugwbcError, match=r"^walk\.yaml:\d+:\d+: \S") as caught:
        parse(Walk, text, PATH)
    assert str(caught.value).isprintable() and len(str(caught.value)) < 2000


@pytest.mark.parametrize("content", [b"\xff\xfe", b"#" * (LARGEST_FILE + 1), None])
def test_what_is_no_text_file_is_refused(tmp_path, content) -> None:
    path = tmp_path / "walk.yaml"
    path.write_bytes(content) if content else path.mkdir()
    with pytest.raises(ConfigError, match=r"cannot read .*walk\.yaml.*UTF-8"):
        load(Walk, path)


def test_every_seed_has_one_class():
    assert [seed_class(seed) for seed in (0, 3, 4, 999)] == ["selection"] * 4
    assert seed_class(1000) == seed_class(1999) == "report" and seed_class(2000) == seed_class(2999) == "training"
    assert seed_class(3000) == seed_class(10**12) == "own"
    classes = (SELECTION_SEEDS, REPORT_SEEDS, TRAINING_SEEDS)
    assert len({seed for seeds in classes for seed in seeds}) == sum(map(len, classes)), "no seed has two classes"


def test_defaults_are_of_the_class_of_their_use():
    assert seed_class(Settings().seed) == "selection" and seed_class(REPORT_SEED) == "report"
    fields = dataclasses.fields(TrainConfig)
    assert [seed_class(field.default) for field in fields if field.name == "seed"] == ["training"]
