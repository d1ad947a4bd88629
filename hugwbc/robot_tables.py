"""Tables of robots: which there are, where their files lie, and what they say, completed and checked for their form."""

import contextlib
import copy
import functools
import pathlib
from collections.abc import Iterator, Mapping
from typing import Any

from hugwbc.errors import ConfigError, ModelError, UnknownNameError
from hugwbc.table_defaults import check_roles, complete, complete_drive, describe, other_side
from hugwbc.yaml_text import read_yaml

DEFAULT_ROBOT = "h1"


def models_dir() -> pathlib.Path:
    """Return the folder of the robots' folders: inside an installed package, or next to it in a source checkout.

    Raises:
        ModelError: if neither exists.
    """
    package = pathlib.Path(__file__).parent
    for candidate in (package / "models", package.parent / "models"):
        if (candidate / DEFAULT_ROBOT).is_dir():
            return candidate
    raise ModelError(f"models was found neither in {package} nor next to it; reinstall hugwbc with its models")


def robot_names() -> tuple[str, ...]:
    """Return the names of all robots in the folder of models, the default first."""
    return tuple(_tables())


def _tables() -> dict[str, pathlib.Path]:
    """Return the file that describes each robot: NAME/NAME.yaml has NAME, and others as lists of differences."""
    files = sorted(path for path in models_dir().glob("*/*.yaml") if path.stem == path.parent.name)
    files.sort(key=lambda path: path.stem != DEFAULT_ROBOT)
    return {name: path for path in files for name in (path.stem, *_read_table(path).get("robots", ()))}


def table_file(name: str) -> pathlib.Path:
    """Return the file that describes a robot, given its name, the file's own path, or that of its folder."""
    if name in (tables := _tables()):
        return tables[name]
    path = pathlib.Path(name)
    path = path / f"{path.resolve().name}.yaml" if path.is_dir() else path
    if path.suffix == ".yaml" and path.is_file():
        return path.resolve()
    raise UnknownNameError("robot", name, (*tables, "the path of a table, NAME/NAME.yaml"))


def robot_table(name: str = DEFAULT_ROBOT) -> dict[str, Any]:
    """Return the table of a robot (`load_robot`): with its description, its differences, its drives at their joints."""
    return copy.deepcopy(_robot_table(name))


@functools.cache
def _robot_table(name: str) -> dict[str, Any]:
    file = table_file(name)
    label = name if name in robot_names() else file.stem
    table = copy.deepcopy(_read_table(file))
    difference = table.pop("robots", {}).get(label, {})
    with reading(file):
        _check_forms(table)
        description = file.parent / table["description"] if "description" in table else None
        if description is not None:
            describe(table, description)
        _assign_drives(table)
        for joint in table["joints"]:
            joint.setdefault("policy_torque_limit", joint["effort"])
            joint.update({"armature": difference["armature"]} if "armature" in difference else {})
            joint.update(difference.get("joints", {}).get(joint["name"], {}))
        for link in table["links"]:
            link.update(difference.get("links", {}).get(link["name"], {}))
        check_roles(table)
        complete(table, description)
    return {**table, "name": label}


def _check_forms(table: Mapping[str, Any]) -> None:
    """Refuse sections of another form, which what reads them would take for something else."""
    named = ("roles", "nominal", "joints", "links") if "description" in table else ("roles",)
    for section in named:
        if not isinstance(part := table.get(section, {}), dict):
            raise ModelError(f"`{section}` is {part!r:.60}; give names and what they have, {section}: {{NAME: ...}}")
    for drive in table.get("drives", []):
        if not isinstance(drive, dict) or not isinstance(drive.get("joints"), list):
            raise ModelError(f"drives has {drive!r:.60}; give each its joints, {{joints: [NAME, ...], armature: ...}}")


@functools.cache
def _read_table(path: pathlib.Path) -> dict[str, Any]:
    try:
        _, table = read_yaml(path.read_text(encoding="utf-8"), path)
    except (OSError, UnicodeDecodeError) as error:
        raise ModelError(f"cannot read {path}: {error}; give a table in UTF-8") from error
    except ConfigError as error:
        raise ModelError(str(error)) from error
    if not isinstance(table, dict):
        raise ModelError(f"{path} is no table of a robot; docs/how-to/add-a-robot.md shows one")
    return table


@contextlib.contextmanager
def reading(file: pathlib.Path) -> Iterator[None]:
    """Say of a table that is being read that a field is missing or of another form."""
    try:
        yield
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        what = f"lacks the field {error}" if isinstance(error, KeyError) else f"has a field of another form ({error})"
        raise ModelError(f"{file} {what}; models/{DEFAULT_ROBOT}/{DEFAULT_ROBOT}.yaml shows all fields") from error


def _assign_drives(table: dict[str, Any]) -> None:
    """Copy the figures of the drives to their joints."""
    named = [part for drive in table["drives"] for part in drive["joints"]]
    names = [joint["name"] for joint in table["joints"]]
    for part in named:
        if part not in names:
            raise UnknownNameError("joint under drives", part, names)
        if named.count(part) > 1:
            raise ModelError(f"drives has {part} {named.count(part)} times; give each joint once")
    drives = {part: drive for drive in table["drives"] for part in drive["joints"]}
    for joint in table["joints"]:
        drive = drives.get(joint["name"]) or drives.get(other_side(joint["name"]), {})
        joint.update({key: value for key, value in drive.items() if key != "joints"})
        complete_drive(joint)
