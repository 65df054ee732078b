"""Tile table and directory: their rows as objects, and their rules over whole tables (SPEC §5.3, §5.4).

Each rule is applied to the whole table before the next, in the order of :func:`check_tiles` and
:func:`check_directory`, so that two readers refuse one file for the same reason.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import Bools
from scarfmt.container.header import Header, HeaderFields
from scarfmt.container.morton import deinterleave
from scarfmt.container.schema import (
    FILE_HEADER_SIZE,
    LAYER_SUMMARY_SIZE,
    NO_TILE,
    TILE_DTYPE,
    BlockFlag,
    BlockKind,
    Stream,
)
from scarfmt.errors import LimitExceeded, Malformed, ScarError, Unsupported
from scarfmt.limits import MAX_LATTICE_BITS, MAX_LOCAL_BITS, MAX_TILE_DEPTH, Limits

Table = NDArray[np.void]


@dataclass(frozen=True)
class Tile:
    """A Morton cube: octree `depth`, coordinate `shift`, and Morton `prefix` of 3 * depth bits."""

    depth: int
    shift: int
    prefix: int


@dataclass(frozen=True)
class Entry:
    """A directory entry. `tile` is None for a block that belongs to no tile."""

    kind: int
    flags: int
    layer: int
    tile: int | None
    offset: int
    length: int
    count: int
    crc32: int

    @property
    def end(self) -> int:
        """Absolute offset one past the block."""
        return self.offset + self.length


def local_bits(fields: HeaderFields, tile: Tile) -> int:
    """Local bits per axis of a tile (SPEC §6.2)."""
    return fields.lattice_bits - tile.depth - tile.shift


@dataclass(frozen=True)
class TileFrame:
    """Where the local coordinates of a tile lie in the lattice (SPEC §6.2).

    Attributes:
        bits: local bits per axis.
        shift: local coordinates count 2^shift lattice steps.
        corner: (3,) lattice coordinates of the cube's lowest corner.
    """

    bits: int
    shift: int = 0
    corner: tuple[int, int, int] = (0, 0, 0)


def tile_frame(fields: HeaderFields, tile: Tile) -> TileFrame:
    """The frame of a tile."""
    free = fields.lattice_bits - tile.depth
    x, y, z = (int(c) << free for c in deinterleave(np.array([tile.prefix], np.uint64))[0])
    return TileFrame(local_bits(fields, tile), tile.shift, (x, y, z))


def required_flags(kind: int) -> BlockFlag | None:
    """The flags SPEC §5 and §7 prescribe for a kind, or None where the writer chooses."""
    if kind <= BlockKind.TILE:
        return BlockFlag.CRITICAL
    return BlockFlag.SAFE_TO_COPY if kind in (BlockKind.METADATA, BlockKind.STREAMING) else None


def tile_table(tiles: Iterable[Tile]) -> Table:
    """(T,) TILE_DTYPE records of `tiles`, in the given order."""
    return np.array([(t.depth, t.shift, 0, t.prefix) for t in tiles], dtype=TILE_DTYPE)


def entry_from_row(row: tuple[int, ...]) -> Entry:
    """The entry of one ENTRY_DTYPE row, as a tuple of its values."""
    kind, flags, layer, _, tile, offset, length, count, crc = row
    return Entry(kind, flags, layer, None if tile == NO_TILE else tile, offset, length, count, crc)


def block_name(entry: Entry) -> str:
    """A block's name in messages, such as ``layer 2 TILE 17``."""
    kind = BlockKind(entry.kind).name if entry.kind in set(BlockKind) else f"kind {entry.kind}"
    return f"layer {entry.layer} {kind}" + ("" if entry.tile is None else f" {entry.tile}")


@dataclass(frozen=True)
class _Rules:
    """Checks over all rows of a table at once; the error names the first offending row."""

    rows: Table
    name: str
    offset: int

    def check(self, ok: Bools, refusal: str, column: str, rule: str, error: type[ScarError] = Malformed) -> None:
        if ok.all():
            return
        row = int(np.argmin(ok))
        place, offsets = self.rows.dtype.fields, self.rows.dtype.itemsize
        assert place is not None
        raise error(
            refusal,
            f"{self.rows[column][row]}: {rule}",
            offset=self.offset + row * offsets + place[column][1],
            field=f"{self.name}[{row}].{column}",
        )


def _morton_ranges(depth: NDArray[np.uint8], prefix: NDArray[np.uint64]) -> tuple[NDArray[np.uint64], ...]:
    """First and one-past-last code of each cube at depth 21; at most 2^63."""
    scale = (3 * (MAX_TILE_DEPTH - depth.astype(np.int64))).astype(np.uint64)
    return prefix << scale, (prefix + np.uint64(1)) << scale


def check_tiles(tiles: Table, header: Header) -> None:
    """Refuse a tile table that breaks a rule of SPEC §5.3."""
    rules = _Rules(tiles, "tiles", header.header_length)
    depth, shift, prefix = tiles["depth"], tiles["shift"], tiles["prefix"]
    rules.check(tiles["reserved"] == 0, "bad-reserved", "reserved", "must be 0")
    rules.check(depth <= MAX_TILE_DEPTH, "tile-depth", "depth", f"must be 0..{MAX_TILE_DEPTH}")
    rules.check(shift < MAX_LATTICE_BITS, "tile-shift", "shift", f"must be 0..{MAX_LATTICE_BITS - 1}")
    local = header.fields.lattice_bits - depth.astype(np.int64) - shift
    rules.check(
        (local >= 0) & (local <= MAX_LOCAL_BITS),
        "tile-local-bits",
        "shift",
        f"lattice_bits - depth - shift must be 0..{MAX_LOCAL_BITS}",
    )
    rules.check(
        prefix >> (3 * depth.astype(np.uint64)) == 0, "tile-prefix", "prefix", "must have at most 3 * depth bits"
    )
    start, end = _morton_ranges(depth, prefix)
    rules.check(
        np.concatenate(([True], start[1:] >= end[:-1]))[: len(tiles)],
        "tile-order",
        "prefix",
        "must lie after the tile before it in Morton order, and not overlap it",
    )


def sort_keys(directory: Table) -> NDArray[np.uint64]:
    """(E,) sort key of each entry: layer, kind, tile."""
    key = directory["layer"].astype(np.uint64) << np.uint64(40)
    key |= directory["kind"].astype(np.uint64) << np.uint64(32)
    key |= directory["tile"]
    return key


def _check_entry_identity(rules: _Rules, header: Header) -> None:
    rows = rules.rows
    kind, flags, layer, tile = rows["kind"], rows["flags"], rows["layer"], rows["tile"]
    metadata = kind == BlockKind.METADATA
    rules.check(kind != 0, "entry-kind", "kind", "kind 0 is never assigned")
    rules.check(rows["reserved"] == 0, "bad-reserved", "reserved", "must be 0")
    rules.check(
        np.where(kind <= BlockKind.TILE, flags == BlockFlag.CRITICAL, flags <= BlockFlag.SAFE_TO_COPY)
        & (~metadata | (flags == BlockFlag.SAFE_TO_COPY)),
        "entry-flags",
        "flags",
        "must be 1 for kinds 1..16, 2 for METADATA, and 0, 1 or 2 for others",
    )
    rules.check(
        (layer >= 1) & (layer <= np.where(metadata, 1, header.layer_count)),
        "entry-layer",
        "layer",
        f"must be 1..{header.layer_count}, and 1 for METADATA",
    )
    bound = (kind < BlockKind.TILE) | metadata
    rules.check(
        np.where(tile == NO_TILE, kind != BlockKind.TILE, ~bound & (tile < header.tile_count)),
        "entry-tile",
        "tile",
        f"must be below {header.tile_count} for TILE, and 0xFFFFFFFF for kinds 1..15 and METADATA",
    )
    keys = sort_keys(rows)
    rules.check(
        np.concatenate(([True], keys[1:] > keys[:-1]))[: len(rows)],
        "entry-order",
        "kind",
        "entries must ascend strictly by (layer, kind, tile)",
    )


def _check_entry_extent(rules: _Rules, header: Header, limits: Limits) -> None:
    rows = rules.rows
    length, offset = rows["length"], rows["offset"]
    rules.check((length >= 1) & (length <= header.file_length), "entry-length", "length", "must be 1..file_length")
    rules.check(
        length <= limits.block_bytes,
        "limit-block-bytes",
        "length",
        f"exceeds this reader's limit of {limits.block_bytes}: raise it if you trust the file",
        LimitExceeded,
    )
    # Lengths and offsets are at most file_length < 2^53 where it matters: no sum below overflows.
    previous_end = np.minimum(offset, header.file_length)[:-1] + length[:-1]
    expected = np.concatenate((np.array([header.data_offset], np.uint64), previous_end))[: len(rows)]
    rules.check(
        (offset == expected) & (offset <= header.file_length),
        "entry-offset",
        "offset",
        "must be the end of the block before it",
    )


def _check_entry_sums(rules: _Rules, header: Header, limits: Limits) -> None:
    rows = rules.rows
    in_tile, count = rows["kind"] == BlockKind.TILE, rows["count"]
    rules.check(
        ~in_tile | (count <= limits.tile_anchors),
        "limit-tile-anchors",
        "count",
        f"exceeds this reader's limit of {limits.tile_anchors} anchors per TILE block",
        LimitExceeded,
    )
    rules.check((rows["kind"] != BlockKind.METADATA) | (count == 0), "entry-count", "count", "must be 0 for METADATA")
    before = 0
    for index, layer in enumerate(header.layers):
        here = rows["layer"] == index + 1
        total = int(rows["length"][here].sum(dtype=np.uint64))
        models = int(rows["length"][here & ~in_tile].sum(dtype=np.uint64))
        anchors = int(count[here & in_tile].sum(dtype=np.uint64))
        name, base = f"layers[{index}]", FILE_HEADER_SIZE + index * LAYER_SUMMARY_SIZE
        if (total, models) != (layer.byte_count, layer.stream_bytes[Stream.MODELS]):
            message = f"the directory has {total} bytes, {models} of them outside tiles; the summary differs"
            raise Malformed("layer-directory-bytes", message, offset=base + 16, field=f"{name}.byte_count")
        if anchors != layer.anchor_count - before:
            message = f"its TILE blocks add {anchors} anchors, the summary {layer.anchor_count - before}"
            raise Malformed("layer-directory-anchors", message, offset=base, field=f"{name}.anchor_count")
        before = layer.anchor_count


def _check_readable(rules: _Rules, readable: frozenset[int]) -> None:
    rows = rules.rows
    rules.check(
        np.isin(rows["kind"], sorted(readable)) | (rows["flags"] & BlockFlag.CRITICAL == 0),
        "unknown-critical-block",
        "kind",
        "this reader does not know a block kind that the file needs: use a newer or fuller reader",
        Unsupported,
    )


def check_directory(directory: Table, header: Header, limits: Limits, readable: frozenset[int]) -> None:
    """Refuse a directory that breaks a rule of SPEC §5.4, or that needs a kind outside `readable`."""
    rules = _Rules(directory, "directory", header.directory_offset)
    _check_entry_identity(rules, header)
    _check_entry_extent(rules, header, limits)
    _check_entry_sums(rules, header, limits)
    _check_readable(rules, readable)
