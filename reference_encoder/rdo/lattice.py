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
from scarfmt.errors import InvalidInput
from scarfmt.limits import MAX_LATTICE_BITS, MAX_LOCAL_BITS, MAX_TILE_DEPTH
from scarfmt.scene.model import Lattice

FAR = 2.0**20
"""Sizes of a scene, from its middle, beyond which a Gaussian is none of its parts: with it in the lattice, all others
would share a few cells."""
FEW = 1e-3
"""Part of a scene that may be as far."""
RELATIVE_FLOOR = 2.0**-44
"""Never finer than this fraction of the magnitude of the coordinates: binary64 has no more to give."""


def find_far(positions: F64) -> I64:
    """Rows of (N, 3) positions so far from the rest that no lattice holds both, ascending; none if many are."""
    low, middle, high = np.percentile(positions, (100 * FEW, 50, 100 - 100 * FEW), axis=0)
    with np.errstate(over="ignore"):
        far = np.flatnonzero(np.abs(positions - middle).max(axis=1) > FAR * float((high - low).max()))
    return far if len(far) <= max(1, FEW * len(positions)) and (high > low).any() else far[:0]


def check_crowd(positions: F64, most: int) -> None:
    """Refuse (N, 3) positions of which more than `most` are one: no tile is smaller than a place.

    Raises:
        InvalidInput: ``input-crowded``.
    """
    if len(positions) <= most:
        return
    with np.errstate(over="ignore", invalid="ignore"):
        mixed = positions @ np.array([1.0, np.sqrt(2), np.sqrt(3)])  # equal of equal places, and quick to sort
    _, inverse, counts = np.unique(mixed, return_inverse=True, return_counts=True)
    rows, counts = np.unique(positions[counts[inverse] > most], axis=0, return_counts=True)
    if counts.max(initial=0) > most:
        place = ", ".join(f"{value:g}" for value in rows[np.argmax(counts)])
        message = f"{counts.max():,} Gaussians lie at one place ({place}); a file holds {most:,} there: remove copies"
        raise InvalidInput("input-crowded", message, field="positions")


@dataclass(frozen=True)
class RootCube:
    """The cube that all tiles lie in.

    Attributes:
        low: its corner, world units.
        side: of it.
        reach: the largest magnitude of a coordinate in it.
    """

    low: tuple[float, float, float]
    side: float
    reach: float

    @classmethod
    def around(cls, low: F64, high: F64) -> RootCube:
        """The smallest that holds what lies between two corners, (3,) each."""
        reach = float(max(np.abs(low).max(), np.abs(high).max()))
        side = float(np.max(high - low))
        side = max(side * (1 + 1e-9), reach * RELATIVE_FLOOR * 4, 1e-300)
        return cls((float(low[0]), float(low[1]), float(low[2])), side, reach)

    def paths(self, positions: F64) -> U64:
        """(N,) Morton codes of `MAX_TILE_DEPTH` bits an axis of (N, 3) positions."""
        unit = np.clip((positions - np.array(self.low)) / self.side, 0.0, np.nextafter(1.0, 0.0))
        return interleave((unit * (1 << MAX_TILE_DEPTH)).astype(np.uint64))


@dataclass(frozen=True)
class Placement:
    """The place of each anchor.

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


def place(
    positions: F64,
    wanted_step: F64,
    tile_anchors: int | None = None,
    root: RootCube | None = None,
    lattice_bits: int | None = None,
    within: tuple[int, int] | None = None,
) -> Placement:
    """Tiles and cells for N >= 1 anchors.

    Args:
        positions: (N, 3), all in the interval.
        wanted_step: (N,) about what the quantiser step should be.
        tile_anchors: most anchors of a tile; None for what is usual.
        root: that tiles lie in; None for what these span.
        lattice_bits: of the lattice, at least `MAX_TILE_DEPTH`; None for as many as give every tile the cells that it
            wants.
        within: no tile reaches beyond this interval of the Morton order: the first code of `MAX_TILE_DEPTH` bits an
            axis, and the one past the last; None for all.
    """
    root = root or RootCube.around(positions.min(axis=0), positions.max(axis=0))
    most = tile_anchors or default_tile_size(len(positions))
    depth, prefix, tile = assign_tiles(root.paths(positions), MAX_TILE_DEPTH, most, within)
    bits = _local_bits(depth, tile, wanted_step, root)
    if lattice_bits is None:
        lattice_bits = int(max(1, (depth + bits).max()))
    bits = np.minimum(bits, lattice_bits - depth)
    shift = lattice_bits - depth - bits
    rows = zip(depth, shift, prefix, strict=True)
    tiles = tuple(Tile(int(d), int(s), int(p)) for d, s, p in rows)
    lattice = Lattice(root.low, root.side / 2.0**lattice_bits, lattice_bits)
    corner = deinterleave(prefix).astype(np.float64) * 2.0 ** (lattice_bits - depth)[:, None]
    cell = np.exp2(shift.astype(np.float64))
    local = ((positions - np.array(lattice.origin)) / lattice.voxel - corner[tile]) / cell[tile][:, None]
    top = (2.0**bits)[tile][:, None]
    inside = np.clip(np.floor(local), 0, top - 1)
    residual = np.clip(local - inside - 0.5, -0.5, 0.5)
    width: F64 = lattice.voxel * cell[tile]
    return Placement(lattice, tiles, tile, interleave(inside.astype(np.uint64)), residual, width)


def count_lattice_bits(positions: F64, wanted_step: F64, root: RootCube, tile_anchors: int) -> int:
    """Bits of a lattice that gives every tile the cells that it wants."""
    depth, _, tile = assign_tiles(root.paths(positions), MAX_TILE_DEPTH, tile_anchors)
    return int((depth + _local_bits(depth, tile, wanted_step, root)).max())


def assign_tiles(path: U64, bits: int, most: int, within: tuple[int, int] | None = None) -> tuple[I64, U64, I64]:
    """Depth and Morton prefix, (T,) each, of the cubes of tiles, and the (N,) int64 tile of each point.

    Arguments are those of :func:`cut_cubes`, but for points in any order.
    """
    order = np.argsort(path, kind="stable")
    depth, prefix, first = cut_cubes(path[order], bits, most, within)
    tile = np.empty(len(path), np.int64)
    tile[order] = np.repeat(np.arange(len(first)), np.diff(np.append(first, len(path))))
    return depth, prefix, tile


def default_tile_size(count: int) -> int:
    """Most anchors of a tile in a scene of `count`, where nobody asks for another number."""
    return LARGE_SCENE_TILE_ANCHORS if count > LARGE_SCENE else TILE_ANCHORS


def cut_cubes(
    path: U64,
    bits: int,
    most: int,
    within: tuple[int, int] | None = None,
    cells: tuple[I64, I64] | None = None,
) -> tuple[I64, U64, I64]:
    """The largest cubes that hold at most `most` of the points on sorted paths; those that cannot be divided, more.

    Args:
        path: (n,) Morton codes of `bits` bits an axis, not descending; n >= 1.
        bits: of a path; no cube is deeper.
        most: points of a cube, at least 1.
        within: codes that cubes do not reach beyond, the first and the one past the last; None for all.
        cells: (n,) depths of cells that begin at the codes, and (n,) points in each; None for a point at each code.

    Returns:
        Depth, Morton prefix and first point of each cube, in Morton order.
    """
    depths, counts = (None, np.ones(len(path), np.int64)) if cells is None else cells
    before = np.concatenate(([0], np.cumsum(counts)))
    found: list[tuple[int, int, int]] = []
    stack = [(0, 0, len(path))]
    while stack:
        depth, first, past = stack.pop()
        free = 3 * (bits - depth)
        prefix = int(path[first]) >> free
        fits = within is None or (prefix << free >= within[0] and (prefix + 1) << free <= within[1])
        whole = depth == bits or (depths is not None and past - first == 1 and depths[first] <= depth)
        if (fits and before[past] - before[first] <= most) or whole:
            found.append((depth, prefix, first))
            continue
        digits = path[first:past] >> np.uint64(3 * (bits - depth - 1))
        edges = np.append(np.flatnonzero(np.diff(digits)) + 1, past - first) + first
        begin = first
        for end in edges.tolist():
            stack.append((depth + 1, begin, end))
            begin = end
    found.sort(key=lambda cube: cube[2])
    found_depths, prefixes, firsts = zip(*found, strict=True)
    return np.array(found_depths, np.int64), np.array(prefixes, np.uint64), np.array(firsts, np.int64)


def _local_bits(depth: I64, tile: I64, wanted: F64, root: RootCube) -> I64:
    order = np.argsort(tile, kind="stable")
    groups = np.split(wanted[order], np.cumsum(np.bincount(tile))[:-1])
    cell = CELL_FACTOR * np.array([np.percentile(group, CELL_PERCENTILE) for group in groups])
    cell = np.maximum(cell, max(root.reach * RELATIVE_FLOOR, 1e-300))
    bits = np.ceil(np.log2(np.maximum(root.side / 2.0**depth / cell, 1.0))).astype(np.int64)
    return np.minimum(bits, np.minimum(MAX_LOCAL_BITS, MAX_LATTICE_BITS - depth))
