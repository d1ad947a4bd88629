"""Extension of griffe, which reads the docstrings for the API reference: one entry for several names.

The docstrings write `v_x, v_y: velocity of the pelvis` where Google's convention allows only one name per entry.
"""

import re
from typing import Any

import griffe

_ENTRY = re.compile(r"^(\s+)((?:\w+, )+\w+)( \([^)]*\))?: ")


class SharedEntries(griffe.Extension):
    """Give each of the names that share an entry an entry of its own."""

    def on_object(self, *, obj: griffe.Object, **kwargs: Any) -> None:  # noqa: ANN401  griffe's signature
        """Rewrite the docstring of an object before it is parsed."""
        if obj.docstring is not None:
            obj.docstring.value = "\n".join(_split(obj.docstring.value.splitlines()))


def _split(lines: list[str]) -> list[str]:
    """Return the lines with every shared entry repeated for each of its names."""
    result: list[str] = []
    index = 0
    while index < len(lines):
        match = _ENTRY.match(lines[index])
        if match is None:
            result.append(lines[index])
            index += 1
            continue
        indent, names, kind = match.groups()
        end = index + 1
        while end < len(lines) and lines[end].startswith(indent + " "):
            end += 1
        for name in names.split(", "):
            first = f"{indent}{name}{kind or ''}: {lines[index][match.end() :]}"
            result += [first, *lines[index + 1 : end]]
        index = end
    return result
