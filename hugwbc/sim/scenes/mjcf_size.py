"""How large the model of an MJCF file will be, from its text: MuJoCo has no limits, and one line may ask for hours.

All files that MuJoCo will read are read here first, which also notes them (`hugwbc.files.noting`).
"""

import math
import pathlib
import re
from collections.abc import Collection, Iterator
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from hugwbc.errors import SceneError
from hugwbc.files import read_file

MOST_PARTS = 5_000  # elements with their repetitions; MuJoCo's time grows with the square
MOST_CELLS = 2**24  # heights, pixels, or numbers of a sensor; a picture of 4096 x 4096
MOST_DETAIL = 128  # pieces of a made mesh along a direction
MOST_BYTES, MOST_TEXT = 32_000_000, 4_000_000  # of all files together, and of one of XML
_GRIDS = (("nrow", "ncol"), ("width", "height"), ("dim",), ("nsample",))  # whose product is a number of cells
_PNG = b"\x89PNG"  # followed by width and height


def check_size(path: pathlib.Path) -> None:
    """Refuse an MJCF file that includes, repeats or holds more than can be simulated.

    Raises:
        OSError: if the file or one that it names cannot be read.
        ElementTree.ParseError: if it is not XML.
        SceneError: if the model would be too large; names the limit.
    """
    _Walk().parts_of(path)


class _Walk:
    """A walk through a file and all that it includes and attaches."""

    def __init__(self) -> None:
        self._bytes = 0
        self._parts: dict[pathlib.Path, int] = {}  # of finished files

    def parts_of(self, path: pathlib.Path) -> int:
        """Return how many elements a file has."""
        if path not in self._parts:
            root = self._merged(path, path.parent, ())
            given = [
                root.get(key, "") for root in root.iter("compiler") for key in ("meshdir", "texturedir", "assetdir")
            ]
            folders = [path.parent, *(path.parent / name for name in given)]
            attached = {
                element.get("name"): self.parts_of(other)
                for element in root.iter("model")
                for other in _named(element, folders)
            }
            self._parts[path] = self._weigh(root, 1, folders, attached)
        return self._parts[path]

    def _merged(self, path: pathlib.Path, folder: pathlib.Path, outer: tuple[pathlib.Path, ...]) -> Element:
        """Return the elements of a file with those of the files that it includes in their place."""
        if path in outer:
            raise SceneError(f"{path} includes itself; leave that out")
        # MuJoCo also takes comments that are no valid XML, such as <!-- -- -->.
        text = re.sub(rb"<!--.*?-->", b"", self._read(path, MOST_TEXT), flags=re.DOTALL)
        root = ElementTree.fromstring(text)  # noqa: S314  expat bounds what entities expand to
        for parent in list(root.iter()):
            for index, element in reversed(list(enumerate(parent))):
                if element.tag == "include":
                    inner = [self._merged(other, folder, (*outer, path)) for other in _named(element, [folder])]
                    parent[index : index + 1] = [part for other in inner for part in other]
        return root

    def _weigh(self, parent: Element, times: int, folders: list[pathlib.Path], attached: dict[str | None, int]) -> int:
        """Return how many elements are in one that is repeated a number of times; refuse too much."""
        parts = 0
        for element in parent:
            here = times * max(1, _product(element, ("count",)))
            parts += here + here * attached.get(element.get("model"), 0) * (element.tag == "attach")
            cells = max(_product(element, grid) for grid in _GRIDS)
            for other in _named(element, folders) if element.tag != "model" else ():
                head = self._read(other, MOST_BYTES)[:24]
                if head.startswith(_PNG):
                    cells = max(cells, int.from_bytes(head[16:20]) * int.from_bytes(head[20:24]))
            _refuse_above(MOST_CELLS, cells, f"numbers in its {element.tag} '{element.get('name', '')}'")
            _refuse_above(
                MOST_DETAIL, _product(element, ("params",)), f"pieces in its mesh '{element.get('name', '')}'"
            )
            parts += self._weigh(element, here, folders, attached)
            _refuse_above(MOST_PARTS, parts, "elements with their repetitions")
        return parts

    def _read(self, path: pathlib.Path, largest: int) -> bytes:
        content = read_file(path, largest)
        self._bytes += len(content)
        _refuse_above(MOST_BYTES, self._bytes, "bytes in all its files")
        return content


def _named(element: Element, folders: Collection[pathlib.Path]) -> Iterator[pathlib.Path]:
    """Yield the files that an element names; MuJoCo may be told to leave out the folders in a name."""
    for value in [value for key, value in element.items() if key.startswith("file")]:
        found = {folder / name: None for folder in folders for name in (value, pathlib.PurePath(value).name)}
        yield from (path for path in found if path.is_file())


def _product(element: Element, attributes: tuple[str, ...]) -> int:
    """Return the product of the numbers in some attributes of an element, 0 without any."""
    words = " ".join(element.get(name, "") for name in attributes).split()
    try:
        return round(min(1e18, math.prod(map(float, words)))) if words else 0
    except (ValueError, OverflowError):  # MuJoCo says what is wrong
        return 0


def _refuse_above(most: int, found: int, what: str) -> None:
    if found > most:
        raise SceneError(f"it has {found} {what}; give at most {most}")
