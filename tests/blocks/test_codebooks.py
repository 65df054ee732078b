"""Codebooks: latents as plain sums."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from scarfmt.scene.model import Codebooks


@given(st.integers(0, 2**32 - 1))
def test_latents_are_sums_of_the_stages_received(seed: int) -> None:
    """Stage 1 from the coarse book, later ones from the residual, none at all for 0 stages."""
    rng = np.random.default_rng(seed)
    books = Codebooks(rng.integers(-60, 60, (9, 4)), rng.integers(-9, 9, (5, 4)))
    stages, indices = rng.integers(0, 4, 12), rng.integers(0, 5, (12, 3))
    wanted = np.zeros((12, 4), np.int64)
    for row in range(12):
        for stage in range(stages[row]):
            wanted[row] += (books.residual if stage else books.coarse)[indices[row, stage]]
    assert np.array_equal(books.latents(indices, stages), wanted)
    assert (books.dimension, books.sizes) == (4, (9, 5))
