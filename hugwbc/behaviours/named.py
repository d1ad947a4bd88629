"""Behaviours by name: shipped ones, and those in the user's Python files."""

import pathlib
from typing import Any

from hugwbc import extensions
from hugwbc.behaviours.course import Behaviour
from hugwbc.behaviours.fetch_cup import fetch_cup
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.robot import Robot
from hugwbc.scripts.script import SCRIPT_NAMES, Script, load_script

_SHIPPED: dict[str, Behaviour] = {"fetch_cup": fetch_cup}
BEHAVIOUR_NAMES = tuple(_SHIPPED)


def load_behaviour(name: str) -> Behaviour:
    """Return a shipped behaviour, one of `BEHAVIOUR_NAMES`, or `FILE.py:NAME`, a function of a file that is run."""
    if not extensions.names_object(name):
        if name not in _SHIPPED:
            raise UnknownNameError("behaviour", name, (*_SHIPPED, "or FILE.py:NAME"))
        return _SHIPPED[name]
    found: Any = extensions.load_object(name, "behaviour")
    if callable(found):
        return found  # type: ignore[no-any-return]
    raise ConfigError(f"{name} is a {type(found).__name__}; give a function that takes a view and yields actions")


def load_plan(name: str | pathlib.Path, robot: Robot) -> Script | Behaviour:
    """Return a timed script for a robot, by name or a file that ends in .yaml, or a behaviour as `load_behaviour`."""
    if str(name) in BEHAVIOUR_NAMES or extensions.names_object(str(name)):
        return load_behaviour(str(name))
    if str(name) not in SCRIPT_NAMES and pathlib.Path(name).suffix not in (".yaml", ".yml"):
        choice = (*SCRIPT_NAMES, *BEHAVIOUR_NAMES, "a file that ends in .yaml", "or FILE.py:NAME")
        raise UnknownNameError("script", name, choice)
    return load_script(name, robot)
