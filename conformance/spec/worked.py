"""The worked file of SPEC.md §4: every byte named, one rANS stream traced, the decoded values listed."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

from conformance.decoders.python.answers import Answers
from conformance.decoders.python.decoder import Decoder
from conformance.decoders.python.fields import Rans, key
from conformance.decoders.python.models import parse_tables
from conformance.decoders.python.numbers import Numbers
from conformance.expect.expectations import decoded_arrays
from conformance.scenes.made import worked_scene
from conformance.surgery.files import substream_bytes
from conformance.writer.file import write_file
from scarfmt.container.schema import Stream
from scarfmt.container.source import BytesSource
from scarfmt.tools.dump import Dump

Row = tuple[int, int, str, str]


def worked_file() -> bytes:
    """The bytes of the file."""
    return write_file(worked_scene())


def field_rows(data: bytes) -> list[Row]:
    """(offset, size, field, value) of every field, in file order, without gaps: what `scarfmt dump` prints, without the
    numbers of TABLES blocks."""
    rows = Dump(BytesSource(data), full=True).rows()
    return [(row.offset, row.length, row.field, str(row.value)) for row in rows if not row.content]


def table_rows(block: bytes) -> Iterator[str]:
    """The state with which decoding of a TABLES block begins; then, for each table, its numbers and what they say."""
    yield f"state 0x{Rans(block, {}).state:X}, numbers of 0 or more:"
    read = Numbers(block)
    tables = parse_tables(read)
    (_, count), *numbers = read.taken
    yield f"table_count {count}"
    for number, (values, weights) in tables.items():
        # 4 of the key; more and first; gaps, precision and weights.
        size = 6 if len(values) == 1 else 6 + 2 * len(values)
        sent, numbers = numbers[:size], numbers[size:]
        fields = itertools.groupby(sent, lambda one: one[0][0])
        listed = ", ".join(" ".join([str(name), *(str(n) for _, n in part)]) for name, part in fields)
        codes = f"{' '.join(map(str, values))} with weights {' '.join(map(str, weights))}"
        yield f"{listed}: {_key_text(number)} codes {codes}"


def _key_text(number: int) -> str:
    return f"({Stream(number >> 24).name}, {number >> 16 & 255}, {number >> 8 & 255}, {number & 255})"


def rans_trace(data: bytes) -> list[tuple[str, int, int, int, int]]:
    """(table, state before, slot, symbol, value) of every symbol of SCALE in layer 2, as SPEC §8.2 reads."""
    tables = Decoder(data, 2).tables[1]
    start, past = substream_bytes(data, Stream.SCALE, 2)
    rans, rows = Rans(data[start:past], tables), []
    for number, count in _scale_groups():
        values = tables[number].values
        for _ in range(count):
            state, slot = rans.state, rans.slot() if len(values) > 1 else -1
            value = rans.symbol(tables[number])
            rows.append((_key_text(number), state, slot, values.index(value), value))
    rans.seal()
    return rows


def _scale_groups() -> list[tuple[int, int]]:
    """The groups of SCALE in layer 2: step 1 of anchor 2, then step 2 of anchors 0 and 1, component by component.

    All values refined are -2 or less.
    """
    first = [(component, 1, 0, 1) for component in range(3)]
    then = [(component, 2, 0, 2) for component in range(3)]
    return [(key(Stream.SCALE, c, step, context), count) for c, step, context, count in first + then]


def rans_text(data: bytes) -> str:
    """The trace as SPEC.md prints it."""
    lines = ["| table | state | slot | symbol | value |", "|---|---|---|---:|---:|"]
    for table, state, slot, symbol, value in rans_trace(data):
        shown = "nothing is read" if slot < 0 else f"0x{slot:06X}"
        lines.append(f"| {table} | 0x{state:X} | {shown} | {symbol} | {value} |")
    return "\n".join([*lines, "| end | 0x0 | | | |", ""])


def value_rows() -> list[dict[str, str]]:
    """One row for each anchor and layer decoded to; numbers as text that distinguishes them from their neighbours."""
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
    return rows


def value_text() -> str:
    """The decoded values as SPEC.md prints them."""
    rows = value_rows()
    lines = ["| " + " | ".join(rows[0]) + " |", "|---:" * len(rows[0]) + "|"]
    return "\n".join([*lines, *("| " + " | ".join(row.values()) + " |" for row in rows), ""])
