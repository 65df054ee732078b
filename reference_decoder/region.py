"""Which tiles may have something in a box, found by reading no more of the directory than that takes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F64, I64, U64
from scarfmt.codecs.channels import REACH
from scarfmt.coding.reader import SceneReader
from scarfmt.container.directory import Table, corners
from scarfmt.container.schema import TILE_DTYPE
from scarfmt.limits import MAX_TILE_DEPTH
from scarfmt.scene.model import Lattice

Box = tuple[F64, F64]
"""Lowest and highest corner, (3,) each, world units."""


def tile_boxes(lattice: Lattice, tiles: Table) -> tuple[F64, F64]:
    """(T, 3) float64 lowest and highest world coordinates anchors of each tile can have, from the tile table alone.

    A tile's cube, and half a cell all round for residuals of up to one.

    Args:
        tiles: (T,) TILE_DTYPE.
    """
    low = corners(lattice.bits, tiles["depth"], tiles["prefix"])
    size = np.exp2(lattice.bits - tiles["depth"].astype(np.float64))[:, None]
    margin = (REACH - 0.5) * np.exp2(tiles["shift"].astype(np.float64))[:, None]
    origin = np.asarray(lattice.origin, np.float64)
    return origin + lattice.voxel * (low - margin), origin + lattice.voxel * (low + size + margin)


def tiles_meeting(reader: SceneReader, box: Box) -> NDArray[np.bool_]:
    """(T,) bool: tiles that may have an anchor in a box.

    Of a large directory only those tile pages are read that may hold such tiles, as ROOT tells.

    Raises:
        Malformed, Truncated, Unsupported, LimitExceeded: what was read of the directory is refused (SPEC §12).
    """
    container, header = reader.container, reader.header
    pages = pages_meeting(reader.lattice, container.root.pages["base"], box)
    ranges = [np.arange(found.start, found.stop) for found in map(header.page_range, pages.tolist())]
    tiles = np.concatenate([np.zeros(0, np.int64), *ranges])
    out = np.zeros(header.tile_count, bool)
    out[tiles] = _meet(tile_boxes(reader.lattice, container.tile_rows(tiles)), box)
    return out


def pages_meeting(lattice: Lattice, bases: U64, box: Box) -> I64:
    """Numbers, ascending, of the tile pages that may hold a tile with an anchor in a box.

    Tiles follow the Morton order: page p holds cubes between its base and that of page p + 1. The octree is walked from
    its root: what misses the box is left, what lies within one page names it, and anything else is divided.

    Args:
        bases: (P,) Morton codes at which pages begin, ascending, as ROOT has them.
        box: in world units.
    """
    found: list[I64] = []
    prefixes = np.zeros(1, np.uint64)
    for depth in range(MAX_TILE_DEPTH + 1):
        prefixes = prefixes[_nodes_meet(lattice, depth, prefixes, box)]
        free = np.uint64(3 * (MAX_TILE_DEPTH - depth))
        first = prefixes << free
        last = first + ((np.uint64(1) << free) - np.uint64(1))
        low, high = (np.searchsorted(bases, edge, side="right") - 1 for edge in (first, last))
        within = low == high
        found.append(low[within & (low >= 0)])
        eight = np.arange(8, dtype=np.uint64)
        prefixes = ((prefixes[~within] << np.uint64(3))[:, None] | eight).ravel()
    return np.unique(np.concatenate(found)).astype(np.int64)


def _nodes_meet(lattice: Lattice, depth: int, prefixes: U64, box: Box) -> NDArray[np.bool_]:
    """(n,) bool: nodes of a depth in which a tile may have an anchor in a box.

    How far anchors reach beyond a tile depends on its shift, which ROOT does not tell; it is at most bits - depth.
    """
    rows = np.zeros(len(prefixes), TILE_DTYPE)
    rows["depth"], rows["shift"], rows["prefix"] = depth, max(0, lattice.bits - depth), prefixes
    return _meet(tile_boxes(lattice, rows), box)


def _meet(boxes: Box, box: Box) -> NDArray[np.bool_]:
    return np.asarray(((boxes[0] <= box[1]) & (boxes[1] >= box[0])).all(axis=1))
