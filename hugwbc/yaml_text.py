"""What YAML text holds, read without surprises: what looks like a number is one, and all else is text.

So `yes` may be a name, and `1e-5` is a number. Nothing is executed, and no name is given twice.
"""

import math
import pathlib
import re
import unicodedata
from collections.abc import Iterator
from typing import Any

import yaml

from hugwbc.errors import ConfigError, one_line

MOST_PARTS, DEEPEST = 20_000, 50  # values in a text, those that anchors repeat included, and levels of them
_KINDS = ("str", "int", "float", "bool", "null", "map", "seq", "timestamp", "value", "merge")
# In a power of ten, YAML 1.1 wants a point and a sign, and takes others for text.
_POWER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+")
_TAGS = {f"tag:yaml.org,2002:{kind}" for kind in _KINDS}  # other tags would be ignored


def read_yaml(text: str, path: pathlib.Path) -> tuple[yaml.Node, Any]:
    """Return the nodes of a text, which know their lines, and what they hold; without any, an empty mapping.

    Raises:
        ConfigError: if it is no YAML, with the path, line and column.
    """
    mark = yaml.Mark(str(path), 0, 0, 0, None, 0)
    try:
        levels = 0
        for event in yaml.parse(text, Loader=yaml.CSafeLoader):  # without this check, many levels crash the composer
            levels += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            _check_size(event, levels <= DEEPEST)
        root = yaml.compose(text, Loader=yaml.CSafeLoader) or yaml.MappingNode("tag:yaml.org,2002:map", [], mark)
        return root, _content(root, iter(range(MOST_PARTS)), DEEPEST)
    except yaml.MarkedYAMLError as error:
        mark, problem = error.problem_mark or error.context_mark or mark, error.problem
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        problem = str(error)
    raise ConfigError(f"{path}:{mark.line + 1}:{mark.column + 1}: not valid YAML: {one_line(str(problem))}")


def _check_size(part: yaml.Node | yaml.Event, small: bool) -> None:
    if not small:
        problem = f"more than {MOST_PARTS} values, or more than {DEEPEST} levels of them"
        raise yaml.MarkedYAMLError(problem=problem, problem_mark=part.start_mark)


def _content(node: yaml.Node, parts: Iterator[int], levels: int) -> Any:  # noqa: ANN401
    """Return what a node holds: numbers, text, lists and mappings."""
    _check_size(node, next(parts, None) is not None and levels > 0)
    if node.tag not in _TAGS:
        raise yaml.MarkedYAMLError(problem=f"the tag {node.tag} is not allowed", problem_mark=node.start_mark)
    if isinstance(node, yaml.SequenceNode):
        return [_content(entry, parts, levels - 1) for entry in node.value]
    if isinstance(node, yaml.MappingNode):
        content: dict[str, Any] = {}
        for key, value in node.value:
            if not isinstance(key, yaml.ScalarNode) or key.value in content:
                problem = f"{key.value} is given twice" if isinstance(key, yaml.ScalarNode) else "a name is no text"
                raise yaml.MarkedYAMLError(problem=problem, problem_mark=key.start_mark)
            content[key.value] = _content(value, parts, levels - 1)
        return content
    if any(unicodedata.category(letter) in ("Cc", "Cs") and letter not in "\n\t" for letter in node.value):
        raise yaml.MarkedYAMLError(problem="control characters in a text", problem_mark=node.start_mark)
    if not node.style and _POWER.fullmatch(node.value) and math.isfinite(float(node.value)):  # it is not quoted
        return float(node.value)
    for kind, read in (("null", lambda _: None), ("int", int), ("float", float)):
        if node.tag.endswith(kind):
            try:
                return read(node.value)
            except ValueError:  # YAML's own forms, such as 1:30
                break
    return node.value
