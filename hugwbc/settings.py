"""Settings: frozen models whose types say what is valid.

    @settings
    class Walk:
        speed: Annotated[float, Field(gt=0, le=1.2)]  # [m/s]; Field is pydantic's
        side: Literal["left", "right"] = "left"
        pause: NotNegative = 0.0  # [s]

        def __post_init__(self) -> None:  # for what no single type can say
            if self.pause > 10 * self.speed:
                raise ConfigError(f"pause is {self.pause} s; give at most {10 * self.speed} s", at=("pause",))

    Walk(speed=2)                # ConfigError: Walk.speed is 2; it should be less than or equal to 1.2
    load(Walk, Path("my.yaml"))  # ConfigError: my.yaml:3:1: unknown Walk field 'sped'. Did you mean 'speed'? ...

A model checks the same from Python, from a command line (tyro) and from a file (`hugwbc.settings_file`). It is a
dataclass: inherit, nest and `dataclasses.replace` it as usual. Numbers are finite; lists and arrays become tuples where
the type is one.
"""

import dataclasses
import functools
import pathlib
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Annotated, Any, TypeVar, dataclass_transform, overload

import pydantic.dataclasses
from pydantic import AfterValidator, ConfigDict, Field, ValidationError, ValidationInfo
from pydantic_core import ArgsKwargs

from hugwbc.errors import ConfigError, HugwbcError, UnknownNameError, one_line

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]
Gain = Annotated[float, Field(ge=0, le=2)]
PositiveShare = Annotated[float, Field(gt=0, le=1)]
Count = Annotated[int, Field(ge=1)]
Seed = Annotated[int, Field(ge=0, lt=2**63)]

_CONFIG = ConfigDict(extra="forbid", allow_inf_nan=False, arbitrary_types_allowed=True, coerce_numbers_to_str=True)
_WORDS = (
    ("^.*?should", "it should"),
    (", unable to parse.*| after validation.*", ""),
    ("a dictionary or an instance of", "the fields of a"),
    ("valid tuple", "list"),
    ("valid dictionary", "mapping"),
)
"""Words of pydantic's messages, and ours."""
Place = tuple[str | int, ...]
_T = TypeVar("_T")


class _Refusal(ValueError):  # noqa: N818  it is none, but carries one
    """Carries a HugwbcError through pydantic, which collects the ValueErrors of validators."""


def refusing(check: Callable[..., _T]) -> Callable[..., _T]:
    """Let a function that raises HugwbcErrors serve as a validator: `Annotated[float, AfterValidator(refusing(f))]`."""

    @functools.wraps(check)
    def wrapped(*args: Any, **fields: Any) -> _T:  # noqa: ANN401
        try:
            return check(*args, **fields)
        except HugwbcError as error:
            raise _Refusal(error) from error

    return wrapped


def one_of(kind: str, names: Callable[[], Collection[str]]) -> AfterValidator:
    """Return the annotation of a text that must be one of some names, which are looked up when one is checked."""

    def check(name: str) -> str:
        if name not in names():
            raise UnknownNameError(kind, name, names())
        return name

    return AfterValidator(refusing(check))


def not_default(options: Any, without: Collection[str] = ()) -> str:  # noqa: ANN401
    """Return which fields of a dataclass are not at their defaults, such as "drives ideal, payload 5"; "" for none."""
    found = []
    for field in dataclasses.fields(options):
        value, make = getattr(options, field.name), field.default_factory
        if field.name not in without and value != (field.default if make is dataclasses.MISSING else make()):
            words = " and ".join(map(str, value)) if isinstance(value, tuple) else value
            found.append(f"{field.name.replace('_', ' ')} {f'{value:g}' if isinstance(value, float) else words}")
    return ", ".join(found)


def check_each_once(kind: str, names: Sequence[str]) -> None:
    """Refuse an empty list, and a name that is given twice; the kind is for the message, such as "tasks"."""
    if not names or len(set(names)) < len(names):
        raise ConfigError(f"{kind} are {', '.join(names) or 'none'}; give at least one, each once")


def _beside(path: pathlib.Path, info: ValidationInfo) -> pathlib.Path:
    return (info.context or {}).get("folder", pathlib.Path()) / path


Beside = Annotated[pathlib.Path, AfterValidator(_beside)]
"""A path that is relative to the folder of the file in which it stands."""


@overload
def settings(cls: type[_T]) -> type[_T]: ...
@overload
def settings(*, kw_only: bool) -> Callable[[type[_T]], type[_T]]: ...
@dataclass_transform(frozen_default=True, field_specifiers=(dataclasses.field,))
def settings(cls: Any = None, *, kw_only: bool = False) -> Any:
    """Make a class a frozen dataclass that checks its fields by their types and raises HugwbcErrors."""
    if cls is None:
        return functools.partial(settings, kw_only=kw_only)
    if "__post_init__" in vars(cls):
        cls.__post_init__ = refusing(cls.__post_init__)
    cls._check_names = pydantic.model_validator(mode="before")(_check_names)
    cls = pydantic.dataclasses.dataclass(cls, frozen=True, kw_only=kw_only, config=_CONFIG)
    make, names = cls.__init__, [field.name for field in dataclasses.fields(cls) if field.init and not field.kw_only]

    @functools.wraps(make)
    def __init__(self: object, *values: Any, **fields: Any) -> None:  # noqa: ANN401, N807
        try:  # names instead of numbers in the messages
            make(self, *values[len(names) :], **dict(zip(names, values, strict=False)), **fields)
        except ValidationError as error:
            raise deepest(error)[1] from None

    cls.__init__ = __init__
    return cls


@classmethod
def _check_names(cls: Any, data: Any) -> Any:  # noqa: ANN401
    given = data.kwargs if isinstance(data, ArgsKwargs) else data
    names = [field.name for field in dataclasses.fields(cls) if field.init]
    for name in given if isinstance(given, Mapping) else ():
        if name not in names:
            raise _Refusal(UnknownNameError(f"{cls.__name__} field", name, names, at=(name,)))
    return data


def deepest(error: ValidationError) -> tuple[Place, HugwbcError]:
    """Return place and description of the deepest problem: in a union, that of the member that came nearest."""
    found = error.errors(include_url=False)
    causes = [each for each in found if each["type"] != "default_factory_not_called"]  # which another problem prevents
    problems = [_described(error.title, details) for details in causes or found]
    return max(problems, key=lambda problem: len(problem[0]))


def _described(title: str, details: Any) -> tuple[Place, HugwbcError]:  # noqa: ANN401
    place, context, value = details["loc"], details.get("ctx", {}), details["input"]
    if isinstance(cause := context.get("error"), _Refusal):
        return place + cause.args[0].at, cause.args[0]
    name = ".".join(str(part) for part in (title, *place) if "[" not in str(part))  # but types of a union
    if details["type"] == "missing":
        return place[:-1], ConfigError(f"{name} is missing; give it")
    if isinstance(value, str) and (valid := context.get("expected")):
        return place, UnknownNameError(name, value, re.findall(r"'([^']*)'", valid))
    reason = details["msg"]
    for theirs, ours in _WORDS:
        reason = re.sub(theirs, ours, reason)
    return place, ConfigError(f"{name} is {one_line(repr(value), 100)}; {reason}")


# Classes of seeds.
#
# A figure is only as honest as its seed. If many policies are tried on one seed and the best is kept, that seed's
# figures flatter it. So the seeds with which something is chosen are not those with which it is reported:
#
# - selection, 0 to 999: everything that is tried, tuned or chosen, and the evaluations inside a training. Seeds 3 and 4
#   belong here: they chose and reported before there were classes.
# - report, 1000 to 1999: published figures. Nothing is chosen by what they show.
# - training, 2000 to 2999: the random numbers of a training. Trainings before there were classes had seeds 1, 2 and 4.
# - own, from 3000 on: free.
SELECTION_SEEDS = range(1000)
REPORT_SEEDS = range(1000, 2000)
TRAINING_SEEDS = range(2000, 3000)

# The defaults. Tables were of seed 1000 up to 28 November 2026; changes that they led to were sometimes tried on it.
SELECTION_SEED, REPORT_SEED, TRAINING_SEED = SELECTION_SEEDS[0], 1100, TRAINING_SEEDS[0]

_SEED_CLASSES = {"selection": SELECTION_SEEDS, "report": REPORT_SEEDS, "training": TRAINING_SEEDS}


def seed_class(seed: int) -> str:
    """Return the class of a seed: "selection", "report", "training", or "own" for the free ones."""
    return next((name for name, seeds in _SEED_CLASSES.items() if seed in seeds), "own")


def check_seeds(first: int, count: int) -> None:
    """Refuse a run of seeds that begins in one class and ends in another."""
    last = first + count - 1
    if seed_class(first) != seed_class(last):
        raise ConfigError(
            f"seeds {first} to {last} go from class {seed_class(first)} into class {seed_class(last)}; give fewer "
            f"episodes, or a seed from {TRAINING_SEEDS.stop} on"
        )
