"""The hash grid, for positions in any order; the vectors hold the features of SPEC §10.6."""

from __future__ import annotations

import numpy as np

from scarfmt.neural.grid import MAX_RESOLUTION, GridLevel, HashGrid


def test_the_finest_cells_of_the_largest_box() -> None:
    """Along one axis in Python's integers: products of 48 bits."""
    rng = np.random.default_rng(2)
    bits = rng.integers(0, 2, (1 << 12, 1), np.uint8)
    grid = HashGrid((0, 0, 0), 32, (GridLevel(4, MAX_RESOLUTION, 12, 1),), (bits,))
    positions = rng.integers(0, 1 << 32, (50, 3))
    wanted = []
    for x in (MAX_RESOLUTION * int(position[0]) for position in positions):
        low, high = (2 * int(bits[((x >> 32) + up) % (1 << 12), 0]) - 1 for up in (0, 1))
        fraction = x >> 24 & 255
        wanted.append(min(((256 - fraction) * low + fraction * high + 1) >> 1, 127))
    assert grid.features(positions)[:, 0].tolist() == [max(feature, -127) for feature in wanted]


def test_chunks_and_order_do_not_matter() -> None:
    """Sorted or shuffled, at once or one by one: an anchor's features are its own."""
    rng = np.random.default_rng(5)
    levels = GridLevel(0, 9, 8, 3), GridLevel(2, 40, 12, 4), GridLevel(6, 33, 6, 1)
    bits = tuple(rng.integers(0, 2, (level.entries, level.features)).astype(np.uint8) for level in levels)
    grid = HashGrid((3, 0, 9), 10, levels, bits)
    positions = rng.integers(0, 1030, (20000, 3))
    features = grid.features(positions)
    order = np.lexsort(positions.T)
    assert np.array_equal(grid.features(positions[order]), features[order])
    assert all(
        np.array_equal(grid.features(positions[row : row + 1])[0], features[row]) for row in range(0, 20000, 997)
    )
    assert grid.features(positions[:0]).shape == (0, grid.width)
