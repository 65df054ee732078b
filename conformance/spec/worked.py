"""The worked file of SPEC.md, appendix B: every byte named, one rANS stream traced, the decoded values listed."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

import numpy as np

from conformance.expect.expectations import expected_layers
from conformance.scenes.made import worked_scene
from conformance.surgery.files import substream_bytes, vector_file
from scarfmt.blocks.tables import unpack_tables
from scarfmt.container.bytefields import decompress
from scarfmt.container.file import Container, Entry
from scarfmt.container.schema import (
    DIRECTORY_ENTRY,
    FILE_HEADER,
    HEADER_CHECKSUM,
    LAYER_SUMMARY,
    SUBSTREAM_RECORD,
    TILE_RECORD,
    BlockKind,
    Stream,
    field_table,
)
from scarfmt.container.source import BytesSource
from scarfmt.container.substreams import unpack_table
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_tables import SymbolTable

Row = tuple[int, int, str, str]
_SHOWN_BYTES = 13


def worked_file() -> bytes:
    """The bytes of the file."""
    return vector_file(worked_scene())


def hex_dump(data: bytes) -> str:
    """Sixteen bytes a line after their offset, in a code block."""
    lines = [f"{start:04x}  {data[start : start + 16].hex(' ')}" for start in range(0, len(data), 16)]
    return "\n".join(["```", *lines, "```", ""])


class _Walk:
    """A cursor that notes what it passes."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.at = 0
        self.rows: list[Row] = []

    def note(self, size: int, field: str, value: object) -> None:
        self.rows.append((self.at, size, field, str(value)))
        self.at += size

    def structure(self, structure: Any, name: str) -> Any:
        parsed = structure.parse(self.data[self.at :])
        for row in field_table(structure):
            value = parsed[row.name]
            shown = list(value) if isinstance(value, list) else value
            if row.name.endswith("crc32") or (row.name == "tile" and value > 0xFFFF):
                shown = f"0x{value:08X}"
            self.note(row.size, f"{name}.{row.name}", "" if isinstance(value, bytes) else shown)
        return parsed

    def u8(self, field: str) -> int:
        value = self.data[self.at]
        self.note(1, field, value)
        return value

    def f64(self, field: str) -> None:
        self.note(8, field, struct.unpack_from("<d", self.data, self.at)[0])

    def varint(self, field: str, show: Callable[[int], object] = lambda value: value) -> int:
        size = value = 0
        while True:
            byte = self.data[self.at + size]
            value |= (byte & 0x7F) << (7 * size)
            size += 1
            if byte < 0x80:
                self.note(size, field, show(value))
                return value

    def svarint(self, field: str) -> int:
        mapped = self.varint(field, lambda m: m >> 1 if m % 2 == 0 else -(m >> 1) - 1)
        return mapped >> 1 if mapped % 2 == 0 else -(mapped >> 1) - 1


def field_rows(data: bytes) -> list[Row]:
    """(offset, size, field, value) of every field, in file order, without gaps."""
    walk = _Walk(data)
    header = walk.structure(FILE_HEADER, "header")
    for layer in range(1, header.layer_count + 1):
        walk.structure(LAYER_SUMMARY, f"summary {layer}")
    walk.structure(HEADER_CHECKSUM, "header")
    for tile in range(header.tile_count):
        walk.structure(TILE_RECORD, f"tile {tile}")
    for entry in range(header.entry_count):
        walk.structure(DIRECTORY_ENTRY, f"entry {entry}")
    channels: list[int] = []
    for block in Container.open(BytesSource(data)).entries:
        assert block.offset == walk.at
        {BlockKind.LAYER: _layer, BlockKind.TABLES: _tables, BlockKind.TILE: _tile}[BlockKind(block.kind)](
            walk, block, channels
        )
    assert walk.at == len(data)
    return walk.rows


def _layer(walk: _Walk, block: Entry, channels: list[int]) -> None:
    name = f"LAYER {block.layer}"
    walk.u8(f"{name} entropy_mode")
    if block.layer == 1:
        for _ in range(walk.varint(f"{name} channel_count")):
            channels.append(walk.u8(f"{name} stream"))
            stream = Stream(channels[-1]).name
            for component in range(walk.u8(f"{name} {stream} components")):
                place = f"{name} {stream}[{component}]"
                walk.f64(f"{place} first_width")
                for field in ("by_class", "source_channel", "source_component", "shift"):
                    walk.u8(f"{place} {field}")
                walk.svarint(f"{place} low")
        walk.u8(f"{name} passes_log2")
        for depth in range(walk.varint(f"{name} target_count")):
            walk.varint(f"{name} occupancy target {depth}")
    for number in range(walk.varint(f"{name} class_count")):
        walk.u8(f"{name} class {number} stages")
        for channel in channels:
            walk.u8(f"{name} class {number} steps of {Stream(channel).name}")


def _tables(walk: _Walk, block: Entry, _channels: list[int]) -> None:
    name = f"TABLES {block.layer}"
    walk.note(4, f"{name} Zstandard magic", "")
    descriptor = walk.u8(f"{name} frame header descriptor")
    size = {0x20: 1, 0x60: 2}[descriptor]
    content = int.from_bytes(walk.data[walk.at : walk.at + size], "little") + 256 * (size - 1)
    walk.note(size, f"{name} content size", content)
    walk.note(3, f"{name} block header: last, raw, size", content)
    for _ in range(walk.varint(f"{name} table_count")):
        key = walk.varint(f"{name} key", lambda number: _key_text(TableKey.from_number(number)))
        place = f"{name} {_key_text(TableKey.from_number(key))}"
        symbols = walk.varint(f"{place} size")
        value = walk.svarint(f"{place} first")
        for _ in range(symbols - 1):
            walk.varint(f"{place} gap")
        for _ in range(symbols):
            walk.varint(f"{place} weight")
        assert isinstance(value, int)


def _key_text(key: TableKey) -> str:
    return f"({Stream(key.stream).name}, {key.component}, {key.step}, {key.context})"


def _tile(walk: _Walk, block: Entry, _channels: list[int]) -> None:
    name = f"TILE {block.layer}"
    start = walk.at
    table = unpack_table(walk.data[start : start + block.length], block.length)
    walk.u8(f"{name} record_count")
    for kind in table:
        walk.structure(SUBSTREAM_RECORD, f"{name} {kind.name}")
    walk.note(4, f"{name} table_crc32", f"0x{int.from_bytes(walk.data[walk.at : walk.at + 4], 'little'):08X}")
    for kind, part in table.items():
        words = np.frombuffer(walk.data[walk.at : walk.at + part.length], "<u4").tolist()
        walk.note(part.length, f"{name} {kind.name} words", ", ".join(f"0x{word:08X}" for word in words))


def field_table_text(data: bytes) -> str:
    """The rows as SPEC.md prints them."""
    lines = ["| offset | size | bytes | field | value |", "|---:|---:|---|---|---|"]
    for offset, size, field, value in field_rows(data):
        shown = data[offset : offset + size][:_SHOWN_BYTES].hex(" ") + (" ..." if size > _SHOWN_BYTES else "")
        lines.append(f"| {offset} | {size} | `{shown}` | {field} | {value} |")
    return "\n".join(lines) + "\n"


def rans_trace(data: bytes) -> list[tuple[str, int, int, int, int]]:
    """(table, state before, slot, symbol, value) of every symbol of SCALE in layer 2, as SPEC §8.2 reads."""
    container = Container.open(BytesSource(data))
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

    Component 1 has component 0, here -3, as its source with low -4; all values refined are -2 or less.
    """
    first = [(component, 1, 1 if component == 1 else 0, 1) for component in range(3)]
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
    """One row an anchor and layer decoded to, numbers as text that tells them from their neighbours."""
    rows = []
    for layer, arrays in enumerate(expected_layers(worked_scene()), start=1):
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
