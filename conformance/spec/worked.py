"""The worked file of SPEC.md §4: every byte named, one rANS stream traced, the decoded values listed."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Iterable, Iterator

import numpy as np

from conformance.decoders.python.answers import Answers
from conformance.decoders.python.decoder import Decoder
from conformance.decoders.python.fields import Rans, key
from conformance.decoders.python.models import Channel, Opening, parse_layer, parse_tables
from conformance.decoders.python.numbers import Field, Numbers
from conformance.expect.expectations import decoded_arrays
from conformance.scenes.made import worked_scene
from conformance.surgery.files import substream_bytes
from conformance.writer.file import write_file
from scarfmt.container.schema import Stream
from scarfmt.container.source import BytesSource
from scarfmt.tools.dump import Dump

Row = tuple[int, int, str, str]
"""Offset, size, field, value."""
_Lines = tuple[int | tuple[int, str], ...]
"""How many fields each line takes, and perhaps a remark."""
_TILE: _Lines = (1, 3, 3, 1)
_SUMMARY: _Lines = (
    (2, "cumulative"), (2, "so its blocks are the byte_count bytes before end_offset"),
    (1, "of kinds 0..12; 0: models, 1: POSITIONS, 5: SCALE, 12: framing"),
)  # fmt: skip
_TOUR: dict[str, tuple[str, _Lines]] = {
    "header": ("FILE_HEADER (5.2)", (
        1, 3, (1, "104 + 136 * 2 layers"), 1, 8, 2, 2, (1, "three f64"), (1, "a lattice step is 0.25 long"), 1,
        (1, "it covers ROOT, as the CRC at the end of the header covers this"))),
    "summary 1": ("LAYER_SUMMARY of layer 1 (5.3)", _SUMMARY),
    "summary 2": ("LAYER_SUMMARY of layer 2", (2, 2, 1)),
    "header end": ("HEADER_CHECKSUM", (1,)),
    "root": ("ROOT (5.4)", (
        (1, "that belong to no tile"), 5, 5, 1, 5, 5,
        (1, "5 << 60: the cube of the first tile has depth 1 and prefix 5"), 2, 4, 4)),
    "tile page 0": ("tile page 0 (5.5): the only tile, half the lattice wide", (3,)),
    "layer 1 row page 0": ("row page of layer 1", ((3, "count: two anchors appear"),)),
    "layer 2 row page 0": ("row page of layer 2", ((3, "one anchor appears"),)),
    "layer 1 LAYER": ("LAYER of layer 1 (7.11): a rANS stream of adaptive numbers (8.5)", (1,)),
    "layer 1 TABLES": ("TABLES of layer 1 (8.3): likewise", (1,)),
    "layer 1 TILE 0": ("TILE of layer 1 (7.1)", (
        *_TILE, (1, "two words of a rANS stream (8.2)"), (1, "OPACITY and CLASSES have no bytes"))),
    "layer 2 LAYER": ("LAYER of layer 2: a second step of SCALE for class 0, and a new class", (1,)),
    "layer 2 TABLES": ("TABLES of layer 2: the second step of SCALE, and a new table for the first of OPACITY", (1,)),
    "layer 2 TILE 0": ("TILE of layer 2", (*_TILE, 1, (1, "decoded in 4.3"))),
}  # fmt: skip
"""Structure -> what it is, and its lines."""
_LINE_BYTES, _SHOWN_BYTES, _WIDTH = 9, 27, 120


def worked_file() -> bytes:
    """The bytes of the file."""
    return write_file(worked_scene())


def table_rows(block: bytes) -> Iterator[str]:
    """The state with which decoding of a TABLES block begins; then, for each table, its numbers and what they say."""
    yield _state(block)
    read = Numbers(block)
    tables = parse_tables(read)
    (_, count), *numbers = read.taken
    yield f"table_count {count}"
    for number, (values, weights) in tables.items():
        # 4 of the key; more and first; gaps, precision and weights.
        size = 6 if len(values) == 1 else 6 + 2 * len(values)
        sent, numbers = numbers[:size], numbers[size:]
        codes = f"{' '.join(map(str, values))} with weights {' '.join(map(str, weights))}"
        yield f"{_list(sent)}: {_key_text(number)} codes {codes}"


def layer_rows(block: bytes, channels: int) -> Iterator[str]:
    """The state with which decoding of a LAYER block begins; then its numbers, a channel or class a line.

    Args:
        channels: of the channel table; 0 in layer 1, which has it.
    """
    yield _state(block)
    reader = Numbers(block)
    parse_layer(reader, 2 if channels else 1, Opening([Channel(0, [])] * channels, 0, []))
    row: list[tuple[Field, int]] = []
    for number in reader.taken:
        if number[0][0] in ("stream", "passes_log2", "stages"):
            yield _list(row)
            row = []
        row.append(number)
    yield _list(row)


def _state(block: bytes) -> str:
    return f"state 0x{Rans(block, {}).state:X}, numbers of 0 or more:"


def _list(numbers: list[tuple[Field, int]]) -> str:
    """``name number number, name number``; of first widths bits in hexadecimal digits, and what they stand for."""
    fields = itertools.groupby(numbers, lambda one: str(one[0][0]))
    out = []
    for name, part in fields:
        found = [number for _, number in part]
        widths = name == "first_widths"
        out.append(" ".join([name, *(f"{number:#x}" if widths else str(number) for number in found)]))
        if widths:
            bits = np.bitwise_xor.accumulate(np.array(found, np.uint32))
            out[-1] += f" ({' '.join(map(str, bits.view(np.float32)))})"
    return ", ".join(out)


def _key_text(number: int) -> str:
    return f"({Stream(number >> 24).name}, {number >> 16 & 255}, {number >> 8 & 255}, {number & 255})"


def tour_rows(data: bytes) -> Iterator[tuple[str, int, int, str]]:
    """(structure, offset, size, text) of every line, in file order, without gaps: what `scarfmt dump` prints, without
    the numbers of blocks of numbers.

    Raises:
        ValueError: a line would take fields of two structures, or fields are left: the tour is not of this file.
    """
    found = Dump(BytesSource(data), full=True).rows()
    rows = [(row.offset, row.length, row.field, str(row.value)) for row in found if not row.content]
    at = 0
    for name, (_, lines) in _TOUR.items():
        for line in lines:
            count, remark = line if isinstance(line, tuple) else (line, "")
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


def _rows(name: str, block: bytes, text: str) -> Iterable[str]:
    if name.endswith("TABLES"):
        return table_rows(block)
    return layer_rows(block, 2 if name == "layer 2 LAYER" else 0) if name.endswith("LAYER") else (text,)


def tour_text(data: bytes) -> str:
    """The lines as SPEC.md prints them: offset, bytes, fields, in a code block."""
    out, last = ["```"], ""
    for name, offset, size, text in tour_rows(data):
        if name != last:
            out += ["", _TOUR[name][0]] if last else [_TOUR[name][0]]
            last = name
        shown = data[offset : offset + size]
        first, *others = _rows(name, shown, text)
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


def rans_text(data: bytes) -> str:
    """Every symbol of SCALE in layer 2 as SPEC §8.2 reads it: table, the state before, slot, symbol and value."""
    tables = Decoder(data, 2).tables[1]
    start, past = substream_bytes(data, Stream.SCALE, 2)
    rans = Rans(data[start:past], tables)
    lines = ["| table | state | slot | symbol | value |", "|---|---|---|---:|---:|"]
    for number, count in _scale_groups():
        values = tables[number].values
        for _ in range(count):
            state, slot = rans.state, f"0x{rans.slot():06X}" if len(values) > 1 else "nothing is read"
            value = rans.symbol(tables[number])
            lines.append(f"| {_key_text(number)} | 0x{state:X} | {slot} | {values.index(value)} | {value} |")
    rans.seal()
    return "\n".join([*lines, "| end | 0x0 | | | |", ""])


def _scale_groups() -> list[tuple[int, int]]:
    """The groups of SCALE in layer 2: step 1 of anchor 2, then step 2 of anchors 0 and 1, component by component.

    All values refined are -2 or less.
    """
    first = [(component, 1, 0, 1) for component in range(3)]
    then = [(component, 2, 0, 2) for component in range(3)]
    return [(key(Stream.SCALE, c, step, context), count) for c, step, context, count in first + then]


def value_text() -> str:
    """The decoded values as SPEC.md prints them: a row for each anchor and layer decoded to.

    Numbers as text that distinguishes them from their neighbours.
    """
    rows = []
    for layer in (1, 2):
        arrays = decoded_arrays(Answers(Decoder(worked_file(), layer)))
        for anchor in range(len(arrays["code"])):
            rows.append(
                {
                    "layer": str(layer),
                    "anchor": str(anchor),
                    "class": str(arrays["class"][anchor]),
                    "code": str(arrays["code"][anchor]),
                    "position": ", ".join(repr(float(x)) for x in arrays["position"][anchor]),
                    "v of SCALE": ", ".join(str(x) for x in arrays["v.SCALE"][anchor]),
                    "SCALE": ", ".join(str(x) for x in arrays["value.SCALE"][anchor]),
                    "v of OPACITY": str(arrays["v.OPACITY"][anchor, 0]),
                    "OPACITY": str(arrays["value.OPACITY"][anchor, 0]),
                }
            )
    lines = ["| " + " | ".join(rows[0]) + " |", "|---:" * len(rows[0]) + "|"]
    return "\n".join([*lines, *("| " + " | ".join(row.values()) + " |" for row in rows), ""])
