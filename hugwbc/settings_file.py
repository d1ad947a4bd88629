"""Settings from YAML files, checked by their model; every error names file, line and column.

What looks like a number is one; all else is text until a type asks for something different, so that `yes` may be a
name. The types `bool` and `Path` understand text; `Any` gets numbers, text, lists, mappings and None.
"""

import pathlib
import unicodedata
from collections.abc import Iterator
from typing import Any, TypeVar

import yaml
from pydantic import TypeAdapter, ValidationError

from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.files import read_file
from hugwbc.robot import Robot
from hugwbc.settings import Place, deepest, one_line

LARGEST_FILE = 1_000_000  # [byte]
MOST_PARTS, DEEPEST = 20_000, 50  # values in a file, those that anchors repeat included, and levels of them
_KINDS = ("str", "int", "float", "bool", "null", "map", "seq", "timestamp", "value", "merge")
_TAGS = {f"tag:yaml.org,2002:{kind}" for kind in _KINDS}  # others would be read as if they were not there
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


def load(model: type[_T], path: pathlib.Path, robot: Robot | None = None, **more: object) -> _T:
    """Read a model from a YAML file; errors name file, line and column, what is wrong and what is valid.

    Args:
        model: a class of settings, or any other type that pydantic can check.
        path: path of the file.
        robot: the robot that the file is for, if it says something that depends on it.
        more: fields that the file does not give, such as its name.
    """
    try:
        text = read_file(path, LARGEST_FILE).decode("utf-8-sig")
    except (OSError, ValueError) as error:  # ValueError: not UTF-8, or a path that no file can have
        raise ConfigError(f"cannot read {one_line(str(path))}: {error}; give a YAML file in UTF-8") from error
    return parse(model, text, path, robot, **more)


def parse(model: type[_T], text: str, path: pathlib.Path, robot: Robot | None = None, **more: object) -> _T:
    """Read a model from YAML text; as `load`, whose path stands in the messages and is the base of relative paths."""
    mark = yaml.Mark(str(path), 0, 0, 0, None, 0)
    root = yaml.MappingNode("tag:yaml.org,2002:map", [], mark)
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader) or root
        content = _content(root, iter(range(MOST_PARTS)), DEEPEST)
        content = {**content, **more} if isinstance(content, dict) else content
        return TypeAdapter(model).validate_python(content, context={"folder": path.parent, "robot": robot})
    except ValidationError as error:
        place, problem = deepest(error)
        mark = _mark(root, place)
    except yaml.MarkedYAMLError as error:
        mark, problem = error.problem_mark or error.context_mark or mark, f"not valid YAML: {error.problem}"
    except RecursionError:
        problem = "not valid YAML: parts are nested too deeply"
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        problem = f"not valid YAML: {error}"
    raise ConfigError(f"{path}:{mark.line + 1}:{mark.column + 1}: {one_line(str(problem))}")


def _content(node: yaml.Node, parts: Iterator[int], levels: int) -> Any:  # noqa: ANN401
    """Return what a node holds: numbers, text, lists and mappings."""
    if next(parts, None) is None or levels == 0:
        problem = f"more than {MOST_PARTS} values, or more than {DEEPEST} levels of them"
        raise yaml.MarkedYAMLError(problem=problem, problem_mark=node.start_mark)
    if node.tag not in _TAGS:
        raise yaml.MarkedYAMLError(problem=f"the tag {node.tag} is not allowed", problem_mark=node.start_mark)
    if isinstance(node, yaml.SequenceNode):
        return [_content(entry, parts, levels - 1) for entry in node.value]
    if isinstance(node, yaml.MappingNode):
        content: dict[str, Any] = {}
        for key, value in node.value:
            if not isinstance(key, yaml.ScalarNode) or key.value in content:
                problem = "a name is given twice, or is no text"
                raise yaml.MarkedYAMLError(problem=problem, problem_mark=key.start_mark)
            content[key.value] = _content(value, parts, levels - 1)
        return content
    if any(unicodedata.category(letter) in ("Cc", "Cs") and letter not in "\n\t" for letter in node.value):
        raise yaml.MarkedYAMLError(problem="control characters in a text", problem_mark=node.start_mark)
    for kind, read in (("null", lambda _: None), ("int", int), ("float", float)):
        if node.tag.endswith(kind):
            try:
                return read(node.value)
            except ValueError:  # YAML's own forms, such as 1:30
                break
    return node.value


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
