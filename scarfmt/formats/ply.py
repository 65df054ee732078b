"""The header of a PLY file: its elements, their properties, and where the rows begin.

Greg Turk, "The PLY Polygon File Format", 1994. The rows are read in :mod:`scarfmt.formats.ply_body`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from scarfmt.formats.source import Source

_MAX_HEADER = 1 << 16
_FIRST_LINE = re.compile(rb"ply[ \t]*(\r\n|\n|\r)")

LIST = "list"
"""The value of `Element.properties` for a list."""

TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
"""numpy's name of each PLY type, without byte order."""

_BYTE_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}


@dataclass
class Element:
    """One element declaration.

    Attributes:
        name: e.g. ``"vertex"``.
        count: rows.
        properties: type of each property by name, in the order of a row; `LIST` for lists.
        layout: for each property, the type of its length (None for a single number) and of a number.
        row_bytes: least bytes of a row.
    """

    name: str
    count: int
    properties: dict[str, str] = field(default_factory=dict)
    layout: list[tuple[str | None, str]] = field(default_factory=list)
    row_bytes: int = 0

    def declare(self, name: str, length: str | None, item: str, text: bool) -> None:
        """Add a property; in text, a number takes at least a digit and what divides it from the next."""
        self.properties[name] = item if length is None else LIST
        self.layout.append((length, item))
        self.row_bytes += 2 if text else np.dtype(TYPES[length or item]).itemsize


@dataclass(frozen=True)
class Header:
    """The contents of a PLY header.

    Attributes:
        byte_order: ``"<"``, ``">"``, or empty for text.
        elements: by name, in the order of the file.
        length: bytes of the header.
    """

    byte_order: str
    elements: dict[str, Element]
    length: int


def is_ply(source: Source) -> bool:
    """Whether the content starts as a PLY file does."""
    return _FIRST_LINE.match(source.head(16)) is not None


def read_header(source: Source) -> Header:
    """Parse the header.

    Raises:
        InvalidInput: not a PLY file, or the header is cut or malformed.
    """
    head = source.head(_MAX_HEADER)
    start = _FIRST_LINE.match(head)
    if start is None:
        raise source.corrupt("not a PLY file", offset=0)
    # One end of line holds for a whole header: the first byte of the rows may look like another.
    newline = re.escape(start[1])
    end = re.search(newline + rb"end_header[ \t]*" + newline, head)
    if end is None:
        raise source.corrupt("no complete PLY header in the first 64 KiB")
    try:
        lines = [line.split() for line in re.split(newline.decode(), head[: end.start()].decode("ascii"))]
    except UnicodeDecodeError as error:
        raise source.corrupt("the PLY header is not ASCII") from error
    elements: dict[str, Element] = {}
    byte_order: str | None = None
    for words in lines[1:]:
        match words:
            case ["format", kind, "1.0"] if kind in _BYTE_ORDERS and byte_order is None:
                byte_order = _BYTE_ORDERS[kind]
            case ["element", name, count] if re.fullmatch(r"[0-9]{1,18}", count) and name not in elements:
                elements[name] = Element(name, int(count))
            case ["property", *declaration] if elements and byte_order is not None:
                _declare(source, next(reversed(elements.values())), declaration, text=not byte_order)
            case [] | ["comment" | "obj_info", *_]:
                pass
            case _:
                raise source.corrupt(f"malformed PLY header line {' '.join(words)[:80]!r}")
    if byte_order is None:
        raise source.corrupt("the PLY header lacks its format")
    return Header(byte_order, elements, end.end())


def _declare(source: Source, element: Element, declaration: list[str], text: bool) -> None:
    match declaration:
        case ["list", length, item, name] if {length, item} <= TYPES.keys() and name not in element.properties:
            element.declare(name, length, item, text)
        case [kind, name] if kind in TYPES and name not in element.properties:
            element.declare(name, None, kind, text)
        case _:
            raise source.corrupt(f"malformed PLY property {' '.join(declaration)[:80]!r}")
