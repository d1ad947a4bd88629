"""What other packages register for the training, as settings: names only, nothing is loaded here.

A reward term is an entry point in the group `hugwbc.rewards`, or in `hugwbc.penalties` if the curriculum of penalties
is to scale it; a randomisation is one in `hugwbc.randomizations`, a curriculum one in `hugwbc.curricula`. Its name
becomes an option of `hugwbc train` and a setting of recipes: the weight of the term, the width of the randomisation, or
the highest level of the curriculum, 0 until one is given.
"""

import dataclasses
import functools
from collections.abc import Collection, Mapping
from importlib.metadata import EntryPoint
from typing import Annotated, TypeVar

import tyro

from hugwbc import extensions
from hugwbc.errors import ConfigError
from hugwbc.settings import settings as checked

REWARDS, PENALTIES, RANDOMIZATIONS = "hugwbc.rewards", "hugwbc.penalties", "hugwbc.randomizations"
CURRICULA = "hugwbc.curricula"
Settings = TypeVar("Settings")


@functools.cache
def registered_rewards() -> dict[str, EntryPoint]:
    """Return the registered terms of both groups by name.

    Raises:
        ConfigError: if a name stands for two terms, or is no name of an option.
    """
    rewards, penalties = (_registered(group, "reward") for group in (REWARDS, PENALTIES))
    for name in rewards.keys() & penalties.keys():
        raise ConfigError(f"reward '{name}' is registered in {REWARDS} and in {PENALTIES}; keep one of the entries")
    return rewards | penalties


@functools.cache
def registered_randomizations() -> dict[str, EntryPoint]:
    """Return the registered randomisations by name.

    Raises:
        ConfigError: if a name is no name of an option.
    """
    return _registered(RANDOMIZATIONS, "randomization")


@functools.cache
def registered_curricula() -> dict[str, EntryPoint]:
    """Return the registered curricula by name.

    Raises:
        ConfigError: if a name is no name of an option.
    """
    return _registered(CURRICULA, "curriculum")


def _registered(group: str, kind: str) -> dict[str, EntryPoint]:
    entries = extensions.registered(group, kind)
    for name, entry in entries.items():
        if not name.isidentifier():
            raise ConfigError(
                f"{kind} '{name}' ({entry.value}) is no name of an option; use letters, digits and underscores"
            )
    return entries


def with_registered(
    settings: type[Settings], entries: Mapping[str, EntryPoint], kind: str, taken: Collection[str] = ()
) -> type[Settings]:
    """Return a dataclass of settings with one more number for each entry; the class itself if there is none.

    Args:
        settings: the class.
        entries: what other packages registered, by name.
        kind: what they are, in words, for messages.
        taken: names of ours that are not among the fields of the class.

    Raises:
        ConfigError: if a package registers something under the name of one of ours.
    """
    if not entries:
        return settings
    assert dataclasses.is_dataclass(settings)
    ours = {field.name for field in dataclasses.fields(settings)} | set(taken)
    for name, entry in entries.items():
        if name in ours:
            raise ConfigError(
                f"{kind} '{name}' ({entry.value}) has the name of a {kind} of hugwbc; register another name"
            )
    fields = [
        (name, Annotated[float, tyro.conf.arg(help=f"Of another package: {entry.value}; off by default.")], 0.0)
        for name, entry in entries.items()
    ]
    namespace = {"__doc__": settings.__doc__, "__module__": settings.__module__} | {name: 0.0 for name, _, _ in fields}
    namespace["__annotations__"] = {name: kind for name, kind, _ in fields}
    return checked(type(settings.__name__, (settings,), namespace))  # type: ignore[return-value]
