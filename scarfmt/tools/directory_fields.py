"""The fields of ROOT and of pages as rows: what `scarfmt dump` prints of the directory (SPEC §5.4, §5.5).

What is shown was read and checked before: nothing is checked here.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from scarfmt.container.bytefields import ByteReader
from scarfmt.container.header import Header
from scarfmt.container.registries import BlockKind
from scarfmt.tools.fields import SHOWN_ITEMS, Row, shown


class _Walk:
    """Reads a structure field by field, and notes a row for each."""

    def __init__(self, data: bytes, section: str, full: bool) -> None:
        self._reader = ByteReader(data, "directory")
        self._section, self._full = section, full
        self._start = 0
        self.rows: list[Row] = []

    def unsigned(self, name: str, bits: int) -> int:
        """A varint."""
        return self._noted(name, self._reader.unsigned(bits))

    def kind(self, name: str) -> None:
        """A block kind, with its name if it has one."""
        kind = self._reader.take(1)[0]
        self._noted(name, kind, f"{kind} {BlockKind(kind).name}" if kind in set(BlockKind) else kind)

    def u8(self, name: str) -> None:
        """A u8."""
        self._noted(name, self._reader.take(1)[0])

    def crc32(self, name: str) -> None:
        """A checksum."""
        value = self._reader.u32()
        self._noted(name, value, f"0x{value:08X}")

    def array(self, name: str, dtype: str, count: int) -> None:
        """Numbers of fixed width."""
        self._noted(name, 0, shown(self._reader.array(dtype, count), self._full))

    def varints(self, name: str, bits: int, count: int) -> int:
        """Varints; how many of them are not 0."""
        values = self._reader.unsigned_array(bits, count)
        return self._noted(name, int(np.count_nonzero(values)), shown(values, self._full))

    def rest(self, name: str, value: str) -> None:
        """One row for all that is left."""
        self._reader.skip()
        self._noted(name, 0, value)

    def _noted(self, name: str, value: int, text: object = None) -> int:
        past = self._reader.position
        if past > self._start:
            self.rows.append(Row(self._start, past - self._start, name, value if text is None else text, self._section))
        self._start = past
        return value


def root_rows(data: bytes, header: Header, full: bool) -> list[Row]:
    """The fields of ROOT; of pages the first few, unless `full`."""
    walk = _Walk(data, "5.4", full)
    number = 0
    for layer in range(1, header.layer_count + 1):
        for _ in range(walk.unsigned(f"root.layer {layer}.blocks", 8)):
            name = f"root.entry {number}"
            walk.kind(f"{name}.kind")
            walk.u8(f"{name}.flags")
            walk.unsigned(f"{name}.length", 53)
            walk.unsigned(f"{name}.count", 32)
            walk.crc32(f"{name}.crc32")
            number += 1
    each = header.page_count if full else min(header.page_count, SHOWN_ITEMS)
    for page in range(each):
        _page(walk, page, header.layer_count)
    if each < header.page_count:
        walk.rest(f"root.page {each}..{header.page_count - 1}", f"{header.page_count - each} more")
    return walk.rows


def _page(walk: _Walk, page: int, layers: int) -> None:
    name = f"root.page {page}"
    walk.unsigned(f"{name}.gap", 63)
    walk.unsigned(f"{name}.tile_bytes", 32)
    walk.crc32(f"{name}.tile_crc32")
    for layer in range(1, layers + 1):
        if walk.unsigned(f"{name}.layer {layer}.row_bytes", 32):
            walk.crc32(f"{name}.layer {layer}.row_crc32")
            walk.unsigned(f"{name}.layer {layer}.block_bytes", 53)
            walk.unsigned(f"{name}.layer {layer}.anchors", 53)


def tile_page_rows(data: bytes, page: int, header: Header, full: bool) -> Iterator[Row]:
    """The fields of a tile page."""
    walk, count, name = _Walk(data, "5.5", full), len(header.page_range(page)), f"tile page {page}"
    walk.array(f"{name}.depth", "u1", count)
    walk.array(f"{name}.shift", "u1", count)
    walk.varints(f"{name}.gap", 63, count)
    yield from walk.rows


def row_page_rows(data: bytes, layer: int, page: int, header: Header, full: bool) -> Iterator[Row]:
    """The fields of a row page."""
    walk, count, name = _Walk(data, "5.5", full), len(header.page_range(page)), f"layer {layer} row page {page}"
    present = walk.varints(f"{name}.length", 53, count)
    walk.varints(f"{name}.count", 32, present)
    walk.array(f"{name}.crc32", "<u4", present)
    yield from walk.rows
