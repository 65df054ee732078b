"""PLY files: the header, and the rows of its elements as numpy arrays, binary of either byte order or text.

Greg Turk, "The PLY Polygon File Format", 1994. Only elements that are asked for are kept. Lists (the faces of a mesh)
are passed over, and refused in an element that is asked for.
"""

from __future__ import annotations

import io
import math
import re
import warnings
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from itertools import islice
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from scarfmt.container.registries import RenderModel
from scarfmt.errors import InputWarning, LimitExceeded, Unsupported
from scarfmt.formats.output import Says
from scarfmt.formats.source import MAX_GAUSSIANS, Source
from scarfmt.scene.description import Description

_MAX_HEADER = 1 << 20
_FIRST_LINE = re.compile(rb"ply[ \t]*[\r\n]")
_END = re.compile(rb"[\r\n][ \t]*end_header[ \t]*(\r\n|\n|\r)")
_LINES = re.compile(r"\r\n|\n|\r")

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

_TEXTS = ("comment", "obj_info")
_MODEL_MARKS = {
    "splatrendermode: default": RenderModel.CLASSIC,
    "splatrendermode: mip": RenderModel.ANTIALIASED,
    "splatrendermode: 2dgs": RenderModel.TWO_DIMENSIONAL,
    "antialiased 0": RenderModel.CLASSIC,
    "antialiased 1": RenderModel.ANTIALIASED,
}
"""Comments, in lower case, of Brush and Postshot."""
PLY_SAYS = Says.RENDER_MODEL | Says.UP | Says.ORIGIN | Says.EPSG
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
        comments: texts of its comments and `obj_info` lines.
    """

    byte_order: str
    elements: dict[str, Element]
    length: int
    comments: tuple[str, ...]


def is_ply(source: Source) -> bool:
    """Whether the content starts as a PLY file does."""
    return _FIRST_LINE.match(source.head(16)) is not None


def read_header(source: Source) -> Header:
    """Parse the header.

    Raises:
        InvalidInput: not a PLY file, or the header is cut or malformed.
        Unsupported: a property of a type that PLY does not have.
    """
    head = source.head(_MAX_HEADER)
    if _FIRST_LINE.match(head) is None:
        raise source.corrupt("not a PLY file", offset=0)
    end = _END.search(head)
    if end is None:
        raise source.corrupt(f"no complete PLY header in the first {_MAX_HEADER >> 10} KiB")
    # Comments are in any encoding. Lines of one header may end in different ways, for tools add lines of their own.
    lines = [line.split() for line in _LINES.split(head[: end.start()].decode("utf-8", "replace"))]
    # Where lines end in CR alone, an LF is the first byte of the rows.
    length = end.end() - (end[1] == b"\r\n" and b"\n" not in head[: end.start()])
    comments = tuple(" ".join(words[1:]) for words in lines if words and words[0] in _TEXTS)
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
            case [first, *_] if first not in _TEXTS:
                raise source.corrupt(f"malformed PLY header line {' '.join(words)[:80]!r}")
    if byte_order is None:
        raise source.corrupt("the PLY header lacks its format")
    return Header(byte_order, elements, length, comments)


def describe(source: Source) -> Description:
    """What the comments and columns of the header say about the scene.

    Known are the render model of Brush (`SplatRenderMode: mip`), Postshot (`antialiased 1`), of columns `filter_3D`
    (Mip-Splatting) and of two scales (2DGS); the up axis of Nerfstudio and Brush (`Vertical Axis: z`); `epsg 32650`
    with `offsetx 1000.125` and so on, of scanners. The last line of a kind counts.
    """
    header = read_header(source)
    said = {words[0].lower().rstrip(":"): words[1:] for text in header.comments if (words := text.split())}
    epsg = _numbers(said.get("epsg", []))
    offset = tuple(next(iter(_numbers(said.get(f"offset{axis}", []))), 0.0) for axis in "xyz")
    vertical = said.get("vertical", [""])
    return Description(
        _render_model(header),
        _up_axis(vertical[1:]) if vertical[0].lower() == "axis:" else None,
        coordinate_reference=f"EPSG:{epsg[0]:.0f}" if epsg and epsg[0] > 0 else "",
        origin=(offset[0], offset[1], offset[2]),
    )


def _render_model(header: Header) -> RenderModel:
    columns = header.elements["vertex"].properties if "vertex" in header.elements else {}
    if "scale_1" in columns and "scale_2" not in columns:
        return RenderModel.TWO_DIMENSIONAL
    found = RenderModel.ANTIALIASED if "filter_3D" in columns else RenderModel.CLASSIC
    for text in header.comments:
        mark = " ".join(text.lower().replace(":", ": ").split())
        if mark.startswith("splatrendermode:") and mark not in _MODEL_MARKS:
            message = f"unknown render model in {text!r}: known are default, mip and 2dgs"
            warnings.warn(message, InputWarning, stacklevel=2)
        found = _MODEL_MARKS.get(mark, found)
    return found


def _up_axis(words: list[str]) -> str | None:
    """The axis of a name or of three numbers; None for y, which Brush writes whatever is up."""
    numbers = _numbers(words)
    if len(numbers) == 3 and max(map(abs, numbers)) > 0:
        largest = max(range(3), key=lambda axis: abs(numbers[axis]))
        return ("-" if numbers[largest] < 0 else "") + "xyz"[largest]
    name = "".join(words[:1]).lower().lstrip("+")
    return name if name in ("x", "-x", "-y", "z", "-z") else None


def _numbers(words: list[str]) -> list[float]:
    """The finite numbers that a comment begins with."""
    numbers = []
    for word in words:
        try:
            numbers.append(float(word))
        except ValueError:
            break
    return [number for number in numbers if math.isfinite(number)]


def _declare(source: Source, element: Element, declaration: list[str], text: bool) -> None:
    match declaration:
        case ["list", length, item, name] if {length, item} <= TYPES.keys() and name not in element.properties:
            element.declare(name, length, item, text)
        case [kind, name] if kind in TYPES and name not in element.properties:
            element.declare(name, None, kind, text)
        case [kind, name] if kind not in TYPES:
            message = f"{source.name}: {name[:40]} has type {kind[:40]!r}, which PLY does not have; export it as float"
            raise Unsupported("input-format", message, field=element.name)
        case _:
            raise source.corrupt(f"malformed PLY property {' '.join(declaration)[:80]!r}, or one declared twice")


Rows = NDArray[np.void]


def read_elements(source: Source, header: Header, names: Collection[str]) -> dict[str, Rows]:
    """The rows of the named elements, as structured arrays in memory.

    Args:
        names: elements wanted; those the file lacks are left out.

    Raises:
        InvalidInput: the body does not match the header.
        Unsupported: a wanted element has lists.
        LimitExceeded: more rows than any scene has.

    Warns:
        InputWarning: the file goes on after its last row.
    """
    check_sizes(source, header)
    listed = [name for name in names if name in header.elements and LIST in header.elements[name].properties.values()]
    if listed:
        message = f"{source.name}: rows of {listed[0]} with lists are not read; export the scene without"
        raise Unsupported("input-format", message, field=listed[0])
    with source.open() as stream:
        stream.seek(header.length)
        try:
            if not header.byte_order:
                with io.TextIOWrapper(stream, "ascii", newline=None) as text:
                    found = _read_text(text, header, names)
                    if next(reversed(header.elements), None) in found and text.readline().strip():
                        _warn_of_more(source, "lines")
                    return found
            return _read_binary(stream, header, names)
        except (ValueError, OverflowError) as error:
            # What follows a semicolon is NumPy's advice to programmers.
            raise source.corrupt(f"malformed PLY body: {str(error).partition(';')[0]}") from error


def columns(rows: Rows, names: list[str]) -> NDArray[np.generic]:
    """The named columns as one (N, len(names)) array of their common type, at least float32."""
    kind = np.result_type(np.float32, *(rows.dtype[name] for name in names)) if names else np.dtype(np.float32)
    table = np.empty((len(rows), len(names)), kind)
    for position, name in enumerate(names):
        table[:, position] = rows[name]
    return table


def check_sizes(source: Source, header: Header, most: int = MAX_GAUSSIANS) -> None:
    """Refuse counts that cannot fit into the file, before memory is allocated for them.

    Args:
        most: rows accepted of an element.

    Raises:
        InvalidInput: the file is too short for its header.
        LimitExceeded: more rows than any scene has.

    Warns:
        InputWarning: a binary file goes on after its last row.
    """
    needed = header.length
    for element in header.elements.values():
        if element.count > most:
            raise LimitExceeded("input-limit", f"{source.name}: {element.count} rows, above the limit {most}")
        needed += element.count * element.row_bytes
    # The last line of a text file may lack its newline.
    if source.size + (not header.byte_order) < needed:
        raise source.corrupt(f"{source.size} bytes, but the PLY header declares at least {needed}")
    exact = header.byte_order and not any(LIST in element.properties.values() for element in header.elements.values())
    if exact and source.size - needed >= max((element.row_bytes for element in header.elements.values()), default=0):
        _warn_of_more(source, f"{source.size - needed:,} bytes")


def _warn_of_more(source: Source, what: str) -> None:
    warnings.warn(f"{source.name}: {what} after the declared rows: not read", InputWarning, stacklevel=3)


def row_type(element: Element, order: str) -> np.dtype[np.void]:
    """The type of a row without lists; `order` is numpy's name of the byte order."""
    return np.dtype([(name, order + TYPES[kind]) for name, kind in element.properties.items()])


def _until_last(header: Header, names: Collection[str]) -> list[Element]:
    """The elements from the first to the last wanted one: what follows need not be read."""
    elements = list(header.elements.values())
    while elements and elements[-1].name not in names:
        elements.pop()
    return elements


def _read_binary(stream: BinaryIO, header: Header, names: Collection[str]) -> dict[str, Rows]:
    found: dict[str, Rows] = {}
    for element in _until_last(header, names):
        if element.name in names:
            found[element.name] = np.fromfile(stream, row_type(element, header.byte_order), element.count)
            if len(found[element.name]) < element.count:
                raise ValueError(f"the file ends in row {len(found[element.name])} of {element.name}")
        elif LIST in element.properties.values():
            _pass_lists(stream, element, header.byte_order)
        else:
            stream.seek(element.count * element.row_bytes, io.SEEK_CUR)
    return found


def _pass_lists(stream: BinaryIO, element: Element, order: str) -> None:
    """Leave the rows of an element with lists behind: only reading them shows where they end."""
    counts = [None if length is None else np.dtype(order + TYPES[length]) for length, _ in element.layout]
    sizes = [np.dtype(TYPES[item]).itemsize for _, item in element.layout]
    for _ in range(element.count):
        for count, size in zip(counts, sizes, strict=True):
            items = 1 if count is None else int(np.frombuffer(stream.read(count.itemsize), count)[0])
            if items < 0:
                raise ValueError(f"a list of {items} items in {element.name}")
            stream.seek(items * size, io.SEEK_CUR)


def _read_text(stream: Iterator[str], header: Header, names: Collection[str]) -> dict[str, Rows]:
    found: dict[str, Rows] = {}
    for element in _until_last(header, names):
        lines = islice(stream, element.count)
        if element.name not in names:
            for _ in lines:
                pass
            continue
        kind = row_type(element, "=")
        # loadtxt warns where there is nothing to read.
        rows = np.loadtxt(_refuse_blank(lines), kind, comments=None, ndmin=1) if element.count else np.empty(0, kind)
        if len(rows) < element.count:
            raise ValueError(f"the file ends in row {len(rows)} of {element.name}")
        found[element.name] = rows
    return found


def _refuse_blank(lines: Iterator[str]) -> Iterator[str]:
    """`lines`, none of which may be blank: loadtxt would pass over such a line and count on."""
    for number, line in enumerate(lines):
        if not line.strip():
            raise ValueError(f"row {number} is blank")
        yield line
