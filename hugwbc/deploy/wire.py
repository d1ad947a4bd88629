"""The maker's low-level messages as bytes: their layouts, their form on the network and their check sum.

No message is defined here: the layouts are derived from the IDL classes of the maker's package, and a kind of message
has the name of IDL package and class, such as "unitree_hg.LowCmd_". A message is handled as a NumPy record with the
layout of the maker's C structure, since the check sum is computed over that. On the network it is CDR (OMG DDSI-RTPS
2.5, clause 10), which holds the same numbers with other padding. One message therefore becomes the other by a fixed
selection of bytes: 0.005 ms, where the Python classes of the IDL need 1 ms.
"""

import functools
import importlib
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from hugwbc.errors import needing

COMMAND, STATE = "LowCmd_", "LowState_"
PACKAGES = ("unitree_go", "unitree_hg")  # that have these classes
_CDR_HEADER = b"\x00\x01\x00\x00"  # plain CDR, little-endian
_LITTLE_ENDIAN = (b"\x00\x01", b"\x00\x07")  # CDR of version 1 and 2; for numbers of up to 4 bytes they are the same
_KINDS = {
    "uint8": "u1",
    "int8": "i1",
    "uint16": "<u2",
    "int16": "<i2",
    "uint32": "<u4",
    "int32": "<i4",
    "float32": "<f4",
}
_REVERSED_BITS = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
_WORD = 4  # bytes


@functools.cache
def idl_class(name: str) -> type:
    """Return the maker's IDL class of a message or of a part of one."""
    package, _, short = name.partition(".")
    with needing("deploy", "a message of the robot"):
        return getattr(importlib.import_module(f"unitree_sdk2py.idl.{package}.msg.dds_"), short)


@functools.cache
def layout(name: str) -> np.dtype:
    """Return the layout of the maker's C structure of a message."""
    fields: list[Any] = []
    package = name.partition(".")[0]
    for field, kind, count in _fields(idl_class(name)):
        element = np.dtype(_KINDS[kind]) if kind in _KINDS else layout(f"{package}.{kind}")
        fields.append((field, element) if count is None else (field, element, (count,)))
    return np.dtype(fields, align=True)


def _fields(message: type) -> Iterator[tuple[str, str, int | None]]:
    """Yield name, kind (a number's, or an IDL class's name) and length (None for a single one) of each field."""
    for name, annotation in message.__annotations__.items():
        kind = _meaning(annotation)
        if hasattr(kind, "length"):
            yield name, _name(_meaning(kind.subtype)), kind.length
        else:
            yield name, _name(kind), None


def _meaning(annotation: Any) -> Any:  # noqa: ANN401  cyclonedds mixes names, classes and annotated numbers
    """Resolve a field's annotation: a class, its name, a number's name, or an array."""
    return annotation.__metadata__[0] if hasattr(annotation, "__metadata__") else annotation


def _name(kind: str | type) -> str:
    """Return the short name of a class; cyclonedds replaces names by classes when a topic is made."""
    return kind.rpartition(".")[2] if isinstance(kind, str) else kind.__name__


@functools.cache
def _places(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return where each byte of a message is in the C structure and in CDR, without padding."""
    structure: list[int] = []
    stream: list[int] = []
    end = 0
    for offset, size in _numbers(layout(name)):
        end += -end % size  # CDR aligns each number, but no structure
        structure += range(offset, offset + size)
        stream += range(end, end + size)
        end += size
    return np.array(structure), np.array(stream)


def _numbers(kind: np.dtype, offset: int = 0) -> Iterator[tuple[int, int]]:
    """Yield offset and size of all numbers of a layout [bytes], in order."""
    if kind.subdtype is not None:
        element, shape = kind.subdtype
        for index in range(shape[0]):
            yield from _numbers(element, offset + index * element.itemsize)
    elif kind.fields is not None:
        # Fields are in the order of their offsets.
        for inner, inner_offset, *_ in kind.fields.values():
            yield from _numbers(inner, offset + inner_offset)
    else:
        yield offset, kind.itemsize


def to_cdr(name: str, message: bytes) -> bytes:
    """Return the bytes of a C structure as they go over the network."""
    structure, stream = _places(name)
    cdr = np.zeros(int(stream[-1]) + 1, dtype=np.uint8)
    cdr[stream] = np.frombuffer(message, dtype=np.uint8)[structure]
    return _CDR_HEADER + cdr.tobytes()


def from_cdr(name: str, data: bytes) -> bytes | None:
    """Return the bytes of the C structure of a message from the network; None if it is of another kind or size."""
    structure, stream = _places(name)
    start = len(_CDR_HEADER)
    beyond = len(data) - start - int(stream[-1]) - 1  # at most the padding of the last word
    if data[:2] not in _LITTLE_ENDIAN or not 0 <= beyond < _WORD:
        return None
    message = np.zeros(layout(name).itemsize, dtype=np.uint8)
    message[structure] = np.frombuffer(data, dtype=np.uint8, offset=start)[stream]
    return message.tobytes()


def text_of(data: bytes) -> str:
    """Return the text of a `std_msgs.String_` from the network; what is not UTF-8 is replaced."""
    # Header and length come first, and a NUL ends it.
    return data[len(_CDR_HEADER) + _WORD :].partition(b"\0")[0].decode("utf-8", "replace")


def kind_of(message: bytes) -> str:
    """Return the kind of message that has this size, else the size, for people."""
    kinds = (f"{package}.{name}" for package in PACKAGES for name in (STATE, COMMAND))
    return next((kind for kind in kinds if layout(kind).itemsize == len(message)), f"{len(message)} bytes")


def check_sum(message: bytes) -> int:
    """Return the maker's check sum of a structure: of all but its last word, which holds it.

    It is CRC-32/MPEG-2 (polynomial 0x04C11DB7, initial value 0xFFFFFFFF, neither reflected nor inverted) over 32-bit
    little-endian words, most significant bit first (`utils/crc.py` of unitree_sdk2_python). zlib's CRC-32 has the same
    polynomial and initial value, but takes the least significant bit first and inverts the result; it gives the maker's
    on words whose 32 bits are reversed.
    """
    words = np.frombuffer(message, dtype="<u4")[:-1]
    reversed_words = words.byteswap().tobytes().translate(_REVERSED_BITS)
    reflected = ~zlib.crc32(reversed_words) & 0xFFFFFFFF
    return int.from_bytes(reflected.to_bytes(_WORD, "little").translate(_REVERSED_BITS), "big")


def sealed(record: np.ndarray) -> bytes:
    """Return the bytes of a message with its check sum, which is written to the record's `crc` as well."""
    record["crc"] = check_sum(record.tobytes())
    return record.tobytes()


def is_sealed(message: bytes) -> bool:
    """Return whether the check sum of a message is right."""
    return check_sum(message) == int.from_bytes(message[-_WORD:], "little")


def record(name: str, message: bytes | None = None) -> np.ndarray:
    """Return a message as a record whose fields can be read and written, of shape (); zeros without bytes.

    A copy of a record is not good for sending: NumPy leaves its padding undefined, which the check sum includes.
    """
    kind = layout(name)
    content = bytearray(kind.itemsize if message is None else message)
    return np.frombuffer(content, dtype=kind).reshape(())
