"""The hash grid: exactly the definition of SPEC §10.6, for any positions, in any order."""

from __future__ import annotations

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from scarfmt.neural.grid import MAX_EXTENT_BITS, MAX_RESOLUTION, MAX_TABLE_LOG2, GridLevel, HashGrid, check_grid

AXES = {0: "xyz", 1: "xy", 2: "xz", 3: "yz", 4: "x", 5: "y", 6: "z"}


def literal_features(grid: HashGrid, position: list[int]) -> list[int]:
    """SPEC §10.6 for one anchor, in Python integers."""
    k, found = grid.extent_bits, []
    inside = [min(max(p - o, 0), 2**k - 1) for p, o in zip(position, grid.origin, strict=True)]
    for level, bits in zip(grid.levels, grid.bits, strict=True):
        cells, fractions = [], []
        for axis in AXES[level.plane]:
            x = inside["xyz".index(axis)] * level.resolution
            cells.append(x >> k)
            fractions.append((x >> (k - 8) if k >= 8 else x << (8 - k)) & 255)
        dims = len(cells)
        for feature in range(level.features):
            total = 0
            for vertex in range(2**dims):
                up = [vertex >> d & 1 for d in range(dims)]
                weight = 1
                for d in range(dims):
                    weight *= fractions[d] if up[d] else 256 - fractions[d]
                entry = literal_address(level, [cells[d] + up[d] for d in range(dims)])
                total += weight * (1 if bits[entry, feature] else -1)
            shift = 8 * dims - 7
            found.append(min(max((total + (1 << (shift - 1))) >> shift, -127), 127))
    return found


def literal_address(level: GridLevel, vertex: list[int]) -> int:
    """The table entry of a vertex."""
    side = level.resolution + 1
    if side ** len(vertex) <= 2**level.table_log2:
        return sum(coordinate * side**d for d, coordinate in enumerate(vertex))
    entry = 0
    for coordinate, prime in zip(vertex, (1, 2654435761, 805459861), strict=False):
        entry ^= coordinate * prime % 2**32
    return entry % 2**level.table_log2


def grid_of(levels: list[GridLevel], extent_bits: int, seed: int, origin: tuple[int, int, int] = (0, 0, 0)) -> HashGrid:
    """Random bits of any density."""
    rng = np.random.default_rng(seed)
    bits = tuple((rng.random((level.entries, level.features)) < rng.random()).astype(np.uint8) for level in levels)
    return HashGrid(origin, extent_bits, tuple(levels), bits)


LEVELS = st.builds(
    GridLevel,
    st.integers(0, 6),
    st.one_of(st.integers(1, 70), st.integers(1, MAX_RESOLUTION)),
    st.integers(1, 12),
    st.integers(1, 8),
)


@given(
    st.lists(LEVELS, min_size=1, max_size=4),
    st.integers(0, MAX_EXTENT_BITS),
    st.tuples(*[st.integers(0, 2**32 - 1)] * 3),
    st.integers(0, 2**32 - 1),
)
@example([GridLevel(0, MAX_RESOLUTION, MAX_TABLE_LOG2, 8)], 32, (0, 0, 0), 1)
@example([GridLevel(0, 1, 3, 1), GridLevel(3, 5, 4, 3)], 0, (2**32 - 1, 0, 0), 2)
@example([GridLevel(0, 3, 6, 2), GridLevel(2, 3, 4, 1), GridLevel(6, 3, 2, 1)], 9, (0, 0, 0), 4)
@example([GridLevel(1, 300, 12, 2), GridLevel(5, 300, 12, 2)], 3, (7, 7, 7), 3)
def test_features_are_the_definition(
    levels: list[GridLevel], extent_bits: int, origin: tuple[int, int, int], seed: int
) -> None:
    """Dense and hashed tables, every plane, boxes of one point to 2^32, anchors inside, at and beyond the border."""
    grid = grid_of(levels, extent_bits, seed, origin)
    check_grid(grid.box, grid.levels)
    side, rng = 1 << extent_bits, np.random.default_rng(seed)
    inside = np.array(origin) + rng.integers(0, side, (6, 3))
    border = np.array(origin) + rng.choice([-1, 0, side - 1, side], (4, 3))
    positions = np.clip(np.concatenate([inside, border, rng.integers(0, 2**32, (2, 3))]), 0, 2**33)
    wanted = [literal_features(grid, row) for row in positions.tolist()]
    assert grid.features(positions).tolist() == wanted
    assert grid.features(positions.astype(np.uint64)).dtype == np.int16


def test_chunks_and_order_do_not_matter() -> None:
    """Sorted or shuffled, at once or one by one: an anchor's features are its own."""
    rng = np.random.default_rng(5)
    grid = grid_of([GridLevel(0, 9, 8, 3), GridLevel(2, 40, 12, 4), GridLevel(6, 33, 6, 1)], 10, 5, (3, 0, 9))
    positions = rng.integers(0, 1030, (20000, 3))
    features = grid.features(positions)
    order = np.lexsort(positions.T)
    assert np.array_equal(grid.features(positions[order]), features[order])
    assert all(
        np.array_equal(grid.features(positions[row : row + 1])[0], features[row]) for row in range(0, 20000, 997)
    )
    assert grid.features(positions[:0]).shape == (0, grid.width)
