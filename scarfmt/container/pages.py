"""Tile pages and row pages: where the tiles of a page lie, and what blocks they have in a layer (SPEC §5.5).

Written and read next to each other. Reading applies the rules in the order of SPEC, each to all of a page before the
next, so that two readers refuse one file for the same reason.
"""

from __future__ import annotations

import zlib

import numpy as np

from scarfmt.container.bytefields import ByteReader, unsigned_varints
from scarfmt.container.header import Header
from scarfmt.container.root import PackedPage, PackedRows
from scarfmt.container.schema import ENTRY_DTYPE, TILE_DTYPE, BlockFlag, BlockKind
from scarfmt.container.table_rules import Table, TableRules, total
from scarfmt.errors import LimitExceeded, Malformed
from scarfmt.limits import MAX_LATTICE_BITS, MAX_LOCAL_BITS, MAX_TILE_DEPTH, Limits


def pack_tile_pages(tiles: Table, lattice_bits: int, page_bits: int) -> list[PackedPage]:
    """The tile pages of a file.

    Args:
        tiles: (T,) TILE_DTYPE, ascending by Morton range.
        lattice_bits: of the header.
        page_bits: tiles of a page, as a power of two.

    Raises:
        Malformed: no page can say such tiles, with the id of the rule of SPEC §5.5 that they break.
    """
    rules = TableRules(tiles, "tile", 0)
    _check_cubes(rules, lattice_bits)
    out, past, size = [], 0, 1 << page_bits
    for start in range(0, len(tiles), size):
        page = tiles[start : start + size]
        base = int(page["prefix"][0]) << _free(int(page["depth"][0]))
        gaps, past = _gaps(page, max(base, past), start)
        data = page["depth"].tobytes() + page["shift"].tobytes() + unsigned_varints(np.array(gaps, np.int64))
        out.append(PackedPage(base, data))
    return out


def _free(depth: int) -> int:
    """Bits of a Morton code within a cube."""
    return 3 * (MAX_TILE_DEPTH - depth)


def _gaps(page: Table, past: int, start: int) -> tuple[list[int], int]:
    """What lies between each cube of a page and the one before, in cubes of its size, and where the last ends."""
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


def unpack_tile_page(data: bytes, page: int, pages: Table, header: Header) -> Table:
    """(n,) TILE_DTYPE of a page.

    Args:
        data: the bytes of its tile page.
        page: its number.
        pages: (P,) PAGE_DTYPE of ROOT.
        header: of the file.

    Raises:
        Malformed: a rule of SPEC §5.5 is broken.
    """
    said, tiles = pages[page], header.page_range(page)
    reader = _opened(data, f"tile page {page}", int(said["tile_crc32"]), int(said["offset"]))
    count = len(tiles)
    out = np.zeros(count, TILE_DTYPE)
    try:
        out["depth"], out["shift"] = reader.array("u1", count), reader.array("u1", count)
        gaps = reader.unsigned_array(63, count)
        reader.finish()
    except Malformed as error:
        raise _at(error, int(said["offset"])) from error
    _check_cubes(TableRules(out, "tile", int(said["offset"]), tiles.start), header.fields.lattice_bits)
    following = int(pages["base"][page + 1]) if page + 1 < len(pages) else 1 << 63
    out["prefix"] = _prefixes(out["depth"].tolist(), gaps.tolist(), said, following, tiles.start)
    return out


def _prefixes(depths: list[int], gaps: list[int], said: np.void, following: int, first: int) -> list[int]:
    """The Morton codes of the cubes of a page, the next one beginning at `following`; R-5.5-6, R-5.5-7."""
    base, offset = int(said["base"]), int(said["offset"])
    prefixes, past = [], base
    for number, (depth, gap) in enumerate(zip(depths, gaps, strict=True), start=first):
        free = _free(depth)
        prefix = _next_cube(past, free) + gap
        _check_prefix(prefix, depth, number, offset)
        prefixes.append(prefix)
        past = (prefix + 1) << free
    if prefixes[0] << _free(depths[0]) != base:
        message = f"{prefixes[0]}: the page begins at {base}, not its first tile"
        raise Malformed("tile-order", message, offset=offset, field=_prefix_of(first))
    if past > following:
        message = f"{prefixes[-1]}: ends at {past}, the next page begins at {following}"
        raise Malformed("tile-order", message, offset=offset, field=_prefix_of(first + len(gaps) - 1))
    return prefixes


def _check_cubes(rules: TableRules, lattice_bits: int) -> None:
    """R-5.5-3 to R-5.5-5."""
    depth, shift = rules.rows["depth"], rules.rows["shift"]
    rules.check(depth <= MAX_TILE_DEPTH, "tile-depth", "depth", f"must be 0..{MAX_TILE_DEPTH}")
    rules.check(shift < MAX_LATTICE_BITS, "tile-shift", "shift", f"must be 0..{MAX_LATTICE_BITS - 1}")
    local = lattice_bits - depth.astype(np.int64) - shift
    rules.check(
        (local >= 0) & (local <= MAX_LOCAL_BITS),
        "tile-local-bits",
        "shift",
        f"lattice_bits - depth - shift must be 0..{MAX_LOCAL_BITS}",
    )


def _opened(data: bytes, name: str, crc32: int, offset: int) -> ByteReader:
    """A reader of a page whose checksum is right."""
    if zlib.crc32(data) != crc32:
        message = f"a page of the directory is damaged, its CRC-32 is not {crc32:08x}: get another copy"
        raise Malformed("page-crc-mismatch", message, offset=offset, field=name)
    return ByteReader(data, name)


def _at(error: Malformed, offset: int) -> Malformed:
    return Malformed(error.refusal, error.message, offset=offset, field=error.field)


def pack_row_pages(rows: Table, tile_count: int, page_bits: int) -> list[PackedRows | None]:
    """The row pages of a layer, None for a page without TILE blocks.

    Args:
        rows: ENTRY_DTYPE of the layer's TILE blocks, by tile.
        tile_count: tiles of the file.
        page_bits: tiles of a page, as a power of two.
    """
    out: list[PackedRows | None] = []
    size = 1 << page_bits
    starts = range(0, tile_count, size)
    edges = np.searchsorted(np.ascontiguousarray(rows["tile"]), [*starts, tile_count]).tolist()
    for start, first, past in zip(starts, edges[:-1], edges[1:], strict=True):
        here = rows[first:past]
        if not len(here):
            out.append(None)
            continue
        lengths = np.zeros(min(size, tile_count - start), np.int64)
        lengths[here["tile"] - start] = here["length"]
        counts = here["count"].astype(np.int64)
        data = unsigned_varints(lengths) + unsigned_varints(counts) + here["crc32"].tobytes()
        out.append(PackedRows(data, int(lengths.sum()), int(counts.sum())))
    return out


def unpack_row_page(data: bytes, said: np.void, header: Header, limits: Limits) -> Table:
    """ENTRY_DTYPE of the TILE blocks of a page in a layer, by tile.

    Args:
        data: the bytes of the row page.
        said: its row in ROOT, a ROW_PAGE_DTYPE.
        header: of the file.
        limits: what this reader accepts.

    Raises:
        Malformed, LimitExceeded: a rule of SPEC §5.5 is broken.
    """
    layer, page, offset = int(said["layer"]), int(said["page"]), int(said["offset"])
    tiles = header.page_range(page)
    name = f"row page {page} of layer {layer}"
    reader = _opened(data, name, int(said["row_crc32"]), offset)
    try:
        lengths = reader.unsigned_array(53, len(tiles))
        present = np.flatnonzero(lengths)
        counts = reader.unsigned_array(32, len(present))
        crc32 = reader.array("<u4", len(present))
        reader.finish()
    except Malformed as error:
        raise _at(error, offset) from error
    lengths = lengths[present]
    rows = np.zeros(len(present), ENTRY_DTYPE)
    rows["kind"], rows["flags"], rows["layer"] = BlockKind.TILE, BlockFlag.CRITICAL, layer
    rows["tile"], rows["length"], rows["count"], rows["crc32"] = tiles.start + present, lengths, counts, crc32
    _check_rows(TableRules(rows, name, offset), said, limits)
    rows["offset"] = int(said["block_offset"]) + np.cumsum(lengths) - lengths
    return rows


def _check_rows(rules: TableRules, said: np.void, limits: Limits) -> None:
    """R-5.5-8 to R-5.5-10."""
    lengths, counts = rules.rows["length"], rules.rows["count"]
    rules.check(
        lengths <= limits.block_bytes,
        "limit-block-bytes",
        "length",
        f"exceeds this reader's limit of {limits.block_bytes}: raise it if you trust the file",
        LimitExceeded,
    )
    rules.check(
        counts <= limits.tile_anchors,
        "limit-tile-anchors",
        "count",
        f"exceeds this reader's limit of {limits.tile_anchors} anchors per TILE block",
        LimitExceeded,
    )
    found, wanted = (total(lengths), total(counts)), (int(said["block_bytes"]), int(said["anchors"]))
    if found != wanted:
        message = f"its blocks have {found[0]} bytes and {found[1]} anchors, ROOT says {wanted[0]} and {wanted[1]}"
        raise Malformed("page-sums", message, offset=int(said["offset"]), field=rules.name)
