"""Settings from YAML files, checked by their model; every error names file, line and column.

The types `bool` and `Path` understand text; `Any` gets numbers, text, lists, mappings and None.
"""

import pathlib
from typing import TypeVar

import yaml
from pydantic import TypeAdapter, ValidationError

from hugwbc.errors import ConfigError, UnknownNameError, one_line
from hugwbc.files import read_file
from hugwbc.settings import Place, deepest
from hugwbc.yaml_text import read_yaml

LARGEST_FILE = 1_000_000  # [byte]
_T = TypeVar("_T")


def shipped_names(folder: pathlib.Path) -> tuple[str, ...]:
    """Return the names of the YAML files in a folder of the package, sorted."""
    return tuple(sorted(path.stem for path in folder.glob("*.yaml")))


def named_path(kind: str, name: str | pathlib.Path, *folders: pathlib.Path) -> pathlib.Path:
    """Return the path of the file in some folders that a name means, or a path that ends in .yaml or .yml as it is."""
    path = pathlib.Path(name)
    if path.suffix in (".yaml", ".yml"):
        return path
    paths = {each: folder / f"{each}.yaml" for folder in folders for each in shipped_names(folder)}
    if str(name) not in paths:
        raise UnknownNameError(kind, name, (*paths, "or a file that ends in .yaml"))
    return paths[str(name)]


def read_text(path: pathlib.Path) -> str:
    """Return the text of a YAML file; the error of one that cannot be read says why."""
    try:
        return read_file(path, LARGEST_FILE).decode("utf-8-sig")
    except (OSError, ValueError) as error:  # ValueError: not UTF-8, or a path that no file can have
        raise ConfigError(
            f"cannot read {one_line(str(path))}: {getattr(error, 'strerror', error)}; give a YAML file in UTF-8"
        ) from error


def load(model: type[_T], path: pathlib.Path, robot: object = None, **more: object) -> _T:
    """Read a model from a YAML file; errors name file, line and column, what is wrong and what is valid.

    Args:
        model: a class of settings, or any other type that pydantic can check.
        path: path of the file.
        robot: the `Robot` that the file is for, if it says something that depends on it.
        more: fields that the file does not give, such as its name.
    """
    return parse(model, read_text(path), path, robot, **more)


def parse(model: type[_T], text: str, path: pathlib.Path, robot: object = None, **more: object) -> _T:
    """Read a model from YAML text; as `load`, whose path stands in the messages and is the base of relative paths."""
    root, content = read_yaml(text, path)
    content = {**content, **more} if isinstance(content, dict) else content
    try:
        return TypeAdapter(model).validate_python(content, context={"folder": path.parent, "robot": robot})
    except ValidationError as error:
        place, problem = deepest(error)
    mark = _mark(root, place)
    raise ConfigError(f"{path}:{mark.line + 1}:{mark.column + 1}: {one_line(str(problem))}")


def _mark(node: yaml.Node, place: Place) -> yaml.Mark:
    """Return where the innermost part of a place stands that is in the file; the rest are names of types."""
    mark = node.start_mark
    for step in place:
        if isinstance(node, yaml.SequenceNode) and isinstance(step, int):
            node = node.value[step]
            mark = node.start_mark
        elif isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                if key.value == step:
                    mark, node = key.start_mark, value
    return mark
