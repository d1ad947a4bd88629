"""Extension of griffe, which reads the docstrings for the API reference: entries for several names, and inherited ones.

The docstrings write `v_x, v_y: velocity of the pelvis` where Google's convention allows only one name per entry. A
method that does what its base says has no docstring of its own.
"""

import re
from collections.abc import Iterator
from typing import Any

import griffe

_ENTRY = re.compile(r"^(\s+)((?:\w+, )+\w+)( \([^)]*\))?: ")


class SharedEntries(griffe.Extension):
    """Give each of the names that share an entry an entry of its own."""

    def on_object(self, *, obj: griffe.Object, **kwargs: Any) -> None:  # noqa: ANN401  griffe's signature
        """Rewrite the docstring of an object before it is parsed."""
        if obj.docstring is not None:
            obj.docstring.value = "\n".join(_split(obj.docstring.value.splitlines()))

    def on_package(self, *, pkg: griffe.Module, **kwargs: Any) -> None:  # noqa: ANN401  griffe's signature
        """Give methods without a docstring that of their base, once all modules are read."""
        for one in _classes(pkg):
            for name, member in one.members.items():
                bases = (base.members[name] for base in one.mro() if name in base.members)
                if not member.is_alias and member.docstring is None:
                    member.docstring = next((base.docstring for base in bases if base.docstring is not None), None)


def _classes(place: griffe.Module | griffe.Class) -> Iterator[griffe.Class]:
    """Yield all classes of a module or class."""
    for member in place.members.values():
        if member.is_alias:
            continue
        if isinstance(member, griffe.Class):
            yield member
        if isinstance(member, griffe.Module | griffe.Class):
            yield from _classes(member)


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
