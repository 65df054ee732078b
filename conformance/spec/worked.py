"""The worked file of SPEC.md §4: every byte named, one rANS stream traced, the decoded values listed."""

from __future__ import annotations

import numpy as np

from conformance.decoders.python.answers import Answers
from conformance.decoders.python.decoder import Decoder
from conformance.expect.expectations import decoded_arrays
from conformance.scenes.made import worked_scene
from conformance.surgery.files import substream_bytes, vector_file
from scarfmt.blocks.tables import unpack_tables
from scarfmt.container.bytefields import decompress
from scarfmt.container.file import Container
from scarfmt.container.schema import (
    BlockKind,
    Stream,
)
from scarfmt.container.source import BytesSource
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.tools.dump import Dump

Row = tuple[int, int, str, str]


def worked_file() -> bytes:
    """The bytes of the file."""
    return vector_file(worked_scene())


def field_rows(data: bytes) -> list[Row]:
    """(offset, size, field, value) of every field, in file order, without gaps: what `scarfmt dump` prints.

    Frames hold their content as it is, so that fields of the content take the place of the frame's data.
    """
    out: list[Row] = []
    content = 0
    for row in Dump(BytesSource(data), full=True).rows():
        if row.field.endswith(".data"):
            content = row.offset
            continue
        offset = content + row.offset if row.content else row.offset
        out.append((offset, row.length, row.field, str(row.value)))
    return out


def _key_text(key: TableKey) -> str:
    return f"({Stream(key.stream).name}, {key.component}, {key.step}, {key.context})"


def rans_trace(data: bytes) -> list[tuple[str, int, int, int, int]]:
    """(table, state before, slot, symbol, value) of every symbol of SCALE in layer 2, as SPEC §8.2 reads."""
    container = Container(BytesSource(data))
    tables: dict[TableKey, SymbolTable] = {}
    for layer in (1, 2):
        block = container.find(BlockKind.TABLES, layer)
        assert block is not None
        tables |= unpack_tables(decompress(container.read_block(block), 1 << 20, "tables"))
    start, past = substream_bytes(data, Stream.SCALE, 2)
    words = np.frombuffer(data[start:past], "<u4").tolist()
    state, rows = 0, []
    for _ in range(2):
        state = state << 32 | words.pop() if words else state
    for key, count in _scale_groups():
        entry = tables[key]
        cumulative = entry.table.cumulative.tolist()
        for _ in range(count):
            if len(entry.alphabet) == 1:
                rows.append((_key_text(key), state, -1, 0, int(entry.alphabet[0])))
                continue
            slot = state & 0xFFFFFF
            symbol = max(i for i, c in enumerate(cumulative[:-1]) if c <= slot)
            rows.append((_key_text(key), state, slot, symbol, int(entry.alphabet[symbol])))
            state = (cumulative[symbol + 1] - cumulative[symbol]) * (state >> 24) + slot - cumulative[symbol]
            if state < 1 << 32 and words:
                state = state << 32 | words.pop()
    assert not state
    assert not words
    return rows


def _scale_groups() -> list[tuple[TableKey, int]]:
    """The groups of SCALE in layer 2: step 1 of anchor 2, then step 2 of anchors 0 and 1, component by component.

    All values refined are -2 or less.
    """
    first = [(component, 1, 0, 1) for component in range(3)]
    then = [(component, 2, 0, 2) for component in range(3)]
    return [(TableKey(Stream.SCALE, c, step, context), count) for c, step, context, count in first + then]


def rans_text(data: bytes) -> str:
    """The trace as SPEC.md prints it."""
    lines = ["| table | state | slot | symbol | value |", "|---|---|---|---:|---:|"]
    for key, state, slot, symbol, value in rans_trace(data):
        shown = "nothing is read" if slot < 0 else f"0x{slot:06X}"
        lines.append(f"| {key} | 0x{state:X} | {shown} | {symbol} | {value} |")
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
