"""ROOT: the blocks that belong to no tile, and where the pages of tiles are (SPEC §5.4).

Written and read next to each other. :func:`unpack_root` applies the rules in the order of SPEC, each to all of ROOT
before the next, so that two readers refuse one file for the same reason.
"""

from __future__ import annotations

import zlib
from array import array
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import I64
from scarfmt.container.bytefields import ByteReader, unsigned_varint
from scarfmt.container.directory import Table, check_rows, total
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


def pack_root(root: Root, layers: int) -> bytes:
    """The bytes of ROOT of a file of so many layers; offsets do not matter."""
    out = bytearray()
    for layer in range(1, layers + 1):
        here = root.models[root.models["layer"] == layer]
        out += unsigned_varint(len(here))
        for kind, flags, _, _, _, length, count, crc32 in here.tolist():
            out += bytes([kind, flags]) + unsigned_varint(length) + unsigned_varint(count) + crc32.to_bytes(4, "little")
    row_pages = {(layer, page): row for layer, page, *row in root.rows.tolist()}
    before = 0
    for page, (base, size, crc32, _) in enumerate(root.pages.tolist()):
        out += unsigned_varint(base - before) + unsigned_varint(size) + crc32.to_bytes(4, "little")
        before = base
        for layer in range(1, layers + 1):
            size, crc32, block_bytes, anchors, *_ = row_pages.get((layer, page), (0, 0, 0, 0))
            out += unsigned_varint(size)
            if size:
                out += crc32.to_bytes(4, "little") + unsigned_varint(block_bytes) + unsigned_varint(anchors)
    return bytes(out)


def _parse(data: bytes, header: Header) -> tuple[Table, Table, Table]:
    """Blocks, pages and row pages, page by page, as ROOT has them; its structure is checked, but no values.

    `offset` is where each is in ROOT, of a row page where its page is. `base` is the gap before a page.
    """
    reader, layers = ByteReader(data, "root"), range(1, header.layer_count + 1)
    models, pages, rows = array("Q"), array("Q"), array("Q")  # a list of numbers takes four times the memory
    for layer in layers:
        for _ in range(reader.unsigned(8)):
            at = header.header_length + reader.position
            kind, flags = reader.take(2)
            models.extend((kind, flags, layer, NO_TILE, at, reader.unsigned(53), reader.unsigned(32), reader.u32()))
    for page in range(header.page_count):
        at = header.header_length + reader.position
        pages.extend((reader.unsigned(63), reader.unsigned(32), reader.u32(), at))
        for layer in layers:
            size = reader.unsigned(32)
            if size:
                rows.extend((layer, page, size, reader.u32(), reader.unsigned(53), reader.unsigned(53), at, 0))
    reader.finish()
    return _table(models, ENTRY_DTYPE), _table(pages, PAGE_DTYPE), _table(rows, ROW_PAGE_DTYPE)


def _table(numbers: array[int], dtype: np.dtype[np.void]) -> Table:
    """Records of numbers that lie row by row."""
    names = dtype.names or ()
    columns = np.array(numbers, np.uint64).reshape(-1, len(names))
    out = np.zeros(len(columns), dtype)
    for place, name in enumerate(names):
        out[name] = columns[:, place]
    return out


def unpack_root(data: bytes, header: Header, limits: Limits, readable: frozenset[int]) -> Root:
    """Parse and check ROOT.

    Args:
        readable: block kinds the caller understands; other critical kinds refuse the file.

    Raises:
        Malformed, Unsupported, LimitExceeded: a rule of SPEC §5.4 is broken.
    """
    if zlib.crc32(data) != header.root_crc32:
        message = "ROOT is damaged: get another copy"
        raise Malformed("directory-crc-mismatch", message, offset=header.header_length, field="root_crc32")
    try:
        models, pages, rows = _parse(data, header)
    except Malformed as error:
        raise Malformed(error.refusal, error.message, offset=header.header_length, field="root") from error
    _check_entries(models, header, limits)
    _sum_gaps(pages)
    rows = rows[np.argsort(rows["layer"], kind="stable")]
    _check_sizes(pages, rows, header)
    root = Root(models, pages, rows)
    _check_sums(root, header)
    check_rows(
        models,
        "root.entry",
        np.isin(models["kind"], sorted(readable)) | (models["flags"] & BlockFlag.CRITICAL == 0),
        "unknown-critical-block",
        "kind",
        "this reader does not know a block kind that the file needs: use a newer or fuller reader",
        error=Unsupported,
    )
    _place(root, header)
    return root


def _check_entries(models: Table, header: Header, limits: Limits) -> None:
    """R-5.4-4 to R-5.4-10."""
    check = partial(check_rows, models, "root.entry")
    kind, flags, layer, length = models["kind"], models["flags"], models["layer"], models["length"]
    metadata = kind == BlockKind.METADATA
    check((kind != 0) & (kind != BlockKind.TILE), "entry-kind", "kind", "neither kind 0 nor TILE stands in ROOT")
    check(
        np.where(kind < BlockKind.THUMBNAIL, flags == BlockFlag.CRITICAL, flags <= BlockFlag.SAFE_TO_COPY)
        & (~(metadata | (kind == BlockKind.THUMBNAIL)) | (flags == BlockFlag.SAFE_TO_COPY)),
        "entry-flags",
        "flags",
        "must be 1 for kinds 1..15, 2 for METADATA, and 0, 1 or 2 for others",
    )
    check(~metadata | (layer == 1), "entry-layer", "layer", "must be 1 for METADATA")
    order = layer.astype(np.int64) << 8 | kind
    ascends = np.concatenate(([True], np.diff(order) > 0))[: len(models)]
    check(ascends, "entry-order", "kind", "the kinds of a layer must ascend")
    check((length >= 1) & (length <= header.file_length), "entry-length", "length", "must be 1..file_length")
    check(
        length <= limits.block_bytes,
        "limit-block-bytes",
        "length",
        f"exceeds this reader's limit of {limits.block_bytes}: raise it if you trust the file",
        error=LimitExceeded,
    )
    check(~metadata | (models["count"] == 0), "entry-count", "count", "must be 0 for METADATA")


def _sum_gaps(pages: Table) -> None:
    """Make a Morton code of the gap before each page; R-5.4-11."""
    gaps = pages["base"].tolist()
    bases = list(accumulate(gaps))
    for page, (gap, base) in enumerate(zip(gaps, bases, strict=True)):
        if (page and not gap) or base >> 63:
            message = f"{gap}: pages must begin one after the other, below 2^63"
            raise Malformed("tile-order", message, offset=int(pages["offset"][page]), field=f"root.page[{page}].gap")
    pages["base"] = bases


def _check_sizes(pages: Table, rows: Table, header: Header) -> None:
    """R-5.4-12, R-5.4-13."""
    tiles = np.full(len(pages), 1 << header.page_bits, np.int64)
    if len(pages):
        tiles[-1] = len(header.page_range(len(pages) - 1))
    check_page, check_row = partial(check_rows, pages, "root.page"), partial(check_rows, rows, "root.row_page")
    size = pages["tile_bytes"]
    fits = (size >= _TILE_BYTES[0] * tiles) & (size <= _TILE_BYTES[-1] * tiles)
    check_page(fits, "page-length", "tile_bytes", "no tile page of so many tiles is so long")
    size, tiles = rows["row_bytes"], tiles[rows["page"]]
    fits = (size >= tiles + _LEAST_ROWS) & (size <= _ROW_BYTES * tiles)
    check_row(fits, "page-length", "row_bytes", "no row page of so many tiles is so long")
    check_row(rows["block_bytes"] >= 1, "page-sums", "block_bytes", "a block has a byte or more")


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
