"""Tables of robots: which there are, where their files lie, and what they say, completed."""

import copy
import dataclasses
import functools
import pathlib
from collections.abc import Mapping
from typing import Any

from hugwbc.errors import ConfigError, ModelError, UnknownNameError
from hugwbc.settings_file import load
from hugwbc.table_defaults import check_roles, complete, complete_drive, describe, other_side

DEFAULT_ROBOT = "h1"
SHIPPED = ("h1", "g1")  # folders of the tables that come along, with the files that are written from them


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
    """Return the file of each robot: NAME/NAME.yaml has NAME, and others by their differences, under `robots`."""
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
    """Return the table of a robot (`load_robot`), completed: description, differences and drives are applied."""
    return copy.deepcopy(_robot_table(name))


@functools.cache
def _robot_table(name: str) -> dict[str, Any]:
    file = table_file(name)
    label = name if name in robot_names() else file.stem
    table = copy.deepcopy(_read_table(file))
    difference = table.pop("robots", {}).get(label, {})
    description = file.parent / table["description"] if "description" in table else None
    if description is None:
        check_roles(table)
    else:
        describe(table, description)
    _assign_drives(table, {} if description is None else _read_table(file).get("joints", {}))
    for joint in table["joints"]:
        joint |= {"armature": difference["armature"]} if "armature" in difference else {}
    for kind in ("joints", "links"):
        rows = {row["name"]: row for row in table[kind]}
        for part, change in difference.get(kind, {}).items():
            rows[part] |= change
    complete(table, description)
    return {**table, "name": label}


@functools.cache
def _read_table(path: pathlib.Path) -> dict[str, Any]:
    """Return what a file says, without the fields that it leaves out."""
    from hugwbc.table_form import Table  # whose models take as long to build as a robot to load

    try:
        table = load(Table, path)
    except ConfigError as error:
        raise ModelError(f"{error} (docs/how-to/add-a-robot.md shows a table)") from error
    return dataclasses.asdict(table, dict_factory=lambda fields: {key: one for key, one in fields if one is not None})


def _assign_drives(table: dict[str, Any], corrected: Mapping[str, Any]) -> None:
    """Copy the figures of the drives to their joints, except those that `joints` gives for a joint or its partner."""
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
        own = {*corrected.get(joint["name"], {}), *corrected.get(other_side(joint["name"]), {}), "joints"}
        joint.update({key: value for key, value in drive.items() if key not in own})
        if lacking := [figure for figure in ("effort", "velocity") if figure not in joint]:
            raise ModelError(f"{joint['name']} lacks {' and '.join(lacking)}; give them under `drives` or `joints`")
        complete_drive(joint)
        joint.setdefault("policy_torque_limit", joint["effort"])
