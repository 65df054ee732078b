"""Cutting a scene into ranges of the Morton order by what its cells hold: borders are those of tiles.

Tiles are the largest cubes of the octree that hold few enough anchors (:func:`reference_encoder.decide.lattice.split`).
A range is some of them, one after the other; a cell that holds more than a tile is divided within its range.
"""

from __future__ import annotations

import numpy as np

from reference_encoder.scale.scan import Cells
from reference_encoder.scale.steps import Range
from scarfmt.arrays import I64, U64
from scarfmt.limits import MAX_TILE_DEPTH

END = 1 << 3 * MAX_TILE_DEPTH
"""One past the last Morton code."""


def cut(cells: Cells, range_size: int, tile_anchors: int) -> tuple[Range, ...]:
    """Ranges that hold about equally many, at most about `range_size` Gaussians; together they are everything.

    Args:
        cells: what lies where.
        range_size: Gaussians of a range.
        tile_anchors: most Gaussians of a tile.
    """
    first, counts = cubes(cells, tile_anchors)
    past = np.cumsum(counts)
    total = int(past[-1])
    wanted = -(-total // range_size)
    # The first cube that ends at or after each equal share of the scene is the last of a range.
    last = np.searchsorted(past, np.arange(1, wanted + 1) * total / wanted)
    last = np.unique(np.minimum(last, len(past) - 1))
    held = np.diff(past[last], prepend=0)
    begins = [0, *(int(first[cube + 1]) for cube in last[:-1])]
    return tuple(
        Range(number, begin, end, int(count))
        for number, (begin, end, count) in enumerate(zip(begins, [*begins[1:], END], held, strict=True))
    )


def cubes(cells: Cells, most: int) -> tuple[U64, I64]:
    """The largest cubes that hold at most `most` Gaussians each, and cells that hold more, in Morton order.

    Returns:
        (n,) uint64 Morton code at `MAX_TILE_DEPTH` at which each begins; (n,) int64 Gaussians in each.
    """
    before = np.concatenate(([0], np.cumsum(cells.count)))
    found: list[tuple[int, int]] = []
    stack = [(0, 0, len(cells.count))]
    while stack:
        depth, first, past = stack.pop()
        whole = past - first == 1 and cells.depth[first] <= depth
        if whole or before[past] - before[first] <= most:
            found.append((first, depth))
            continue
        digits = cells.first[first:past] >> np.uint64(3 * (MAX_TILE_DEPTH - depth - 1))
        edges = np.append(np.flatnonzero(np.diff(digits)) + 1, past - first) + first
        begin = first
        for end in edges.tolist():
            stack.append((depth + 1, begin, end))
            begin = end
    found.sort()
    begins, depths = np.array(found, np.int64).T
    # A cube may begin before the first of its cells that hold something.
    free = (3 * (MAX_TILE_DEPTH - depths)).astype(np.uint64)
    return cells.first[begins] >> free << free, np.diff(before[np.append(begins, len(cells.count))])
