"""HASH_GRID blocks: every grid comes back, its layout is the written one, and damage is refused."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from scarfmt.blocks.hash_grid import pack_grid, unpack_grid
from scarfmt.neural.grid import MAX_LEVELS, MAX_RESOLUTION, GridLevel, HashGrid
from tests.samples.equality import same

LEVELS = st.builds(GridLevel, st.integers(0, 6), st.integers(1, MAX_RESOLUTION), st.integers(1, 9), st.integers(1, 8))


def random_grid(levels: list[GridLevel], seed: int) -> HashGrid:
    """Any box; each table of its own density of ones, 0 and 1 among them."""
    rng = np.random.default_rng(seed)
    chances = rng.choice([0.0, 0.02, 0.5, rng.random(), 1.0], len(levels))
    bits = tuple(
        (rng.random((level.entries, level.features)) < chance).astype(np.uint8)
        for level, chance in zip(levels, chances, strict=True)
    )
    x, y, z = rng.integers(0, 2**32, 3).tolist()
    return HashGrid((x, y, z), int(rng.integers(0, 33)), tuple(levels), bits)


@settings(deadline=None)
@given(st.lists(LEVELS, min_size=1, max_size=MAX_LEVELS), st.integers(0, 2**32 - 1))
def test_grids_come_back(levels: list[GridLevel], seed: int) -> None:
    """Any levels, any density of ones."""
    grid = random_grid(levels, seed)
    found = unpack_grid(pack_grid(grid))
    assert same(found, grid)


def test_tables_of_few_ones_are_small() -> None:
    """One bit in a hundred costs what its entropy says, not a bit."""
    rng = np.random.default_rng(3)
    bits = (rng.random((1 << 15, 4)) < 0.01).astype(np.uint8)
    size = len(pack_grid(HashGrid((0, 0, 0), 8, (GridLevel(0, 100, 15, 4),), (bits,))))
    assert size < 1.05 * bits.size * 0.0808 / 8 + 40
