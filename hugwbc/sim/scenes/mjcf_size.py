"""How large the model of an MJCF file will be, from its text: MuJoCo has no limits, and one line may ask for hours."""

import math
import pathlib
import re
from collections.abc import Iterator
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from hugwbc.errors import SceneError
from hugwbc.files import read_file

MOST_PARTS = 5_000  # elements with their repetitions; MuJoCo's time grows with the square
MOST_CELLS = 2**24  # heights, pixels, or numbers of a sensor; a picture of 4096 x 4096
MOST_DETAIL = 128  # pieces of a made mesh along a direction
MOST_BYTES, MOST_TEXT = 32_000_000, 4_000_000  # of all files together, and of one of XML
_GRIDS = (("nrow", "ncol"), ("width", "height"), ("dim",), ("nsample",))  # whose product is a number of cells
_FOLDERS = ("meshdir", "texturedir", "assetdir")
_PNG, _BLOCK = b"\x89PNG", 4096  # what a picture begins with; [byte] as which a smaller file counts


class SizeCheck:
    """A walk through a file and all that it names; it reads what MuJoCo will read, so that `files.noting` sees it."""

    def __init__(self, path: pathlib.Path) -> None:
        """Refuse a file that would make too large a model; XML's and the system's errors are left to the caller."""
        self._bytes = 0
        root = self._tree(path, path.parent, ())
        given = [compiler.get(key, "") for compiler in root.iter("compiler") for key in _FOLDERS]
        self._folders = [path.parent, *(path.parent / name for name in given)]
        self._weigh(root, 1)

    def _tree(self, path: pathlib.Path, folder: pathlib.Path, outer: tuple[pathlib.Path, ...]) -> Element:
        """Return the elements of a file, with those of the files that it includes or attaches in their places."""
        if path in outer:
            raise SceneError(f"{path} includes itself; leave that out")
        # MuJoCo also takes comments that are no valid XML, such as <!-- -- -->.
        text = re.sub(rb"<!--.*?-->", b"", self._read(path, MOST_TEXT), flags=re.DOTALL)
        root = ElementTree.fromstring(text)  # noqa: S314  expat bounds what entities expand to
        models = {model.get("name"): model for model in root.iter("model")}
        for parent in list(root.iter()):
            for index, element in reversed(list(enumerate(parent))):
                named = {"include": element, "attach": models.get(element.get("model"))}.get(element.tag)
                if named is not None:
                    inner = [self._tree(other, folder, (*outer, path)) for other in _named(named, [folder])]
                    parent[index : index + 1] = [part for other in inner for part in other]
        return root

    def _weigh(self, parent: Element, times: int) -> int:
        """Return how many elements are in one that is repeated `times` times; refuse too many of them."""
        parts = 0
        for element in parent:
            here, name = times * max(1, _product(element, ("count",))), f"{element.tag} '{element.get('name', '')}'"
            cells = [_product(element, grid) for grid in _GRIDS]
            for other in _named(element, self._folders):
                head = self._read(other, MOST_BYTES)[:24]
                if head.startswith(_PNG):
                    cells.append(int.from_bytes(head[16:20]) * int.from_bytes(head[20:24]))
            _refuse_above(MOST_CELLS, max(cells), f"numbers in its {name}")
            _refuse_above(MOST_DETAIL, _product(element, ("params",)), f"pieces in its {name}")
            parts += here + self._weigh(element, here)
            _refuse_above(MOST_PARTS, parts, "elements with their repetitions")
        return parts

    def _read(self, path: pathlib.Path, largest: int) -> bytes:
        content = read_file(path, largest)
        self._bytes += max(len(content), _BLOCK)
        _refuse_above(MOST_BYTES, self._bytes, "bytes in all its files")
        return content


def _named(element: Element, folders: list[pathlib.Path]) -> Iterator[pathlib.Path]:
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
