"""Tiles and entries of the directory as objects, and as rows of tables (SPEC §5.4, §5.5, §6.2)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F64, U64, Bools
from scarfmt.container.header import HeaderFields
from scarfmt.container.morton import deinterleave
from scarfmt.container.schema import NO_TILE, TILE_DTYPE, BlockFlag, BlockKind
from scarfmt.errors import Malformed, ScarError

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


def corners(lattice_bits: int, depth: NDArray[np.uint8], prefix: U64) -> F64:
    """(T, 3) float64 lattice coordinates of the lowest corners of T tiles; integers below 2^32 (SPEC §6.2)."""
    free = (lattice_bits - depth.astype(np.int64)).astype(np.uint64)
    return (deinterleave(prefix) << free[:, None]).astype(np.float64)


@dataclass(frozen=True)
class TileFrame:
    """The place of a tile's local coordinates in the lattice (SPEC §6.2).

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
    depth, prefix = np.array([tile.depth], np.uint8), np.array([tile.prefix], np.uint64)
    x, y, z = map(int, corners(fields.lattice_bits, depth, prefix)[0])
    return TileFrame(local_bits(fields, tile), tile.shift, (x, y, z))


def required_flags(kind: int) -> BlockFlag | None:
    """The flags SPEC §5 and §7 prescribe for a kind, or None where the writer chooses."""
    if kind in (BlockKind.THUMBNAIL, BlockKind.METADATA, BlockKind.STREAMING):
        return BlockFlag.SAFE_TO_COPY
    return BlockFlag.CRITICAL if kind <= BlockKind.TILE else None


def tile_table(tiles: Iterable[Tile]) -> Table:
    """(T,) TILE_DTYPE records of `tiles`, in the given order."""
    return np.array([(t.depth, t.shift, t.prefix) for t in tiles], dtype=TILE_DTYPE)


def entry_from_row(row: tuple[int, ...]) -> Entry:
    """The entry of one ENTRY_DTYPE row, as a tuple of its values."""
    kind, flags, layer, tile, offset, length, count, crc = row
    return Entry(kind, flags, layer, None if tile == NO_TILE else tile, offset, length, count, crc)


def block_name(entry: Entry) -> str:
    """A block's name in messages, such as ``layer 2 TILE 17``."""
    kind = BlockKind(entry.kind).name if entry.kind in set(BlockKind) else f"kind {entry.kind}"
    return f"layer {entry.layer} {kind}" + ("" if entry.tile is None else f" {entry.tile}")


def sort_keys(directory: Table) -> U64:
    """(E,) sort key of each entry: layer, kind, tile."""
    key: U64 = directory["layer"].astype(np.uint64) << np.uint64(40)
    key |= directory["kind"].astype(np.uint64) << np.uint64(32)
    key |= directory["tile"]
    return key


def check_rows(
    rows: Table,
    name: str,
    ok: Bools,
    refusal: str,
    column: str,
    rule: str,
    *,
    offset: int | None = None,
    first: int = 0,
    error: type[ScarError] = Malformed,
) -> None:
    """Refuse the first row of a table that breaks a rule.

    Args:
        rows: (n,) of it.
        name: what a row is called in messages, such as ``"tile"``.
        ok: (n,) whether each keeps the rule.
        refusal: id of the error.
        column: what the rule is about.
        rule: the rule, in words.
        offset: absolute offset of the structure that holds all rows; None where the column `offset` has that of each.
        first: number of the first row.
        error: class of the error.

    Raises:
        ScarError: a row breaks it.
    """
    if ok.all():
        return
    row = int(np.argmin(ok))
    raise error(
        refusal,
        f"{rows[column][row]}: {rule}",
        offset=int(rows["offset"][row]) if offset is None else offset,
        field=f"{name}[{first + row}].{column}",
    )


def total(column: NDArray[np.generic]) -> int:
    """The exact sum of non-negative integers below 2^64."""
    most = int(column.max(initial=0)) * len(column)
    return int(column.sum(dtype=np.uint64)) if most < 1 << 64 else sum(map(int, column))
