"""Reading the elements of a PLY file into numpy, with its declared sizes checked first.

plyfile is used nowhere else: it reads binary files through a memory map, and is trusted with the body only after
the header's counts were found to fit into the file.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from scarfmt.errors import InvalidInput, LimitExceeded
from scarfmt.formats.source import MAX_GAUSSIANS, Source

_MAX_HEADER = 1 << 16
_SIZES = {
    **dict.fromkeys(("char", "int8", "uchar", "uint8"), 1),
    **dict.fromkeys(("short", "int16", "ushort", "uint16"), 2),
    **dict.fromkeys(("int", "int32", "uint", "uint32", "float", "float32"), 4),
    **dict.fromkeys(("double", "float64"), 8),
}


@dataclass
class Element:
    """One element declaration: its row count and the name and type of each property (`list` for lists)."""

    name: str
    count: int
    properties: dict[str, str] = field(default_factory=dict)
    row_bytes: int = 0


@dataclass(frozen=True)
class Header:
    """What a PLY header declares."""

    text: bool
    elements: dict[str, Element]
    length: int


def is_ply(source: Source) -> bool:
    """Whether the content starts as a PLY file does."""
    return re.match(rb"ply[ \t]*[\r\n]", source.head(16)) is not None


def read_header(source: Source) -> Header:
    """Parse the header.

    Raises:
        InvalidInput: not a PLY file, or the header is cut or malformed.
    """
    head = source.head(_MAX_HEADER)
    end = re.search(rb"(?:^|[\r\n])end_header[ \t]*(\r\n|\n|\r)", head)
    if not is_ply(source) or end is None:
        raise source.corrupt("no complete PLY header in the first 64 KiB")
    try:
        lines = [line.split() for line in re.split(r"\r\n|\n|\r", head[: end.start()].decode("ascii"))]
    except UnicodeDecodeError as error:
        raise source.corrupt("the PLY header is not ASCII") from error
    elements: dict[str, Element] = {}
    text = False
    for words in lines:
        match words:
            case ["format", kind, _]:
                text = kind == "ascii"
            case ["element", name, count] if re.fullmatch(r"[0-9]{1,18}", count) and name not in elements:
                elements[name] = Element(name, int(count))
            case ["property", *declaration] if elements:
                _declare(source, next(reversed(elements.values())), declaration, text)
            case ["element" | "property" | "format", *_]:
                raise source.corrupt(f"malformed PLY header line {' '.join(words)[:80]!r}")
    return Header(text, elements, end.end())


def _declare(source: Source, element: Element, declaration: list[str], text: bool) -> None:
    match declaration:
        case ["list", length, item, name] if length in _SIZES and item in _SIZES:
            element.properties[name] = "list"
            element.row_bytes += 2 if text else _SIZES[length]
        case [kind, name] if kind in _SIZES and name not in element.properties:
            element.properties[name] = kind
            element.row_bytes += 2 if text else _SIZES[kind]
        case _:
            raise source.corrupt(f"malformed PLY property {' '.join(declaration)[:80]!r}")


def check_sizes(source: Source, header: Header) -> None:
    """Refuse counts that cannot fit into the file, before memory is allocated for them.

    Raises:
        InvalidInput: the file is too short for its header.
        LimitExceeded: more rows than any scene has.
    """
    needed = header.length
    for element in header.elements.values():
        if element.count > MAX_GAUSSIANS:
            raise LimitExceeded("input-limit", f"{source.name}: {element.count} rows, above the limit {MAX_GAUSSIANS}")
        if element.count and not element.properties:
            raise source.corrupt("an element has rows but no properties", field=element.name)
        needed += element.count * element.row_bytes
    # The last line of a text file may lack its newline.
    if source.size + header.text < needed:
        raise source.corrupt(f"{source.size} bytes, but the PLY header declares at least {needed}")


def read_elements(source: Source, header: Header) -> dict[str, NDArray[np.void]]:
    """The rows of every element, as structured arrays in memory.

    Raises:
        InvalidInput: plyfile is not installed, or the body does not match the header.
        LimitExceeded: more rows than any scene has.
    """
    try:
        from plyfile import PlyData, PlyParseError
    except ImportError as error:
        message = "reading PLY files needs plyfile: pip install 'scarfmt[import]'"
        raise InvalidInput("input-dependency", message) from error
    check_sizes(source, header)
    with source.open() as stream:
        try:
            data = PlyData.read(stream)
        except (PlyParseError, ValueError, OverflowError) as error:
            raise source.corrupt(f"malformed PLY: {error}") from error
        return {element.name: np.array(element.data) for element in data.elements}


def columns(rows: NDArray[np.void], names: list[str]) -> NDArray[np.generic]:
    """The named columns as one (N, len(names)) array of their common type, at least float32."""
    kind = np.result_type(np.float32, *(rows.dtype[name] for name in names)) if names else np.dtype(np.float32)
    table = np.empty((len(rows), len(names)), kind)
    for position, name in enumerate(names):
        table[:, position] = rows[name]
    return table
