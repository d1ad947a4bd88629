"""Settings by dotted name: the fields of nested dataclasses, such as "env.command.walking_fraction"."""

import dataclasses
import difflib
import pathlib
import types
import typing
from collections.abc import Iterable, Mapping
from typing import Any

import yaml

from hugwbc.errors import UnknownNameError
from hugwbc.learned.config.schedules import replaced
from hugwbc.yaml_file import YamlReader

NONE = ("none", "null", "~")


def setting_types(settings: type[Any], prefix: str = "") -> dict[str, Any]:
    """Return the type of each setting of a dataclass by its dotted name; groups of settings are left out."""
    hints = typing.get_type_hints(settings)
    found: dict[str, Any] = {}
    for field in dataclasses.fields(settings):
        kind = hints[field.name]
        if dataclasses.is_dataclass(kind) and isinstance(kind, type):
            found |= setting_types(kind, f"{prefix}{field.name}.")
        else:
            found[f"{prefix}{field.name}"] = kind
    return found


def flat(settings: Any, prefix: str = "") -> dict[str, Any]:  # noqa: ANN401  any dataclass
    """Return the settings of a dataclass by their dotted names."""
    found: dict[str, Any] = {}
    for field in dataclasses.fields(settings):
        value = getattr(settings, field.name)
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            found |= flat(value, f"{prefix}{field.name}.")
        else:
            found[f"{prefix}{field.name}"] = value
    return found


def unknown_setting(name: str, known: Iterable[str]) -> UnknownNameError:
    """Return the error for a setting that does not exist; of the many that do, it lists those of the same group.

    Args:
        name: the name that was asked for.
        known: names of all settings.
    """
    known = list(known)
    near = difflib.get_close_matches(name, known, n=5, cutoff=0.7)
    group = name.rpartition(".")[0]
    while group and not any(one.startswith(f"{group}.") for one in known):
        group = group.rpartition(".")[0]
    here = [one for one in known if one.rpartition(".")[0] == group]
    others = dict.fromkeys(f"{one.rpartition('.')[0]}.*" for one in known if one.rpartition(".")[0] not in ("", group))
    return UnknownNameError("setting", name, dict.fromkeys([*near, *here, *others]))


def with_settings(settings: Any, values: Mapping[str, Any]) -> Any:  # noqa: ANN401  any dataclass
    """Return settings with other values; `replaced`, for names that somebody wrote.

    Args:
        settings: a frozen dataclass, which may hold others.
        values: new values by dotted name.

    Raises:
        UnknownNameError: if a setting does not exist.
        ConfigError: if a value is out of its range.
    """
    known = setting_types(type(settings))
    for name in values:
        if name not in known:
            raise unknown_setting(name, known)
    return replaced(settings, values)


def read_value(reader: YamlReader, node: yaml.Node, kind: Any) -> Any:  # noqa: ANN401  a type, and a value of it
    """Return the value of a YAML node for a setting of some type.

    Args:
        reader: reads the node; its errors name the line.
        node: the node.
        kind: type of the setting: a number, a truth value, text, a literal, a path, or a tuple of such.
    """
    origin, parts = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        if type(None) in parts and isinstance(node, yaml.ScalarNode) and node.value.lower() in NONE:
            return None
        inner = [part for part in parts if part is not type(None)]
        return read_value(reader, node, inner[0])
    if origin is typing.Literal:
        text = reader.text(node)
        if text not in parts:
            reader.fail(node, UnknownNameError("value", text, [str(part) for part in parts]))
        return text
    if origin is tuple:
        return _read_tuple(reader, node, parts)
    if kind is bool:
        return reader.truth(node)
    if kind is int:
        return reader.integer(node)
    if kind is float:
        return reader.number(node)
    if kind is pathlib.Path:
        return pathlib.Path(reader.text(node))
    if kind is str:
        return reader.text(node)
    reader.fail(node, f"settings of type {kind} cannot be given in a recipe")


def _read_tuple(reader: YamlReader, node: yaml.Node, parts: tuple[Any, ...]) -> tuple[Any, ...]:
    entries = node.value if isinstance(node, yaml.SequenceNode) else reader.nodes(node)
    if len(parts) == 2 and parts[1] is Ellipsis:
        return tuple(read_value(reader, entry, parts[0]) for entry in entries)
    if len(entries) != len(parts):
        reader.fail(node, f"expected a list of {len(parts)} values, found {len(entries)}")
    return tuple(read_value(reader, entry, part) for entry, part in zip(entries, parts, strict=True))
