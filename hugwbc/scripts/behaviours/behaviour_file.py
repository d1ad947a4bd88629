"""Behaviours as YAML files.

    about: Walk to a box, take it and bring it to the bench.
    steps:
      - walk_to: {before: parcel, distance: 0.45}
      - retry:
          times: 3
          do:
            - squeeze: {object: parcel, force: 40}
            - lift: {object: parcel, height: 0.1}
          between: [release]
      - carry: {object: parcel, before: bench, distance: 0.55}
      - wait_until: {elapsed: {seconds: 1}}
      - place: {object: parcel, lower: 0.5}
      - on_failure:
          do: [{face: {yaw: 0}}]
          then: [release]
          recovers: false
      - parallel:
          legs: [{walk_to: {position: [0, 0]}}]
          hands: [{reach: {left: [0.3, 0.3, 0.1]}}]

A step is the name of a class in `hugwbc.scripts.behaviours`, in small letters, with the arguments of its constructor.
`do`, `then`, `between`, `legs` and `hands` are lists of steps. YAML anchors may repeat parts.
"""

import functools
import inspect
import pathlib
import re
import types
from collections.abc import Callable, Collection, Mapping
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field, TypeAdapter, ValidationInfo

from hugwbc.errors import ConfigError, HugwbcError, UnknownNameError
from hugwbc.scripts.behaviours import conditions, hand_steps, haul_steps, hold_steps, walk_steps
from hugwbc.scripts.behaviours.behaviour import Behaviour
from hugwbc.scripts.behaviours.composition import OnFailure, Parallel, Retry, Sequence, WaitUntil, in_order
from hugwbc.scripts.script import Script
from hugwbc.scripts.script_file import SCRIPT_NAMES, load_script
from hugwbc.settings import refusing, settings
from hugwbc.settings_file import load, named_path, shipped_names
from hugwbc.targets import HAND_FRAMES

FOLDER = pathlib.Path(__file__).parent
BEHAVIOUR_NAMES = shipped_names(FOLDER)
CONDITIONS: Mapping[str, type[Any]] = {
    "arrived": conditions.Arrived,
    "contact": conditions.Contact,
    "elapsed": conditions.Elapsed,
    "force_above": conditions.ForceAbove,
    "lifted": conditions.Lifted,
    "moved": conditions.Moved,
}


def load_behaviour(name: str | pathlib.Path, objects: Collection[str] | None = None) -> Behaviour:
    """Load a shipped behaviour, one of `BEHAVIOUR_NAMES`, or a behaviour from a path that ends in .yaml or .yml.

    Args:
        name: name or path.
        objects: names of the objects in the scene (`Scene.body_names`), so that the file is refused if it names others;
            None not to ask.
    """
    path = named_path("behaviour", name, FOLDER)
    file = load(_File, path, {"objects": objects})
    return Sequence(*file.steps, name=path.stem, about=file.about)


def load_plan(name: str | pathlib.Path, objects: Collection[str] | None = None) -> Script | Behaviour:
    """Load a timed script or a behaviour: the name of a shipped one, or a YAML file with `segments:` or `steps:`.

    Args:
        name: name or path.
        objects: as for `load_behaviour`.
    """
    path = pathlib.Path(name)
    if path.suffix in (".yaml", ".yml"):
        return load_behaviour(name, objects) if "steps" in load(dict[str, Any], path) else load_script(name)
    if str(name) in BEHAVIOUR_NAMES:
        return load_behaviour(name, objects)
    if str(name) not in SCRIPT_NAMES:
        raise UnknownNameError("script", name, (*SCRIPT_NAMES, *BEHAVIOUR_NAMES, "or a file that ends in .yaml"))
    return load_script(name)


def _object(name: str, info: ValidationInfo) -> str:
    known = (info.context or {}).get("objects")
    if not name or (known is not None and not known):
        raise ConfigError(f"there is no object '{name}'; give the scene that has it, or mend the name")
    if known is not None and name not in known:
        raise UnknownNameError("object", name, known)
    return name


def _frame(name: str, info: ValidationInfo) -> str:
    return name if name in HAND_FRAMES else _object(name, info)


@functools.cache
def _arguments(name: str, make: Callable[..., Any]) -> TypeAdapter[dict[str, Any]]:
    """Return the check of {NAME: arguments}, by the signature of what makes it."""
    hints: dict[str, Any] = {}
    defaults: dict[str, Any] = {}
    arguments = list(inspect.signature(make).parameters.values())
    if make is hold_steps.Carry:  # takes what `WalkTo` takes
        arguments = [*arguments[:-1], *list(inspect.signature(walk_steps.WalkTo).parameters.values())[1:]]
    for argument in arguments:
        kind, check = argument.annotation, _BY_NAME.get(argument.name)
        check = _BEHAVIOUR if kind in (Behaviour, Behaviour | None) else check
        kind = Any if argument.name == "condition" else kind
        hints[argument.name] = kind if check is None else Annotated[kind, check]
        if argument.default is not argument.empty:
            defaults[argument.name] = argument.default
    model = settings(kw_only=True)(type(name, (), {"__annotations__": hints, **defaults}))
    kind: Any = types.GenericAlias(dict, (str, model))
    return TypeAdapter(kind)


def _made(what: str, makers: Mapping[str, Callable[..., Any]], value: Any, info: ValidationInfo) -> Any:  # noqa: ANN401
    """Return what a file declares as NAME, or as {NAME: its arguments}."""
    if isinstance(value, str):
        value = {value: None}
    if not isinstance(value, Mapping) or len(value) != 1:
        raise ConfigError(f"expected one {what}, such as `{next(iter(makers))}: {{...}}`; begin each with `- `")
    ((name, given),) = value.items()
    if name not in makers:
        raise UnknownNameError(what, name, makers, at=(name,))
    given = {} if given is None else given
    if name == "wait_until" and isinstance(given, Mapping):  # the condition stands beside its timeout
        found = {key: given[key] for key in CONDITIONS if key in given}
        given = {"condition": found, **{key: field for key, field in given.items() if key not in found}}
    arguments = _arguments(name, makers[name]).validate_python({name: given}, context=info.context)[name]
    try:
        return makers[name](**{field: getattr(arguments, field) for field in given})
    except HugwbcError as error:
        word = re.match(r"(unknown )?(\w*)", str(error))
        culprit = (word[2],) if word and word[2] in given else error.at
        raise ConfigError(error, at=(name, *culprit)) from error


def _steps(value: Any, info: ValidationInfo) -> Behaviour:  # noqa: ANN401
    """Return the steps of a list as one behaviour."""
    steps = TypeAdapter(_Steps).validate_python(value, context=info.context)
    return in_order(steps)


def _sequence(do: Behaviour) -> Behaviour:
    return do


_Steps = Annotated[
    tuple[Annotated[Any, BeforeValidator(refusing(lambda value, info: _made("step", STEPS, value, info)))], ...],
    Field(min_length=1),
]
_CONDITION = BeforeValidator(refusing(lambda value, info: _made("condition", CONDITIONS, value, info)))
# Checks of arguments by their names, and by their types.
_BY_NAME = {
    **dict.fromkeys(("object", "before", "on"), AfterValidator(refusing(_object))),
    "frame": AfterValidator(refusing(_frame)),
    "condition": _CONDITION,
}
_BEHAVIOUR = BeforeValidator(refusing(_steps))


@settings
class _File:
    """What a file holds."""

    steps: _Steps
    about: str = ""


STEPS: Mapping[str, Callable[..., Behaviour]] = {
    "walk_to": walk_steps.WalkTo,
    "face": walk_steps.Face,
    "reach": hand_steps.Reach,
    "move_hands": hand_steps.MoveHands,
    "press": hand_steps.Press,
    "wipe": hand_steps.Wipe,
    "grasp": hold_steps.Grasp,
    "squeeze": hold_steps.Squeeze,
    "attach": hold_steps.Attach,
    "lift": hold_steps.Lift,
    "carry": hold_steps.Carry,
    "place": hold_steps.Place,
    "release": hold_steps.Release,
    "push": haul_steps.Push,
    "pull": haul_steps.Pull,
    "stand": haul_steps.Stand,
    "sequence": _sequence,
    "parallel": Parallel,
    "retry": Retry,
    "on_failure": OnFailure,
    "wait_until": WaitUntil,
}
