"""YAML files read without surprises: by the composed nodes, so that every complaint names the line that is wrong."""

import pathlib
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NoReturn

import yaml

from hugwbc.errors import HugwbcError, UnknownNameError

LARGEST_FILE = 1_000_000  # [byte]
Read = Callable[[Any, yaml.Node], Any]  # of a reader, the value of a node


class YamlReader:
    """Turns YAML nodes into values; every complaint names the node's line and column.

    Attributes:
        path: of the file, for the messages.
        error: what is raised.
    """

    def __init__(self, path: pathlib.Path, error: type[HugwbcError]) -> None:
        self.path = path
        self.error = error

    def load(self, kind: str, hint: str) -> yaml.Node:
        """The root node of the file.

        Args:
            kind: what the file is, for the messages.
            hint: what an empty or far too long file should hold instead.

        Raises:
            HugwbcError: of the reader's class, if the file cannot be read, is too long, empty or no YAML.
        """
        try:
            if self.path.stat().st_size > LARGEST_FILE:
                raise self.error(f"{self.path} has more than {LARGEST_FILE} bytes; {hint}")
            text = self.path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise self.error(f"cannot read the {kind} {self.path}: {error}; give a text file that is there") from error
        return self.compose(text, hint)

    def compose(self, text: str, hint: str) -> yaml.Node:
        """The root node of a YAML text; see `load`."""
        try:
            root = yaml.compose(text, Loader=yaml.SafeLoader)
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            place = f":{mark.line + 1}:{mark.column + 1}" if mark else ""
            raise self.error(f"{self.path}{place}: no YAML: {error.problem}") from error
        except (yaml.YAMLError, RecursionError) as error:
            raise self.error(f"{self.path}: no YAML: {error}") from error
        if root is None:
            raise self.error(f"{self.path}:1: the file is empty; {hint}")
        return root

    def fail(self, node: yaml.Node, message: object) -> NoReturn:
        """Complain about a node."""
        mark = node.start_mark
        raise self.error(f"{self.path}:{mark.line + 1}:{mark.column + 1}: {message}")

    def fields(
        self, node: yaml.Node, kind: str, readers: Mapping[str, Read], required: Iterable[str] = ()
    ) -> dict[str, Any]:
        """The values of a mapping, each read by the reader of its key."""
        if not isinstance(node, yaml.MappingNode):
            self.fail(node, f"here should be a {kind} with fields: {', '.join(readers)}")
        values: dict[str, Any] = {}
        for key, value in node.value:
            name = key.value if isinstance(key, yaml.ScalarNode) else ""
            if name not in readers:
                self.fail(key, UnknownNameError(f"{kind} field" if kind != "command" else kind, name, readers))
            if name in values:
                self.fail(key, f"{kind} field '{name}' is given twice; keep one")
            values[name] = readers[name](self, value)
        for name in required:
            if name not in values:
                self.fail(node, f"{kind} field '{name}' is missing; every {kind} needs {', '.join(required)}")
        return values

    def checked(self, node: yaml.Node, make: Callable, *values: object, **fields: object) -> Any:  # noqa: ANN401
        """What `make` returns, its complaints with the node's line."""
        try:
            return make(*values, **fields)
        except HugwbcError as error:
            self.fail(node, error)

    def text(self, node: yaml.Node) -> str:
        """A text."""
        if not isinstance(node, yaml.ScalarNode):
            self.fail(node, "here should be a text")
        return node.value

    def number(self, node: yaml.Node) -> float:
        """A number."""
        try:
            return float(self.text(node))
        except ValueError:
            self.fail(node, f"'{self.text(node)}' is no number")

    def integer(self, node: yaml.Node) -> int:
        """A whole number."""
        value = self.number(node)
        if value != value // 1:
            self.fail(node, f"{value:g} is no whole number")
        return int(value)

    def truth(self, node: yaml.Node) -> bool:
        """True or false."""
        text = self.text(node)
        if text not in ("true", "false"):
            self.fail(node, f"'{text}' is neither true nor false")
        return text == "true"

    def nodes(self, node: yaml.Node) -> list[yaml.Node]:
        """The entries of a list, at least one."""
        if not isinstance(node, yaml.SequenceNode) or not node.value:
            self.fail(node, "here should be a list with at least one entry")
        return node.value
