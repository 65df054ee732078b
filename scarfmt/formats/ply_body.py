"""The rows of a PLY file as numpy arrays: binary of either byte order, or text.

Only elements that are asked for are kept. Lists (the faces of a mesh) are passed over, and refused in an element that
is asked for.
"""

from __future__ import annotations

import io
from collections.abc import Collection, Iterator
from itertools import islice
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from scarfmt.errors import LimitExceeded
from scarfmt.formats.ply import LIST, TYPES, Element, Header
from scarfmt.formats.source import MAX_GAUSSIANS, Source

Rows = NDArray[np.void]


def read_elements(source: Source, header: Header, names: Collection[str]) -> dict[str, Rows]:
    """The rows of the named elements, as structured arrays in memory.

    Args:
        source: the file.
        header: its header.
        names: elements wanted; those the file lacks are left out.

    Raises:
        InvalidInput: the body does not match the header, or a wanted element has lists.
        LimitExceeded: more rows than any scene has.
    """
    check_sizes(source, header)
    listed = [name for name in names if name in header.elements and LIST in header.elements[name].properties.values()]
    if listed:
        raise source.corrupt("list properties among the values of Gaussians", field=listed[0])
    with source.open() as stream:
        stream.seek(header.length)
        try:
            if not header.byte_order:
                return _text(io.TextIOWrapper(stream, "ascii", newline=None), header, names)
            return _binary(stream, header, names)
        except (ValueError, OverflowError) as error:
            raise source.corrupt(f"malformed PLY body: {error}") from error


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
        source: the file.
        header: its header.
        most: rows accepted of an element.

    Raises:
        InvalidInput: the file is too short for its header.
        LimitExceeded: more rows than any scene has.
    """
    needed = header.length
    for element in header.elements.values():
        if element.count > most:
            raise LimitExceeded("input-limit", f"{source.name}: {element.count} rows, above the limit {most}")
        if element.count and not element.properties:
            raise source.corrupt("an element has rows but no properties", field=element.name)
        needed += element.count * element.row_bytes
    # The last line of a text file may lack its newline.
    if source.size + (not header.byte_order) < needed:
        raise source.corrupt(f"{source.size} bytes, but the PLY header declares at least {needed}")


def row_type(element: Element, order: str) -> np.dtype[np.void]:
    """The type of a row without lists; `order` is numpy's name of the byte order."""
    return np.dtype([(name, order + TYPES[kind]) for name, kind in element.properties.items()])


def _until_last(header: Header, names: Collection[str]) -> list[Element]:
    """The elements from the first to the last wanted one: what follows need not be read."""
    elements = list(header.elements.values())
    while elements and elements[-1].name not in names:
        elements.pop()
    return elements


def _binary(stream: BinaryIO, header: Header, names: Collection[str]) -> dict[str, Rows]:
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


def _text(stream: Iterator[str], header: Header, names: Collection[str]) -> dict[str, Rows]:
    found: dict[str, Rows] = {}
    for element in _until_last(header, names):
        lines = islice(stream, element.count)
        if element.name not in names:
            for _ in lines:
                pass
            continue
        kind = row_type(element, "=")
        # loadtxt warns where there is nothing to read.
        rows = np.loadtxt(_filled(lines), kind, comments=None, ndmin=1) if element.count else np.empty(0, kind)
        if len(rows) < element.count:
            raise ValueError(f"the file ends in row {len(rows)} of {element.name}")
        found[element.name] = rows
    return found


def _filled(lines: Iterator[str]) -> Iterator[str]:
    """`lines`, none of which may be blank: loadtxt would pass over such a line and count on."""
    for number, line in enumerate(lines):
        if not line.strip():
            raise ValueError(f"row {number} is blank")
        yield line
