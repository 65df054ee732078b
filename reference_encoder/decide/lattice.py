"""Choosing the position lattice and the tiles (SPEC §6.2; encoder side).

Tiles are the largest octree cubes that hold few enough anchors. Each gets as many local bits as its own anchors can
use: an outlier at 1e4 times the core's extent sits in a coarse tile of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from reference_encoder.tuning import CELL_FACTOR, CELL_PERCENTILE, LARGE_SCENE, LARGE_SCENE_TILE_ANCHORS, TILE_ANCHORS
from scarfmt.arrays import F64, I64, U64
from scarfmt.container.file import Tile
from scarfmt.container.morton import deinterleave, interleave
from scarfmt.limits import MAX_LATTICE_BITS, MAX_LOCAL_BITS, MAX_TILE_DEPTH
from scarfmt.scene.model import Lattice

# Never finer than this fraction of the magnitude of the coordinates: binary64 has no more to give.
_RELATIVE_FLOOR = 2.0**-44


@dataclass(frozen=True)
class Placement:
    """Where each anchor lies.

    Attributes:
        lattice: origin, voxel and bits.
        tiles: tile table.
        tile: (N,) int64 tile of each anchor.
        codes: (N,) uint64 local Morton codes.
        residual: (N, 3) float64 distance from the cell centre, in cells (-0.5 .. 0.5).
        cell: (N,) float64 world length of the anchor's cell.
    """

    lattice: Lattice
    tiles: tuple[Tile, ...]
    tile: I64
    codes: U64
    residual: F64
    cell: F64


def place(positions: F64, wanted_step: F64, tile_anchors: int | None = None) -> Placement:
    """Tiles and cells for (N, 3) positions whose quantiser step should be about (N,) `wanted_step`."""
    low = positions.min(axis=0)
    reach = float(np.abs(positions).max())
    side = float(np.max(positions.max(axis=0) - low))
    side = max(side * (1 + 1e-9), reach * _RELATIVE_FLOOR * 4, 1e-300)
    unit = np.clip((positions - low) / side, 0.0, np.nextafter(1.0, 0.0))
    path = interleave((unit * (1 << MAX_TILE_DEPTH)).astype(np.uint64))
    order = np.argsort(path, kind="stable")
    depth, prefix, first = split(path[order], MAX_TILE_DEPTH, tile_anchors or usual_tile(len(positions)))
    tile = np.empty(len(positions), np.int64)
    tile[order] = np.repeat(np.arange(len(first)), np.diff(np.append(first, len(positions))))
    bits = _local_bits(depth, tile, wanted_step, side, reach)
    lattice_bits = int(max(1, (depth + bits).max()))
    shift = lattice_bits - depth - bits
    tiles = tuple(Tile(int(d), int(s), int(p)) for d, s, p in zip(depth, shift, prefix, strict=True))
    lattice = Lattice((float(low[0]), float(low[1]), float(low[2])), side / 2.0**lattice_bits, lattice_bits)
    return _cells(positions, lattice, tiles, tile, depth, bits)


def usual_tile(count: int) -> int:
    """Most anchors of a tile in a scene of `count`, where nobody asks for another number."""
    return LARGE_SCENE_TILE_ANCHORS if count > LARGE_SCENE else TILE_ANCHORS


def split(path: U64, bits: int, most: int) -> tuple[I64, U64, I64]:
    """The largest cubes that hold at most `most` of the points on sorted paths; at the last bit, more.

    Args:
        path: (n,) Morton codes of `bits` bits an axis, not descending; n >= 1.
        bits: of a path; no cube is deeper.
        most: points of a cube, at least 1.

    Returns:
        Depth, Morton prefix and first point of each cube, in Morton order.
    """
    found: list[tuple[int, int, int]] = []
    stack = [(0, 0, len(path))]
    while stack:
        depth, first, past = stack.pop()
        if past - first <= most or depth == bits:
            found.append((depth, int(path[first]) >> (3 * (bits - depth)), first))
            continue
        digits = path[first:past] >> np.uint64(3 * (bits - depth - 1))
        edges = np.append(np.flatnonzero(np.diff(digits)) + 1, past - first) + first
        begin = first
        for end in edges.tolist():
            stack.append((depth + 1, begin, end))
            begin = end
    found.sort(key=lambda cube: cube[2])
    depths, prefixes, firsts = zip(*found, strict=True)
    return np.array(depths, np.int64), np.array(prefixes, np.uint64), np.array(firsts, np.int64)


def _local_bits(depth: I64, tile: I64, wanted: F64, side: float, reach: float) -> I64:
    order = np.argsort(tile, kind="stable")
    groups = np.split(wanted[order], np.cumsum(np.bincount(tile))[:-1])
    cell = CELL_FACTOR * np.array([np.percentile(group, CELL_PERCENTILE) for group in groups])
    cell = np.maximum(cell, max(reach * _RELATIVE_FLOOR, 1e-300))
    bits = np.ceil(np.log2(np.maximum(side / 2.0**depth / cell, 1.0))).astype(np.int64)
    return np.minimum(bits, np.minimum(MAX_LOCAL_BITS, MAX_LATTICE_BITS - depth))


def _cells(positions: F64, lattice: Lattice, tiles: tuple[Tile, ...], tile: I64, depth: I64, bits: I64) -> Placement:
    prefix = np.array([t.prefix for t in tiles], np.uint64)
    shift = np.array([t.shift for t in tiles], np.int64)
    corner = deinterleave(prefix).astype(np.float64) * 2.0 ** (lattice.bits - depth)[:, None]
    cell = np.exp2(shift.astype(np.float64))
    local = ((positions - np.array(lattice.origin)) / lattice.voxel - corner[tile]) / cell[tile][:, None]
    top = (2.0**bits)[tile][:, None]
    inside = np.clip(np.floor(local), 0, top - 1)
    residual = np.clip(local - inside - 0.5, -0.5, 0.5)
    width: F64 = lattice.voxel * cell[tile]
    return Placement(lattice, tiles, tile, interleave(inside.astype(np.uint64)), residual, width)
