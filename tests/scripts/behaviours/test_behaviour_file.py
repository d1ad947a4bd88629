"""Behaviours as YAML: what is right is built, what is wrong is refused with its line and column."""

import inspect
import pathlib
import re

import pytest

from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.scripts import Script
from hugwbc.scripts.behaviours import (
    Carry,
    OnFailure,
    Parallel,
    Press,
    Release,
    Retry,
    Sequence,
    WaitUntil,
    WalkTo,
    load_plan,
)
from hugwbc.scripts.behaviours.behaviour_file import CONDITIONS, STEPS, load_behaviour

PATH = pathlib.Path("task.yaml")
GOOD = {
    "walk_to": "{position: [1, 0]}",
    "face": "{yaw: 0.5}",
    "reach": "{left: [0.3, 0.2, 0.1]}",
    "move_hands": "{by: [0, 0, 0.1]}",
    "press": "{object: bell}",
    "wipe": "{object: desk, path: [[0, 0, 0.8], [0, 0.2, 0.8]]}",
    "grasp": "{object: box}",
    "squeeze": "{object: box}",
    "attach": "{object: handle}",
    "lift": "{object: box}",
    "carry": "{object: box, before: desk}",
    "place": "{object: box}",
    "release": "{}",
    "push": "{object: cart, distance: 1}",
    "pull": "{object: drawer, distance: 0.2}",
    "stand": "{h: -0.1}",
}
CONDITION = {
    "arrived": "{position: [1, 0]}",
    "contact": "{hand: left}",
    "elapsed": "{seconds: 1}",
    "force_above": "{force: 10}",
    "lifted": "{object: box}",
    "moved": "{object: cart, distance: 1}",
}


@pytest.fixture
def read(tmp_path, monkeypatch):
    """Reads a behaviour from the text of task.yaml."""
    monkeypatch.chdir(tmp_path)

    def from_text(text: str):
        PATH.write_text(text)
        return load_behaviour(PATH)

    return from_text


def _arguments(cls: type) -> dict[str, inspect.Parameter]:
    return dict(list(inspect.signature(cls.__init__).parameters.items())[1:])


def _with(name: str, field: str, value: str) -> str:
    """The good step of a name with one field set to a value, in the third line of a file."""
    inside = [part for part in _parts(GOOD[name][1:-1]) if not part.startswith(f"{field}:")]
    return f"about: wrong\nsteps:\n  - {name}: {{{', '.join([*inside, f'{field}: {value}'])}}}\n"


def _parts(text: str) -> list[str]:
    """Fields of a flow mapping; commas inside brackets do not count."""
    return [part.strip() for part in re.split(r",(?![^\[]*\])", text.replace("]]", "] ]")) if part.strip()]


def _wrong_fields() -> list[tuple[str, str]]:
    cases = []
    for name, cls in ((name, STEPS[name]) for name in GOOD):
        cases.append((f"{name} with a colour", _with(name, "colour", "red")))
        for field, argument in _arguments(cls).items():
            kind = str(argument.annotation)
            if kind.startswith(("<class 'float'", "float")):
                cases.append((f"{name} {field} in words", _with(name, field, "wide")))
                cases.append((f"{name} {field} not a number", _with(name, field, "nan")))
            elif "tuple" in kind:
                cases.append((f"{name} {field} too short", _with(name, field, "[1]")))
            elif "bool" in kind:
                cases.append((f"{name} {field} neither", _with(name, field, "maybe")))
    return cases


OTHERS = [
    ("steps: []", 1, "at least 1"),
    ("steps: walk_to", 1, "list"),
    ("about: nothing", 1, "steps is missing"),
    ("- walk_to", 1, "fields of"),
    ("steps:\n  - dance: {}", 2, "dance"),
    ("steps:\n  - [walk_to]", 2, "expected one step"),
    ("steps:\n  - {walk_to: {position: [1, 0]}, face: {yaw: 1}}", 2, "expected one step"),
    ("steps:\n  - walk_to", 2, "position"),
    ("steps:\n  - press", 2, "object is missing"),
    ("steps:\n  - press: {}", 2, "object is missing"),
    ("steps:\n  - push: {object: cart}", 2, "distance is missing"),
    ("steps:\n  - walk_to: {position: [1, 0], before: desk}", 2, "give one of them"),
    ("steps:\n  - walk_to: {before: desk, yaw: 1}", 2, "give turn"),
    ("steps:\n  - walk_to: {position: [1, 0], position: [2, 0]}", 2, "twice"),
    ("steps:\n  - walk_to: {position: [1, 0], speed: 3}", 2, "0.05 to 0.6"),
    ("steps:\n  - face: {}", 2, "object or a yaw"),
    ("steps:\n  - reach: {}", 2, "neither hand"),
    ("steps:\n  - press: {object: bell, hand: third}", 2, "third"),
    ("steps:\n  - press: {object: bell, hand: both}", 2, "left or right"),
    ("steps:\n  - press: {object: bell, axis: [0, 0, 0]}", 2, "not zero"),
    ("steps:\n  - squeeze: {object: box, force: -3}", 2, "force is -3"),
    ("steps:\n  - squeeze: {object: box, force: 1e9}", 2, "up to 150"),
    ("steps:\n  - wipe: {object: desk, path: [[0, 0, 1]]}", 2, "at least two"),
    ("steps:\n  - place: {object: box, on: desk}", 2, "needs at"),
    ("steps:\n  - stand: {h: 4}", 2, "command h"),
    ("steps:\n  - lift: {object: box, timeout: 0}", 2, "timeout is 0"),
    ("steps:\n  - release\n  - retry: {times: 3}", 3, "do is missing"),
    ("steps:\n  - release\n  - retry: {do: [release], times: 0}", 3, "1 or more"),
    ("steps:\n  - release\n  - retry: {do: [release], times: 1.5}", 3, "integer"),
    ("steps:\n  - release\n  - retry:\n      do:\n        - jump", 5, "jump"),
    ("steps:\n  - on_failure: {do: [release]}", 2, "then is missing"),
    ("steps:\n  - parallel: {legs: [release]}", 2, "hands is missing"),
    ("steps:\n  - parallel:", 2, "legs is missing"),
    ("steps:\n  - sequence:", 2, "do is missing"),
    ("steps:\n  - wait_until", 2, "condition"),
    ("steps:\n  - wait_until: {timeout: 3}", 2, "expected one condition"),
    ("steps:\n  - wait_until: {contact: {}, elapsed: {seconds: 1}}", 2, "expected one condition"),
    ("steps:\n  - wait_until: {full_moon: {}}", 2, "full_moon"),
    ("steps:\n  - wait_until: {contact: {}, hold: -1}", 2, "hold is -1"),
    ("steps:\n  - wait_until: {contact: {}, timeout: inf}", 2, "number"),
    ("steps:\n  - wait_until: {force_above: {force: 0}}", 2, "force is 0"),
    ("steps:\n  - wait_until: {lifted: {object: box, height: nan}}", 2, "number"),
    ("steps:\n  - wait_until: {elapsed: }", 2, "seconds is missing"),
    ("steps:\n  - {walk_to: {position: [1, 0]}", 2, "not valid YAML"),
    ("steps: &all\n  - sequence: {do: *all}", 2, "levels"),
    ("segments:\n  - {label: stand, duration: 1}", 1, "segments"),
]


@pytest.mark.parametrize(("text", "line", "words"), OTHERS, ids=[text for text, _, _ in OTHERS])
def test_a_mistake_is_refused_with_its_place(read, text: str, line: int, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        read(text)
    assert re.match(rf"task\.yaml:{line}:\d+: ", str(caught.value)), caught.value
    assert words in str(caught.value)


@pytest.mark.parametrize(("text"), [text for _, text in _wrong_fields()], ids=[name for name, _ in _wrong_fields()])
def test_a_wrong_field_of_every_step_is_refused_with_its_place(read, text: str) -> None:
    with pytest.raises(ConfigError, match=r"^task\.yaml:3:\d+: "):
        read(text)


def test_there_are_enough_mistakes() -> None:
    assert len(OTHERS) + len(_wrong_fields()) > 100
    assert set(STEPS) == {*GOOD, "sequence", "parallel", "retry", "on_failure", "wait_until"}
    assert set(CONDITION) == set(CONDITIONS)


@pytest.mark.parametrize("name", GOOD)
def test_every_step_is_built(read, name: str) -> None:
    behaviour = read(f"steps:\n  - {name}: {GOOD[name]}")
    assert isinstance(behaviour, Sequence)
    assert type(behaviour.steps[0]) is STEPS[name]
    assert behaviour.steps[0].label == name
    assert behaviour.name == "task"


@pytest.mark.parametrize("name", CONDITIONS)
def test_every_condition_is_built(read, name: str) -> None:
    behaviour = read(f"steps:\n  - wait_until: {{{name}: {CONDITION[name]}, timeout: 3, hold: 0.5}}")
    assert isinstance(behaviour, Sequence)
    wait = behaviour.steps[0]
    assert isinstance(wait, WaitUntil) and type(wait.condition) is CONDITIONS[name]
    assert (wait.timeout, wait.hold) == (3.0, 0.5)


def test_steps_in_steps(read) -> None:
    behaviour = read(
        "about: all of them\n"
        "steps:\n"
        "  - retry: {do: [{press: {object: bell, travel: 0.01}}], times: 2, between: [release]}\n"
        "  - on_failure: {do: [release], then: [release], recovers: false}\n"
        "  - parallel: {legs: [{walk_to: {position: [1, 0]}}], hands: [release, release]}\n"
        "  - sequence: {do: [release]}\n"
        "  - carry: {object: box, before: desk, distance: 0.4}\n"
    )
    assert isinstance(behaviour, Sequence)
    retry, on_failure, parallel, sequence, carry = behaviour.steps
    assert isinstance(retry, Retry) and retry.times == 2
    assert isinstance(retry.behaviour, Press) and retry.behaviour.travel == 0.01
    assert isinstance(on_failure, OnFailure) and not on_failure.recovers
    assert isinstance(parallel, Parallel) and isinstance(parallel.legs, WalkTo)
    assert isinstance(sequence, Release)
    assert isinstance(carry, Carry) and carry.walk.distance == 0.4
    assert behaviour.about == "all of them"


def test_a_file_that_grows_without_end_is_refused(read) -> None:
    lines = ["steps:", "  - sequence: {do: &a0 [release, release]}"]
    lines += [
        f"  - sequence: {{do: &a{i} [{{sequence: {{do: *a{i - 1}}}}}, {{sequence: {{do: *a{i - 1}}}}}]}}"
        for i in range(1, 12)
    ]
    with pytest.raises(ConfigError, match="values"):
        read("\n".join(lines))


def test_files_and_names(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "knock.yaml"
    path.write_text("steps:\n  - press: {object: door}\n")
    assert isinstance(load_plan(path), Sequence)
    assert isinstance(load_behaviour(path), Sequence)
    assert isinstance(load_plan("walk"), Script)
    timed = tmp_path / "wait.yaml"
    timed.write_text("segments:\n  - {label: stand, duration: 1}\n")
    assert isinstance(load_plan(timed), Script)
    with pytest.raises(UnknownNameError, match="dance"):
        load_plan("dance")
    with pytest.raises(UnknownNameError, match="dance"):
        load_behaviour("dance")
    with pytest.raises(ConfigError, match="cannot read"):
        load_plan(tmp_path / "nothing.yaml")
