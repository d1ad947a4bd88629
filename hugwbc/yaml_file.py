"""YAML files read node by node, so that every error names the line that is wrong."""

import math
import pathlib
import re
import unicodedata
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Any, NoReturn

import yaml

from hugwbc.errors import HugwbcError, UnknownNameError

LARGEST_FILE = 1_000_000  # [byte]
LONGEST_MESSAGE = 1000  # [character]
# What a plain YAML file consists of. Other tags (`!kg`, `!!python/object`) would be read as if they were not there.
_PLAIN = frozenset(
    f"tag:yaml.org,2002:{name}"
    for name in ("str", "int", "float", "bool", "null", "map", "seq", "timestamp", "value", "merge")
)
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
        """
        try:
            if self.path.exists() and not self.path.is_file():
                raise self.error(f"{self.path} is no file; {hint}")  # reading from a pipe would wait for ever
            if self.path.stat().st_size > LARGEST_FILE:
                self._refuse(0, 0, f"the file has more than {LARGEST_FILE} bytes; {hint}")
            content = self.path.read_bytes()
        except (OSError, ValueError) as error:  # ValueError: a path that no file can have
            raise self.error(f"cannot read the {kind} {self.path}: {error}; give a text file that is there") from error
        try:
            text = content.decode("utf-8")
        except UnicodeDecodeError as error:
            before = content[: error.start].decode("utf-8")
            self._refuse(*_end_of(before), f"{error.reason}: not a text in UTF-8; {hint}")
        return self.compose(text.removeprefix("\ufeff"), hint)

    def compose(self, text: str, hint: str) -> yaml.Node:
        """Return the root node of a YAML text; errors as for `load`."""
        try:
            loader = yaml.SafeLoader(text)
        except yaml.reader.ReaderError as error:
            problem = f"the character U+{error.character:04X} is not allowed; delete it"
            self._refuse(*_end_of(text[: error.position]), f"not valid YAML: {problem}")
        try:
            root = loader.get_single_node()
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark or loader.get_mark()
            self._refuse(mark.line, mark.column, f"not valid YAML: {error.problem}")
        except RecursionError:
            mark = loader.get_mark()
            self._refuse(mark.line, mark.column, f"not valid YAML: parts are nested too deeply; {hint}")
        except (ValueError, OverflowError) as error:  # an escape of no character, or a number with too many digits
            mark = loader.get_mark()
            self._refuse(mark.line, mark.column, f"not valid YAML: {error}")
        if root is None:
            self._refuse(0, 0, f"the file is empty; {hint}")
        self._check_tags(root)
        return root

    def _check_tags(self, root: yaml.Node) -> None:
        """Refuse tags that are not those of plain YAML; parts that anchors repeat are looked at once."""
        seen, waiting = set(), [root]
        while waiting:
            node = waiting.pop()
            if id(node) in seen:
                continue
            seen.add(id(node))
            if node.tag not in _PLAIN:
                tag = node.tag.replace("tag:yaml.org,2002:", "!!")
                self.fail(node, f"the tag {tag} is not allowed; leave it out")
            if isinstance(node, yaml.SequenceNode):
                waiting.extend(node.value)
            elif isinstance(node, yaml.MappingNode):
                waiting.extend(part for pair in node.value for part in pair)

    def fail(self, node: yaml.Node, message: object) -> NoReturn:
        """Raise an error with the place of a node."""
        self._refuse(node.start_mark.line, node.start_mark.column, message)

    def place(self, node: yaml.Node) -> str:
        """Return where a node is, as messages say it: "FILE:LINE:COLUMN"."""
        return f"{self.path}:{node.start_mark.line + 1}:{node.start_mark.column + 1}"

    def _refuse(self, line: int, column: int, message: object) -> NoReturn:
        """Raise an error with a place, both counted from 0."""
        raise self.error(f"{self.path}:{line + 1}:{column + 1}: {_one_line(str(message))}")

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
            name = self.text(key)
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
        """Return `make(*values, **fields)`, and raise its errors with the place of the node.

        A message that begins with the name of one of the node's fields gets the place of that field.
        """
        try:
            return make(*values, **fields)
        except HugwbcError as error:
            self.fail(_culprit(node, str(error)), error)

    def text(self, node: yaml.Node) -> str:
        """Return a node's text."""
        if not isinstance(node, yaml.ScalarNode):
            self.fail(node, "expected text")
        if node.tag.endswith(":null"):
            self.fail(node, "expected text, found nothing; give it, or leave the field out")
        if any(unicodedata.category(letter) in ("Cc", "Cs") and letter not in "\n\t" for letter in node.value):
            self.fail(node, f"the text {node.value!r} has control characters; leave them out")
        return node.value

    def one_of(self, node: yaml.Node, what: str, valid: Collection[str]) -> str:
        """Return a node's text, which must be one of the valid names of what it names."""
        name = self.text(node)
        if name not in valid:
            self.fail(node, UnknownNameError(what, name, valid))
        return name

    def number(self, node: yaml.Node) -> float:
        """Return a node's number, which is finite."""
        try:
            value = float(self.text(node))
        except ValueError:
            self.fail(node, f"'{self.text(node)}' is not a number; give one without a unit, such as 0.5")
        if not math.isfinite(value):
            self.fail(node, f"'{self.text(node)}' is not a finite number")
        return value

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


def _end_of(text: str) -> tuple[int, int]:
    """Return line and column of what follows a text, counted from 0."""
    return text.count("\n"), len(text) - text.rfind("\n") - 1


def _culprit(node: yaml.Node, message: str) -> yaml.Node:
    """Return the value of the field whose name a message begins with, or the node itself."""
    words = re.sub(r"^(unknown|command) ", "", message)
    fields = node.value if isinstance(node, yaml.MappingNode) else []
    named = [(key.value, value) for key, value in fields if isinstance(key, yaml.ScalarNode)]
    for name, value in sorted(named, key=lambda field: -len(field[0])):
        if re.match(rf"({re.escape(name)}|{re.escape(name.replace('_', ' '))})\b", words):
            return value
    return node


def _one_line(text: str) -> str:
    """Return a message on one line that a terminal can show: no control characters, and of a readable length."""
    if len(text) > LONGEST_MESSAGE:
        text = f"{text[: LONGEST_MESSAGE // 2]} ... {text[-LONGEST_MESSAGE // 2 :]}"
    return "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in text)
