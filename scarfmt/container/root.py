"""ROOT: the blocks that belong to no tile, and where the pages of tiles are (SPEC §5.4).

Written and read next to each other. :func:`unpack_root` applies the rules in the order of SPEC, each to all of ROOT
before the next, so that two readers refuse one file for the same reason.
"""

from __future__ import annotations

import zlib
from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import accumulate
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import I64
from scarfmt.container.bytefields import ByteReader, unsigned_varint
from scarfmt.container.header import Header
from scarfmt.container.schema import (
    ENTRY_DTYPE,
    FILE_HEADER_SIZE,
    LAYER_SUMMARY_SIZE,
    NO_TILE,
    BlockFlag,
    BlockKind,
    Stream,
)
from scarfmt.container.table_rules import Table, TableRules, total
from scarfmt.errors import LimitExceeded, Malformed, Unsupported
from scarfmt.limits import Limits

PAGE_DTYPE = np.dtype([("base", "<u8"), ("tile_bytes", "<u4"), ("tile_crc32", "<u4"), ("offset", "<u8")])
"""A page: Morton code at which it begins, and its tile page: bytes, checksum, absolute offset."""

ROW_PAGE_DTYPE = np.dtype(
    [
        ("layer", "u1"),
        ("page", "<u4"),
        ("row_bytes", "<u4"),
        ("row_crc32", "<u4"),
        ("block_bytes", "<u8"),
        ("anchors", "<u8"),
        ("offset", "<u8"),
        ("block_offset", "<u8"),
    ]
)
"""A row page: bytes, checksum, what its TILE blocks sum to, absolute offsets of itself and of the first of them."""

_TILE_BYTES = range(3, 12)
"""Bytes of a tile in a tile page."""
_LEAST_ROWS, _ROW_BYTES = 5, 17
"""Bytes of a row page beyond one a tile, if a single tile has a block; and maximum bytes of each tile in it."""


class PackedPage(NamedTuple):
    """A tile page to write.

    Attributes:
        base: Morton code at which its first tile begins.
        data: its bytes.
    """

    base: int
    data: bytes


class PackedRows(NamedTuple):
    """A row page to write: its bytes, and what its TILE blocks sum to."""

    data: bytes
    block_bytes: int
    anchors: int


@dataclass(frozen=True)
class Root:
    """The values of ROOT.

    Attributes:
        models: (E,) ENTRY_DTYPE of the blocks that belong to no tile, by layer and kind.
        pages: (P,) PAGE_DTYPE.
        rows: (R,) ROW_PAGE_DTYPE of the row pages that there are, by layer and page.
    """

    models: Table
    pages: Table
    rows: Table

    def row_page(self, layer: int, page: int) -> int | None:
        """The number in `rows` of a row page; None where page `page` has no TILE block in `layer`."""
        key = layer << 32 | page
        at = int(np.searchsorted(self._keys, key))
        return at if at < len(self._keys) and self._keys[at] == key else None

    @cached_property
    def _keys(self) -> I64:
        keys: I64 = self.rows["layer"].astype(np.int64) << 32 | self.rows["page"]
        return keys


def pack_root(
    layers: int, models: Table, pages: Sequence[PackedPage], rows: Sequence[Sequence[PackedRows | None]]
) -> bytes:
    """The bytes of ROOT.

    Args:
        layers: how many the file has.
        models: (E,) ENTRY_DTYPE of the blocks that belong to no tile, by layer; offsets do not matter.
        pages: tile pages.
        rows: by page, then layer, the row page, None where it has no TILE block.
    """
    out = bytearray()
    for layer in range(1, layers + 1):
        here = models[models["layer"] == layer]
        out += unsigned_varint(len(here))
        for kind, flags, _, _, _, length, count, crc32 in here.tolist():
            out += bytes([kind, flags]) + unsigned_varint(length) + unsigned_varint(count) + crc32.to_bytes(4, "little")
    before = 0
    for page, there in zip(pages, rows, strict=True):
        out += unsigned_varint(page.base - before) + _checked_part(page.data)
        before = page.base
        for row in there:
            if row is None:
                out.append(0)
            else:
                out += _checked_part(row.data) + unsigned_varint(row.block_bytes) + unsigned_varint(row.anchors)
    return bytes(out)


def _checked_part(data: bytes) -> bytes:
    return unsigned_varint(len(data)) + zlib.crc32(data).to_bytes(4, "little")


@dataclass
class _Read:
    """ROOT as it was read, column by column: an array takes a quarter of a list of numbers.

    Attributes:
        models, model_at: entries, and where each begins.
        gaps, tile_bytes, tile_crc32, page_at: of pages, and where each begins.
        layer, page, row_bytes, row_crc32, block_bytes, anchors: of row pages that there are, page by page.
    """

    models: list[tuple[int, ...]] = field(default_factory=list)
    model_at: array[int] = field(default_factory=lambda: array("q"))
    gaps: array[int] = field(default_factory=lambda: array("q"))
    tile_bytes: array[int] = field(default_factory=lambda: array("q"))
    tile_crc32: array[int] = field(default_factory=lambda: array("q"))
    page_at: array[int] = field(default_factory=lambda: array("q"))
    layer: array[int] = field(default_factory=lambda: array("B"))
    page: array[int] = field(default_factory=lambda: array("q"))
    row_bytes: array[int] = field(default_factory=lambda: array("q"))
    row_crc32: array[int] = field(default_factory=lambda: array("q"))
    block_bytes: array[int] = field(default_factory=lambda: array("q"))
    anchors: array[int] = field(default_factory=lambda: array("q"))


def _read(data: bytes, header: Header) -> _Read:
    """Read ROOT and check its structure, but not its values."""
    reader, out = ByteReader(data, "root"), _Read()
    for layer in range(1, header.layer_count + 1):
        for _ in range(reader.unsigned(8)):
            out.model_at.append(header.header_length + reader.position)
            kind, flags = reader.take(2)
            length, count = reader.unsigned(53), reader.unsigned(32)
            out.models.append((kind, flags, layer, NO_TILE, 0, length, count, reader.u32()))
    for page in range(header.page_count):
        out.page_at.append(header.header_length + reader.position)
        out.gaps.append(reader.unsigned(63))
        out.tile_bytes.append(reader.unsigned(32))
        out.tile_crc32.append(reader.u32())
        for layer in range(1, header.layer_count + 1):
            size = reader.unsigned(32)
            if size:
                out.layer.append(layer)
                out.page.append(page)
                out.row_bytes.append(size)
                out.row_crc32.append(reader.u32())
                out.block_bytes.append(reader.unsigned(53))
                out.anchors.append(reader.unsigned(53))
    reader.finish()
    return out


def unpack_root(data: bytes, header: Header, limits: Limits, readable: frozenset[int]) -> Root:
    """Parse and check ROOT.

    Args:
        data: its bytes.
        header: of the file.
        limits: what this reader accepts.
        readable: block kinds the caller understands; other critical kinds refuse the file.

    Raises:
        Malformed, Unsupported, LimitExceeded: a rule of SPEC §5.4 is broken.
    """
    if zlib.crc32(data) != header.root_crc32:
        message = "ROOT is damaged: get another copy"
        raise Malformed("directory-crc-mismatch", message, offset=header.header_length, field="root_crc32")
    try:
        read = _read(data, header)
    except Malformed as error:
        raise Malformed(error.refusal, error.message, offset=header.header_length, field="root") from error
    rules = TableRules(np.array(read.models, ENTRY_DTYPE), "root.entry", np.array(read.model_at, np.int64))
    _check_entries(rules, header, limits)
    pages = _pages(read)
    row_pages, places = _row_pages(read)
    _check_sizes(pages, row_pages, places, read, header)
    root = Root(rules.rows, pages, row_pages)
    _check_sums(root, header)
    _check_readable(rules, readable)
    _place(root, header)
    return root


def _check_entries(rules: TableRules, header: Header, limits: Limits) -> None:
    rows = rules.rows
    kind, flags, layer, length = rows["kind"], rows["flags"], rows["layer"], rows["length"]
    metadata = kind == BlockKind.METADATA
    rules.check((kind != 0) & (kind != BlockKind.TILE), "entry-kind", "kind", "neither kind 0 nor TILE stands in ROOT")
    rules.check(
        np.where(kind < BlockKind.TILE, flags == BlockFlag.CRITICAL, flags <= BlockFlag.SAFE_TO_COPY)
        & (~metadata | (flags == BlockFlag.SAFE_TO_COPY)),
        "entry-flags",
        "flags",
        "must be 1 for kinds 1..15, 2 for METADATA, and 0, 1 or 2 for others",
    )
    rules.check(~metadata | (layer == 1), "entry-layer", "layer", "must be 1 for METADATA")
    order = layer.astype(np.int64) << 8 | kind
    ascends = np.concatenate(([True], np.diff(order) > 0))[: len(rows)]
    rules.check(ascends, "entry-order", "kind", "the kinds of a layer must ascend")
    rules.check((length >= 1) & (length <= header.file_length), "entry-length", "length", "must be 1..file_length")
    rules.check(
        length <= limits.block_bytes,
        "limit-block-bytes",
        "length",
        f"exceeds this reader's limit of {limits.block_bytes}: raise it if you trust the file",
        LimitExceeded,
    )
    rules.check(~metadata | (rows["count"] == 0), "entry-count", "count", "must be 0 for METADATA")


def _pages(read: _Read) -> Table:
    """(P,) PAGE_DTYPE without offsets; R-5.4-11."""
    bases = list(accumulate(read.gaps))
    for page, (gap, base) in enumerate(zip(read.gaps, bases, strict=True)):
        if (page and not gap) or base >> 63:
            message = f"{gap}: pages must begin one after the other, below 2^63"
            raise Malformed("tile-order", message, offset=read.page_at[page], field=f"root.page[{page}].gap")
    pages = np.zeros(len(bases), PAGE_DTYPE)
    pages["base"], pages["tile_bytes"], pages["tile_crc32"] = bases, read.tile_bytes, read.tile_crc32
    return pages


def _row_pages(read: _Read) -> tuple[Table, I64]:
    """(R,) ROW_PAGE_DTYPE without offsets, by layer and page, and where each page of ROOT that says it begins."""
    rows = np.zeros(len(read.page), ROW_PAGE_DTYPE)
    for name in ("layer", "page", "row_bytes", "row_crc32", "block_bytes", "anchors"):
        rows[name] = getattr(read, name)
    order = np.argsort(rows["layer"], kind="stable")
    places = np.array(read.page_at, np.int64)[rows["page"]]
    return rows[order], places[order]


def _check_sizes(pages: Table, rows: Table, places: I64, read: _Read, header: Header) -> None:
    """R-5.4-12, R-5.4-13."""
    tiles = np.full(len(pages), 1 << header.page_bits, np.int64)
    if len(pages):
        tiles[-1] = len(header.page_range(len(pages) - 1))
    size = pages["tile_bytes"]
    fits = (size >= _TILE_BYTES[0] * tiles) & (size <= _TILE_BYTES[-1] * tiles)
    page_rules = TableRules(pages, "root.page", np.array(read.page_at, np.int64))
    page_rules.check(fits, "page-length", "tile_bytes", "no tile page of so many tiles is so long")
    size, tiles = rows["row_bytes"], tiles[rows["page"]]
    row_rules = TableRules(rows, "root.row_page", places)
    fits = (size >= tiles + _LEAST_ROWS) & (size <= _ROW_BYTES * tiles)
    row_rules.check(fits, "page-length", "row_bytes", "no row page of so many tiles is so long")
    row_rules.check(rows["block_bytes"] >= 1, "page-sums", "block_bytes", "a block has a byte or more")


def _check_sums(root: Root, header: Header) -> None:
    """R-5.4-14, R-5.4-15."""
    before = 0
    for index, layer in enumerate(header.layers):
        rows = root.rows[root.rows["layer"] == index + 1]
        models = total(root.models["length"][root.models["layer"] == index + 1])
        size, anchors = models + total(rows["block_bytes"]), total(rows["anchors"])
        name, base = f"layers[{index}]", FILE_HEADER_SIZE + index * LAYER_SUMMARY_SIZE
        if (size, models) != (layer.byte_count, layer.stream_bytes[Stream.MODELS]):
            message = f"the directory has {size} bytes, {models} of them outside tiles; the summary differs"
            raise Malformed("layer-directory-bytes", message, offset=base + 16, field=f"{name}.byte_count")
        if anchors != layer.anchor_count - before:
            message = f"its TILE blocks add {anchors} anchors, the summary {layer.anchor_count - before}"
            raise Malformed("layer-directory-anchors", message, offset=base, field=f"{name}.anchor_count")
        before = layer.anchor_count
    end = header.header_length + header.root_length + total(root.pages["tile_bytes"]) + total(root.rows["row_bytes"])
    if end != header.data_offset:
        message = f"the pages end at byte {end}, the blocks begin at byte {header.data_offset}"
        raise Malformed("directory-length", message, offset=header.header_length, field="root")


def _check_readable(rules: TableRules, readable: frozenset[int]) -> None:
    rows = rules.rows
    rules.check(
        np.isin(rows["kind"], sorted(readable)) | (rows["flags"] & BlockFlag.CRITICAL == 0),
        "unknown-critical-block",
        "kind",
        "this reader does not know a block kind that the file needs: use a newer or fuller reader",
        Unsupported,
    )


def _place(root: Root, header: Header) -> None:
    """Fill in where pages and blocks lie; all sums are right."""
    first = header.header_length + header.root_length
    root.pages["offset"] = _starts(first, root.pages["tile_bytes"])
    root.rows["offset"] = _starts(first + total(root.pages["tile_bytes"]), root.rows["row_bytes"])
    for number, layer in enumerate(header.layers, start=1):
        at = layer.end_offset - layer.byte_count
        rows = root.rows["layer"] == number
        blocks = root.rows["block_bytes"][rows]
        for late in (False, True):
            models = (root.models["layer"] == number) & ((root.models["kind"] > BlockKind.TILE) == late)
            lengths = root.models["length"][models]
            root.models["offset"][models] = _starts(at, lengths)
            at += total(lengths)
            if not late:
                root.rows["block_offset"][rows] = _starts(at, blocks)
                at += total(blocks)


def _starts(first: int, sizes: NDArray[np.generic]) -> I64:
    """(n,) where each of some neighbours begins."""
    ends = np.cumsum(sizes, dtype=np.int64)
    return first + ends - sizes.astype(np.int64)
