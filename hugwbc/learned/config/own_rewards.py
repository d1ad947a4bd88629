"""Reward terms that other packages register, as weights of the training: names only, nothing is loaded here.

A term is an entry point in the group `hugwbc.rewards`, or in `hugwbc.penalties` if the curriculum of penalties is to
scale it. Its name becomes an option of `hugwbc train` and a setting of recipes; its weight is 0 until one is given.
"""

import dataclasses
import functools
from importlib.metadata import EntryPoint
from typing import Annotated, TypeVar

import tyro

from hugwbc import extensions
from hugwbc.errors import ConfigError

REWARDS, PENALTIES = "hugwbc.rewards", "hugwbc.penalties"
Weights = TypeVar("Weights")


@functools.cache
def registered_rewards() -> dict[str, EntryPoint]:
    """Return the registered terms of both groups by name.

    Raises:
        ConfigError: if a name stands for two terms, or is no name of an option.
    """
    rewards, penalties = (extensions.registered(group, "reward") for group in (REWARDS, PENALTIES))
    for name, entry in (rewards | penalties).items():
        if name in rewards and name in penalties:
            raise ConfigError(f"reward '{name}' is registered in {REWARDS} and in {PENALTIES}; keep one of the entries")
        if not name.isidentifier():
            raise ConfigError(
                f"reward '{name}' ({entry.value}) is no name of an option; use letters, digits and underscores"
            )
    return rewards | penalties


def with_registered(weights: type[Weights], taken: tuple[str, ...] = ()) -> type[Weights]:
    """Return a dataclass of weights with one more for each registered term; the class itself if there is none.

    Args:
        weights: the class.
        taken: names of terms that are not among its fields.

    Raises:
        ConfigError: if a package registers a term under the name of one of ours.
    """
    terms = registered_rewards()
    if not terms:
        return weights
    assert dataclasses.is_dataclass(weights)
    ours = {field.name for field in dataclasses.fields(weights)} | set(taken)
    for name, entry in terms.items():
        if name in ours:
            raise ConfigError(
                f"reward '{name}' ({entry.value}) has the name of a term of hugwbc; register another name"
            )
    fields = [
        (name, Annotated[float, tyro.conf.arg(help=f"Term of another package: {entry.value}; off by default.")], 0.0)
        for name, entry in terms.items()
    ]
    return dataclasses.make_dataclass(
        weights.__name__,
        fields,
        bases=(weights,),
        frozen=True,
        namespace={"__doc__": weights.__doc__, "__module__": weights.__module__},
    )
