"""YAML files read node by node, so that every error names the line that is wrong."""

import pathlib
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Any, NoReturn

import yaml

from hugwbc.errors import HugwbcError, UnknownNameError

LARGEST_FILE = 1_000_000  # [byte]
Read = Callable[[Any, yaml.Node], Any]  # (reader, node) -> value


def shipped_names(folder: pathlib.Path) -> tuple[str, ...]:
    """Return the names of the YAML files in a folder of the package, sorted."""
    return tuple(sorted(path.stem for path in folder.glob("*.yaml")))


def yaml_path(kind: str, name: str | pathlib.Path, folder: pathlib.Path) -> pathlib.Path:
    """Return the path of a shipped file by name, or a path that ends in .yaml or .yml as it is.

    Args:
        kind: what the file is, for the message.
        name: name of a shipped file, or path of any other.
        folder: where the shipped files are.

    Raises:
        UnknownNameError: if no shipped file has that name.
    """
    path = pathlib.Path(name)
    if path.suffix in (".yaml", ".yml"):
        return path
    names = shipped_names(folder)
    if str(name) not in names:
        raise UnknownNameError(kind, name, (*names, "or a file that ends in .yaml"))
    return folder / f"{name}.yaml"


class YamlReader:
    """A reader that turns YAML nodes into values; every error names the node's line and column.

    Attributes:
        path: path of the file, for the messages.
        error: class of the errors that are raised.
    """

    def __init__(self, path: pathlib.Path, error: type[HugwbcError]) -> None:
        self.path = path
        self.error = error

    def load(self, kind: str, hint: str) -> yaml.Node:
        """Read the file and return its root node.

        Args:
            kind: what the file is, for the messages.
            hint: what an empty or far too long file should hold instead.

        Raises:
            HugwbcError: of class `error`, if the file cannot be read, is too long, is empty or is not YAML.
        """
        try:
            if self.path.stat().st_size > LARGEST_FILE:
                raise self.error(f"{self.path} has more than {LARGEST_FILE} bytes; {hint}")
            text = self.path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise self.error(f"cannot read the {kind} {self.path}: {error}; give a text file that is there") from error
        return self.compose(text, hint)

    def compose(self, text: str, hint: str) -> yaml.Node:
        """Return the root node of a YAML text; errors as for `load`."""
        try:
            root = yaml.compose(text, Loader=yaml.SafeLoader)
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            place = f":{mark.line + 1}:{mark.column + 1}" if mark else ""
            raise self.error(f"{self.path}{place}: not valid YAML: {error.problem}") from error
        except (yaml.YAMLError, RecursionError) as error:
            raise self.error(f"{self.path}: not valid YAML: {error}") from error
        if root is None:
            raise self.error(f"{self.path}:1: the file is empty; {hint}")
        return root

    def fail(self, node: yaml.Node, message: object) -> NoReturn:
        """Raise an error with the place of a node."""
        mark = node.start_mark
        raise self.error(f"{self.path}:{mark.line + 1}:{mark.column + 1}: {message}")

    def fields(
        self, node: yaml.Node, kind: str, readers: Mapping[str, Read], required: Iterable[str] = ()
    ) -> dict[str, Any]:
        """Return the values of a mapping, each read by the function for its key.

        Args:
            node: the mapping.
            kind: what the mapping describes, for the messages.
            readers: a function for each allowed key.
            required: keys that must be there.
        """
        if not isinstance(node, yaml.MappingNode):
            self.fail(node, f"expected a {kind} with fields: {', '.join(readers)}")
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
        """Return `make(*values, **fields)`, and raise its errors with the place of the node."""
        try:
            return make(*values, **fields)
        except HugwbcError as error:
            self.fail(node, error)

    def text(self, node: yaml.Node) -> str:
        """Return a node's text."""
        if not isinstance(node, yaml.ScalarNode):
            self.fail(node, "expected text")
        return node.value

    def one_of(self, node: yaml.Node, what: str, valid: Collection[str]) -> str:
        """Return a node's text, which must be one of the valid names of what it names."""
        name = self.text(node)
        if name not in valid:
            self.fail(node, UnknownNameError(what, name, valid))
        return name

    def number(self, node: yaml.Node) -> float:
        """Return a node's number."""
        try:
            return float(self.text(node))
        except ValueError:
            self.fail(node, f"'{self.text(node)}' is not a number")

    def integer(self, node: yaml.Node) -> int:
        """Return a node's whole number."""
        value = self.number(node)
        if value != value // 1:
            self.fail(node, f"{value:g} is not a whole number")
        return int(value)

    def truth(self, node: yaml.Node) -> bool:
        """Return a node's truth value."""
        text = self.text(node)
        if text not in ("true", "false"):
            self.fail(node, f"'{text}' is neither true nor false")
        return text == "true"

    def nodes(self, node: yaml.Node) -> list[yaml.Node]:
        """Return the entries of a list with at least one entry."""
        if not isinstance(node, yaml.SequenceNode) or not node.value:
            self.fail(node, "expected a list with at least one entry")
        return node.value
