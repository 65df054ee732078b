"""HASH_GRID blocks: their size."""

from __future__ import annotations

import numpy as np

from scarfmt.blocks.hash_grid import pack_grid
from scarfmt.neural.grid import GridLevel, HashGrid


def test_tables_of_few_ones_are_small() -> None:
    """One bit in a hundred costs what its entropy says, not a bit."""
    rng = np.random.default_rng(3)
    bits = (rng.random((1 << 15, 4)) < 0.01).astype(np.uint8)
    size = len(pack_grid(HashGrid((0, 0, 0), 8, (GridLevel(0, 100, 15, 4),), (bits,))))
    assert size < 1.05 * bits.size * 0.0808 / 8 + 40
