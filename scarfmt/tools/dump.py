"""Every byte of a file, annotated: where it lies, what it is, what it says, which section describes it.

Damaged files are annotated as far as they go; what is refused on the way is kept. Symbols inside sub-streams are not
decoded: whether those are sound is a question for :func:`scarfmt.tools.validate.validate`.
"""

from __future__ import annotations

import zlib
from collections.abc import Collection, Iterator
from dataclasses import replace
from enum import IntEnum
from functools import partial
from typing import Any

from scarfmt.blocks.declare import NumberRecord, Record, read
from scarfmt.blocks.registry import BLOCKS
from scarfmt.blocks.spec import BlockSpec, Reading
from scarfmt.coding.models import NOTHING_OPENED
from scarfmt.coding.work import NumberBudget
from scarfmt.container.directory import block_name, total
from scarfmt.container.file import Container, Entry, check_crc
from scarfmt.container.registries import BlockKind, ColourSpace, CoordinateFrame, Profile, RenderModel, Stream
from scarfmt.container.schema import (
    FILE_HEADER,
    FILE_HEADER_SIZE,
    HEADER_CHECKSUM,
    LAYER_SUMMARY,
    SUBSTREAM_RECORD,
    field_table,
)
from scarfmt.container.source import ByteSource
from scarfmt.container.substreams import RECORD_SIZE, check_substream, unpack_table
from scarfmt.errors import ScarError
from scarfmt.limits import DEFAULT_LIMITS
from scarfmt.tools.directory_fields import ROOT, ROW_PAGE, TILE_PAGE
from scarfmt.tools.fields import SHOWN_ITEMS, FieldRows, Row, move, rest, show
from scarfmt.tools.validate import open_damaged

_NAMED: dict[str, type[IntEnum]] = {
    "profile": Profile,
    "coordinate_frame": CoordinateFrame,
    "colour_space": ColourSpace,
    "render_model": RenderModel,
    "stream": Stream,
}
"""Fields of the container whose numbers have names."""

_STATE_BYTES = 8
"""A sub-stream's last two words are the state that decoding starts with."""


class Dump:
    """The annotation of one file.

    Args:
        source: the file, whole, cut or damaged.
        full: every item and number, however many.
        kinds: only blocks of these kinds, and no header; None for everything.

    Attributes:
        refusals: what was refused on the way; complete when :meth:`rows` is at its end.
    """

    def __init__(self, source: ByteSource, *, full: bool = False, kinds: Collection[int] | None = None) -> None:
        self.refusals: list[ScarError] = []
        self._source, self._full, self._kinds = source, full, kinds
        self._opening = NOTHING_OPENED

    def rows(self) -> Iterator[Row]:
        """All rows in file order, without gaps; those of adaptive numbers after that of their bytes."""
        size = self._source.size
        container = open_damaged(self._source, self.refusals.append, DEFAULT_LIMITS)
        past = size
        if container is None:
            yield from self._choose(self._front(min(size, FILE_HEADER_SIZE)))
            past = min(size, FILE_HEADER_SIZE)
        else:
            header = container.header
            yield from self._choose(self._front(min(size, header.header_length)))
            past = min(size, header.header_length)
            if self._loads(container):
                yield from self._choose(self._directory(container))
                yield from self._blocks(container)
                past = min(size, header.file_length)
        if past < size:
            yield from self._choose(iter([Row(past, size - past, "not read", "", "5")]))

    def _choose(self, rows: Iterator[Row]) -> Iterator[Row]:
        return rows if self._kinds is None else iter(())

    def _loads(self, container: Container) -> bool:
        try:
            container.load()
        except ScarError as error:
            self.refusals.append(error)
            return False
        return True

    def _front(self, length: int) -> Iterator[Row]:
        """The first `length` bytes: header, layer summaries, checksum."""
        data = self._source.read(0, length)
        rows = list(_structure(FILE_HEADER, "header", "5.2", data, 0))
        summaries = max(0, (length - FILE_HEADER_SIZE) // LAYER_SUMMARY.sizeof())
        for layer in range(1, summaries + 1):
            at = FILE_HEADER_SIZE + (layer - 1) * LAYER_SUMMARY.sizeof()
            rows += _structure(LAYER_SUMMARY, f"summary {layer}", "5.3", data, at)
        at = FILE_HEADER_SIZE + summaries * LAYER_SUMMARY.sizeof()
        if length > FILE_HEADER_SIZE:
            rows += _structure(HEADER_CHECKSUM, "header", "5.2", data, at)
        return rest(rows, length, "header", "5.2")

    def _directory(self, container: Container) -> Iterator[Row]:
        """ROOT and pages; of many pages the first few, unless all are wanted."""
        header, root = container.header, container.root
        sizes = {"layer_count": header.layer_count, "page_count": header.page_count}
        yield from self._list_fields(ROOT, header.header_length, header.root_length, "root", "5.4", **sizes)
        for table, size, kind, record in (
            (root.pages, "tile_bytes", "tile page", TILE_PAGE),
            (root.rows, "row_bytes", "row page", ROW_PAGE),
        ):
            each = len(table) if self._full else min(len(table), SHOWN_ITEMS)
            for number, page in enumerate(table[:each]):
                layer, number = ("", number) if kind == "tile page" else (f"layer {page['layer']} ", int(page["page"]))
                tiles = len(header.page_range(number))
                place = int(page["offset"]), int(page[size])
                yield from self._list_fields(record, *place, f"{layer}{kind} {number}", "5.5", tiles=tiles)
            if each < len(table):
                left = table[each:]
                yield Row(int(left["offset"][0]), total(left[size]), f"{kind}s: {len(left)} more", "", "5.5")

    def _list_fields(
        self, record: Record, offset: int, length: int, name: str, section: str, **parameters: Any
    ) -> Iterator[Row]:
        """The fields of some bytes of the file that are known to be sound."""
        trace = FieldRows(name, section, self._full)
        read(record, self._source.read(offset, length), name, trace, **parameters)
        return move(trace.rows, offset)

    def _blocks(self, container: Container) -> Iterator[Row]:
        budget = NumberBudget(container.header.file_length, DEFAULT_LIMITS)
        seen: dict[int, int] = {}
        held: list[Row] = []
        for entry in container.entries:
            seen[entry.layer] = seen.get(entry.layer, 0) + (entry.kind == BlockKind.TILE)
            rows = self._block(container, entry, budget)
            if entry.kind == BlockKind.TILE and seen[entry.layer] > SHOWN_ITEMS and not self._full:
                # Its rows are not shown, but what is refused is.
                for _ in rows:
                    pass
                held.append(Row(entry.offset, entry.length, block_name(entry), "", "7.1"))
                continue
            yield from self._merge(held)
            held = []
            if self._kinds is None or entry.kind in self._kinds:
                yield from rows
            else:
                for _ in rows:
                    pass
        yield from self._merge(held)

    def _merge(self, held: list[Row]) -> Iterator[Row]:
        """One row for neighbouring blocks that are not shown one by one."""
        if held and (self._kinds is None or BlockKind.TILE in self._kinds):
            start = held[0].offset
            name = held[0].field if len(held) == 1 else f"{held[0].field} to {held[-1].field}"
            length = min(sum(row.length for row in held), self._source.size - start)
            if length > 0:
                yield Row(start, length, name, f"{len(held)} blocks", "7.1")

    def _block(self, container: Container, entry: Entry, budget: NumberBudget) -> Iterator[Row]:
        present = min(entry.length, self._source.size - entry.offset)
        if present <= 0:
            return
        name = block_name(entry)
        try:
            payload = container.read_block(entry, verify=False)
        except ScarError as error:
            self.refusals.append(error)
            yield Row(entry.offset, present, f"{name}: not whole", "", "5.6")
            return
        self._attempt(entry, lambda: check_crc(entry, zlib.crc32(payload)))
        spec = BLOCKS.get(entry.kind)
        if entry.kind == BlockKind.TILE:
            rows = self._tile(entry, payload, name)
        elif spec is None:
            rows = iter([Row(0, len(payload), name, show(payload, self._full), "5.6")])
        elif isinstance(spec.declaration, NumberRecord):
            rows = self._numbers(entry, payload, spec, budget)
        else:
            rows = self._fields(entry, payload, spec, budget)
        yield from move(rows, entry.offset)

    def _numbers(self, entry: Entry, payload: bytes, spec: BlockSpec, budget: NumberBudget) -> Iterator[Row]:
        """A row for the stream, then those of its numbers."""
        yield Row(0, len(payload), f"{block_name(entry)}.numbers", show(payload, self._full), "8.5")
        rows = self._fields(entry, payload, spec, budget)
        yield from (replace(row, content=True) for row in rows)

    def _fields(self, entry: Entry, payload: bytes, spec: BlockSpec, budget: NumberBudget) -> Iterator[Row]:
        """Rows of what is declared, and what reading it refuses."""
        name = block_name(entry)
        reading = Reading(entry.layer, self._opening, budget.spend)
        trace = FieldRows(name, spec.section, self._full)

        def parse() -> None:
            parameters = spec.parameters(payload, reading)
            read(spec.declaration, payload, name, trace, budget.spend, **parameters)
            value = spec.parse(payload, replace(reading, spend=lambda count: True))
            if entry.kind == BlockKind.LAYER:
                self._opening = value[1]

        self._attempt(entry, parse)
        trace.close()
        whole = isinstance(spec.declaration, NumberRecord)
        return iter(trace.rows) if whole else rest(trace.rows, len(payload), name, spec.section)

    def _tile(self, entry: Entry, payload: bytes, name: str) -> Iterator[Row]:
        """Table of sub-streams, and each as its words and the state that decoding starts with."""
        count = payload[0]
        end = 1 + RECORD_SIZE * count
        rows = [Row(0, 1, f"{name}.record_count", count, "7.1")]
        for number in range((min(len(payload), end) - 1) // RECORD_SIZE):
            at = 1 + number * RECORD_SIZE
            rows += _structure(SUBSTREAM_RECORD, f"{name}.record[{number}]", "7.1", payload, at)
        if len(payload) >= end + 4:
            crc = int.from_bytes(payload[end : end + 4], "little")
            rows.append(Row(end, 4, f"{name}.table_crc32", f"0x{crc:08X}", "7.1"))
        table = {}

        def parse() -> None:
            table.update(unpack_table(payload, len(payload)))

        if self._attempt(entry, parse):
            for kind, part in table.items():
                data = payload[part.start : part.start + part.length]
                self._attempt(entry, partial(check_substream, kind, part, data))
                rows += move(self._words(data, f"{name}.{kind.name}"), part.start)
        return rest(rows, len(payload), name, "7.1")

    def _words(self, data: bytes, name: str) -> Iterator[Row]:
        state = min(_STATE_BYTES, len(data))
        if len(data) > state:
            yield Row(0, len(data) - state, f"{name}.words", show(data[:-state], self._full), "8.2")
        yield Row(len(data) - state, state, f"{name}.state", f"0x{int.from_bytes(data[-state:], 'little'):X}", "8.2")

    def _attempt(self, entry: Entry, act: Any) -> bool:
        try:
            act()
        except ScarError as error:
            offset = entry.offset if error.offset is None else error.offset
            name = error.field or block_name(entry)
            self.refusals.append(type(error)(error.refusal, error.message, offset=offset, field=name))
            return False
        return True


def _structure(structure: Any, name: str, section: str, data: bytes, at: int) -> Iterator[Row]:
    """The fields of a structure of the container at `at`, those that are there as a whole."""
    for row in field_table(structure):
        start = at + row.offset
        if start + row.size > len(data):
            return
        member = next(each for each in structure.subcons if each.name == row.name)
        value = member.parse(data[start : start + row.size])
        if isinstance(value, bytes):
            value = value.hex(" ")
        elif isinstance(value, list):
            value = " ".join(map(str, value))
        elif row.name in _NAMED and value in set(_NAMED[row.name]):
            value = f"{value} {_NAMED[row.name](value).name}"
        elif row.name.endswith("crc32"):
            value = f"0x{value:08X}"
        yield Row(start, row.size, f"{name}.{row.name}", value, section)
