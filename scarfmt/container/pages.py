"""Tile pages and row pages: where the tiles of a page lie, and what blocks they have in a layer (SPEC §5.5).

Written and read next to each other. Reading applies the rules in the order of SPEC, each to all of a page before the
next, so that two readers refuse one file for the same reason.
"""

from __future__ import annotations

import itertools
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import I64
from scarfmt.container.bytefields import ByteReader, unsigned_varints
from scarfmt.container.directory import Table, check_rows, total
from scarfmt.container.header import Header
from scarfmt.container.root import PAGE_DTYPE, ROW_PAGE_DTYPE
from scarfmt.container.schema import ENTRY_DTYPE, TILE_DTYPE, BlockFlag, BlockKind
from scarfmt.errors import LimitExceeded, Malformed, ScarError
from scarfmt.limits import MAX_LATTICE_BITS, MAX_LOCAL_BITS, MAX_TILE_DEPTH, Limits

Found = Sequence[tuple[int, bytes]]
"""Numbers of some pages in ROOT, and their bytes."""


def pack_tile_pages(tiles: Table, lattice_bits: int, page_bits: int) -> tuple[Table, list[bytes]]:
    """The tile pages of a file: (P,) PAGE_DTYPE without offsets, and the bytes of each.

    Args:
        tiles: (T,) TILE_DTYPE, ascending by Morton range.
        page_bits: tiles of a page, as a power of two.

    Raises:
        Malformed: no page can say such tiles, with the id of the rule of SPEC §5.5 that they break.
    """
    _check_cubes(tiles, lattice_bits, 0, 0)
    pages, parts, past, size = [], [], 0, 1 << page_bits
    for start in range(0, len(tiles), size):
        page = tiles[start : start + size]
        base = int(page["prefix"][0]) << _free(int(page["depth"][0]))
        gaps, past = _gaps(page, max(base, past), start)
        data = page["depth"].tobytes() + page["shift"].tobytes() + unsigned_varints(np.array(gaps, np.int64))
        pages.append((base, len(data), zlib.crc32(data), 0))
        parts.append(data)
    return np.array(pages, PAGE_DTYPE), parts


def _free(depth: int) -> int:
    """Bits of a Morton code within a cube."""
    return 3 * (MAX_TILE_DEPTH - depth)


def _gaps(page: Table, past: int, start: int) -> tuple[list[int], int]:
    """The gap before each cube of a page, in cubes of its size, and the end of the last cube."""
    gaps = []
    for number, (depth, _, prefix) in enumerate(page.tolist(), start=start):
        free = _free(depth)
        gap = prefix - _next_cube(past, free)
        _check_prefix(prefix, depth, number, None)
        if gap < 0:
            raise Malformed("tile-order", f"{prefix}: must lie after the tile before it", field=_prefix_of(number))
        gaps.append(gap)
        past = (prefix + 1) << free
    return gaps, past


def _next_cube(past: int, free: int) -> int:
    """The first cube of 2^free codes that begins at `past` or after: ceil(past / 2^free)."""
    return -(-past >> free)


def _check_prefix(prefix: int, depth: int, number: int, offset: int | None) -> None:
    """R-5.5-6."""
    if prefix >> (3 * depth):
        message = f"{prefix}: must have at most 3 * depth bits"
        raise Malformed("tile-prefix", message, offset=offset, field=_prefix_of(number))


def _prefix_of(number: int) -> str:
    return f"tile[{number}].prefix"


def unpack_each(unpack: Callable[[Found], list[Table]], found: Found) -> list[Table]:
    """Unpack pages all at once. If one has a fault, unpack them one by one, so that the first fault is reported."""
    try:
        return unpack(found)
    except ScarError:
        if len(found) == 1:
            raise
    return [table for item in found for table in unpack([item])]


def unpack_tile_pages(found: Found, pages: Table, header: Header) -> list[Table]:
    """(n,) TILE_DTYPE of each of some pages.

    Args:
        pages: (P,) PAGE_DTYPE of ROOT.

    Raises:
        Malformed: a rule of SPEC §5.5 is broken.
    """
    numbers = np.array([page for page, _ in found])
    said = pages[numbers].tolist()
    depth, shift, gaps, edges = bytearray(), bytearray(), list[int](), [0]
    for (page, data), (_, _, crc32, offset) in zip(found, said, strict=True):
        count = len(header.page_range(page))
        with _page_reader(data, f"tile page {page}", crc32, offset) as reader:
            depth += reader.take(count)
            shift += reader.take(count)
            gaps += reader.unsigned_array(63, count).tolist()
        edges.append(edges[-1] + count)
    out = np.zeros(len(gaps), TILE_DTYPE)
    out["depth"], out["shift"] = np.frombuffer(depth, np.uint8), np.frombuffer(shift, np.uint8)
    _check_cubes(out, header.fields.lattice_bits, said[0][3], header.page_range(found[0][0]).start)
    following = np.append(pages["base"], np.uint64(1 << 63))[numbers + 1].tolist()
    prefixes: list[int] = []
    for (page, _), (base, _, _, offset), end, (start, past) in zip(
        found, said, following, itertools.pairwise(edges), strict=True
    ):
        first = header.page_range(page).start
        prefixes += _prefixes(depth[start:past], gaps[start:past], first, range(base, end), offset)
    out["prefix"] = prefixes
    return [out[start:past] for start, past in itertools.pairwise(edges)]


def _prefixes(depths: bytearray, gaps: list[int], first: int, codes: range, offset: int) -> list[int]:
    """The Morton codes of the cubes of a page; R-5.5-6, R-5.5-7.

    Args:
        depths, gaps: of its tiles.
        first: number of the first of them.
        codes: Morton codes at which this page and the next begin.
        offset: of the tile page in the file.
    """
    prefixes, past = [], codes.start
    for number, (depth, gap) in enumerate(zip(depths, gaps, strict=True), start=first):
        free = _free(depth)
        prefix = _next_cube(past, free) + gap
        _check_prefix(prefix, depth, number, offset)
        prefixes.append(prefix)
        past = (prefix + 1) << free
    if prefixes[0] << _free(depths[0]) != codes.start:
        message = f"{prefixes[0]}: the page begins at {codes.start}, not its first tile"
        raise Malformed("tile-order", message, offset=offset, field=_prefix_of(first))
    if past > codes.stop:
        message = f"{prefixes[-1]}: ends at {past}, the next page begins at {codes.stop}"
        raise Malformed("tile-order", message, offset=offset, field=_prefix_of(first + len(gaps) - 1))
    return prefixes


def _check_cubes(tiles: Table, lattice_bits: int, offset: int, first: int) -> None:
    """R-5.5-3 to R-5.5-5, of tiles from number `first` on, whose page is at `offset`."""
    check = partial(check_rows, tiles, "tile", offset=offset, first=first)
    depth, shift = tiles["depth"], tiles["shift"]
    check(depth <= MAX_TILE_DEPTH, "tile-depth", "depth", f"must be 0..{MAX_TILE_DEPTH}")
    check(shift < MAX_LATTICE_BITS, "tile-shift", "shift", f"must be 0..{MAX_LATTICE_BITS - 1}")
    local = lattice_bits - depth.astype(np.int64) - shift
    check(
        (local >= 0) & (local <= MAX_LOCAL_BITS),
        "tile-local-bits",
        "shift",
        f"lattice_bits - depth - shift must be 0..{MAX_LOCAL_BITS}",
    )


@contextmanager
def _page_reader(data: bytes, name: str, crc32: int, offset: int) -> Iterator[ByteReader]:
    """A reader of a page whose checksum is right and which must be read to its end; errors give the page's offset."""
    if zlib.crc32(data) != crc32:
        message = f"a page of the directory is damaged, its CRC-32 is not {crc32:08x}: get another copy"
        raise Malformed("page-crc-mismatch", message, offset=offset, field=name)
    reader = ByteReader(data, name)
    try:
        yield reader
        reader.finish()
    except Malformed as error:
        raise Malformed(error.refusal, error.message, offset=offset, field=error.field) from error


def pack_row_pages(rows: Table, layer: int, tile_count: int, page_bits: int) -> tuple[Table, list[bytes]]:
    """The row pages of a layer that there are: (R,) ROW_PAGE_DTYPE without offsets, and the bytes of each.

    Args:
        rows: ENTRY_DTYPE of the layer's TILE blocks, by tile.
        layer: 1-based.
        page_bits: tiles of a page, as a power of two.
    """
    pages, parts, size = [], [], 1 << page_bits
    starts = range(0, tile_count, size)
    edges = np.searchsorted(np.ascontiguousarray(rows["tile"]), [*starts, tile_count]).tolist()
    for page, (first, past) in enumerate(itertools.pairwise(edges)):
        if first == past:
            continue
        here, start = rows[first:past], page << page_bits
        lengths = np.zeros(min(size, tile_count - start), np.int64)
        lengths[here["tile"] - start] = here["length"]
        counts = here["count"].astype(np.int64)
        data = unsigned_varints(lengths) + unsigned_varints(counts) + here["crc32"].tobytes()
        pages.append((layer, page, len(data), zlib.crc32(data), int(lengths.sum()), int(counts.sum()), 0, 0))
        parts.append(data)
    return np.array(pages, ROW_PAGE_DTYPE), parts


def unpack_row_pages(found: Found, pages: Table, header: Header, limits: Limits) -> list[Table]:
    """ENTRY_DTYPE of the TILE blocks of each of some pages, by tile.

    Args:
        pages: (R,) ROW_PAGE_DTYPE of ROOT.

    Raises:
        Malformed, LimitExceeded: a rule of SPEC §5.5 is broken.
    """
    columns: list[tuple[I64, I64, I64, NDArray[np.generic]]] = []
    said = pages[[number for number, _ in found]].tolist()
    for (layer, page, _, crc32, _, _, offset, _), (_, data) in zip(said, found, strict=True):
        tiles = header.page_range(page)
        with _page_reader(data, _row_name(layer, page), crc32, offset) as reader:
            lengths = reader.unsigned_array(53, len(tiles))
            present = np.flatnonzero(lengths)
            counts = reader.unsigned_array(32, len(present))
            columns.append((tiles.start + present, lengths[present], counts, reader.array("<u4", len(present))))
    edges = [0, *itertools.accumulate(len(tile) for tile, _, _, _ in columns)]
    rows = np.zeros(edges[-1], ENTRY_DTYPE)
    rows["kind"], rows["flags"] = BlockKind.TILE, BlockFlag.CRITICAL
    for name, parts in zip(("tile", "length", "count", "crc32"), zip(*columns, strict=True), strict=True):
        rows[name] = np.concatenate(parts)
    layer, page, _, _, _, _, offset, _ = said[0]
    _check_limits(rows, _row_name(layer, page), offset, limits)
    tables = [rows[start:past] for start, past in itertools.pairwise(edges)]
    for table, (layer, page, _, _, size, anchors, offset, first) in zip(tables, said, strict=True):
        sums = total(table["length"]), total(table["count"])
        if sums != (size, anchors):
            message = f"its blocks have {sums[0]} bytes and {sums[1]} anchors, ROOT says {size} and {anchors}"
            raise Malformed("page-sums", message, offset=offset, field=_row_name(layer, page))
        table["layer"] = layer
        table["offset"] = first + np.cumsum(table["length"]) - table["length"]
    return tables


def _row_name(layer: int, page: int) -> str:
    return f"row page {page} of layer {layer}"


def _check_limits(rows: Table, name: str, offset: int, limits: Limits) -> None:
    """R-5.5-8, R-5.5-9."""
    check = partial(check_rows, rows, name, offset=offset, error=LimitExceeded)
    check(
        rows["length"] <= limits.block_bytes,
        "limit-block-bytes",
        "length",
        f"exceeds this reader's limit of {limits.block_bytes}: raise it if you trust the file",
    )
    check(
        rows["count"] <= limits.tile_anchors,
        "limit-tile-anchors",
        "count",
        f"exceeds this reader's limit of {limits.tile_anchors} anchors per TILE block",
    )
