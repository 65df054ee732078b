"""The worked file of SPEC.md §4.2, byte by byte: a line for every few fields, with what they are there for."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator

from conformance.spec.worked import Row, field_rows, table_rows

# Structure -> what it is, and its lines: how many fields each takes, and a remark.
_Lines = tuple[tuple[int, str], ...]
_TILE: _Lines = ((1, ""), (3, ""), (3, ""), (1, ""))
_SUMMARY: _Lines = (
    (2, "cumulative"),
    (2, "so its blocks are the byte_count bytes before end_offset"),
    (1, "of kinds 0..12; 0: models, 1: POSITIONS, 5: SCALE, 12: framing"),
)
_TOUR: dict[str, tuple[str, _Lines]] = {
    "header": (
        "FILE_HEADER (5.2)",
        (
            (1, ""),
            (3, ""),
            (1, "104 + 136 * 2 layers"),
            (1, ""),
            (8, ""),
            (2, ""),
            (2, ""),
            (1, "three f64"),
            (1, "a lattice step is 0.25 long"),
            (1, ""),
            (1, "it covers ROOT, as the CRC at the end of the header covers this"),
        ),
    ),
    "summary 1": ("LAYER_SUMMARY of layer 1 (5.3)", _SUMMARY),
    "summary 2": ("LAYER_SUMMARY of layer 2", tuple((count, "") for count, _ in _SUMMARY)),
    "header end": ("HEADER_CHECKSUM", ((1, ""),)),
    "root": (
        "ROOT (5.4)",
        (
            (1, "that belong to no tile"),
            (5, ""),
            (5, ""),
            (1, ""),
            (5, ""),
            (5, ""),
            (1, "5 << 60: the cube of the first tile has depth 1 and prefix 5"),
            (2, ""),
            (4, ""),
            (4, ""),
        ),
    ),
    "tile page 0": ("tile page 0 (5.5): the only tile, half the lattice wide", ((3, ""),)),
    "layer 1 row page 0": ("row page of layer 1", ((3, "count: two anchors appear"),)),
    "layer 2 row page 0": ("row page of layer 2", ((3, "one anchor appears"),)),
    "layer 1 LAYER": (
        "LAYER of layer 1 (7.11)",
        (
            (1, ""),
            (1, ""),
            (2, ""),
            (3, "in f64"),
            (2, ""),
            (1, ""),
            (2, ""),
            (1, ""),
            (2, "no codewords; one step of SCALE, one of OPACITY"),
        ),
    ),
    "layer 1 TABLES": ("TABLES of layer 1 (8.3): a rANS stream of adaptive numbers (8.5)", ((1, ""),)),
    "layer 1 TILE 0": (
        "TILE of layer 1 (7.1)",
        (*_TILE, (1, "two words of a rANS stream (8.2)"), (1, "OPACITY and CLASSES have no bytes")),
    ),
    "layer 2 LAYER": (
        "LAYER of layer 2",
        ((1, ""), (1, ""), (2, "SCALE of class 0 is refined"), (2, "a new class")),
    ),
    "layer 2 TABLES": (
        "TABLES of layer 2: the second step of SCALE, and a new table for the first of OPACITY", ((1, ""),),
    ),
    "layer 2 TILE 0": ("TILE of layer 2", (*_TILE, (1, ""), (1, "decoded in 4.3"))),
}
_LINE_BYTES, _SHOWN_BYTES, _WIDTH = 9, 27, 120


def tour_rows(data: bytes) -> Iterator[tuple[str, int, int, str]]:
    """(structure, offset, size, text) of every line, in file order, without gaps.

    Raises:
        ValueError: a line would take fields of two structures, or fields are left: the tour is not of this file.
    """
    rows = field_rows(data)
    at = 0
    for name, (_, lines) in _TOUR.items():
        for count, remark in lines:
            fields = rows[at : at + count]
            if {row[2].split(".")[0] for row in fields} != {name.removesuffix(" end")}:
                raise ValueError(f"{name}: a line of {count} fields at offset {rows[at][0]}")
            yield name, fields[0][0], sum(row[1] for row in fields), _text(fields, remark)
            at += count
    if at != len(rows):
        raise ValueError(f"{rows[at][2]} is in no line")


def _text(fields: list[Row], remark: str) -> str:
    """``path: field value, field value (remark)``: the part of the path that all share is said once."""
    paths = [row[2].split(".")[1:] for row in fields]
    shared = 0
    while all(len(path) > shared + 1 and path[shared] == paths[0][shared] for path in paths):
        shared += 1
    named = [f"{'.'.join(path[shared:])} {row[3]}" for path, row in zip(paths, fields, strict=True)]
    head = ".".join(paths[0][:shared])
    return (f"{head}: " if head else "") + ", ".join(named) + (f" ({remark})" if remark else "")


def tour_text(data: bytes) -> str:
    """The lines as SPEC.md prints them: offset, bytes, fields, in a code block."""
    out, last = ["```"], ""
    for name, offset, size, text in tour_rows(data):
        if name != last:
            out += ["", _TOUR[name][0]] if last else [_TOUR[name][0]]
            last = name
        shown = data[offset : offset + size]
        first, *others = table_rows(shown) if name.endswith("TABLES") else (text,)
        shown = shown[:_SHOWN_BYTES]
        bytes_ = [shown[i : i + _LINE_BYTES].hex(" ") for i in range(0, len(shown), _LINE_BYTES)]
        bytes_[-1] += " .." if size > _SHOWN_BYTES else ""
        margin = 4 + 2 + 3 * _LINE_BYTES + 2
        words = textwrap.wrap(first, _WIDTH - margin)
        for i in range(max(len(bytes_), len(words))):
            left = f"{offset if i == 0 else '':>4}  {bytes_[i] if i < len(bytes_) else ''}"
            out.append(f"{left:{margin}}{words[i] if i < len(words) else ''}".rstrip())
        for line in others:
            out += textwrap.wrap(line, _WIDTH, initial_indent=" " * 6, subsequent_indent=" " * 8)
    return "\n".join([*out, "```", ""])
