"""Codebooks: every size of component, every refusal, and latents as plain sums."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from scarfmt.blocks.codebooks import pack_codebooks, unpack_codebooks
from scarfmt.scene.model import MAX_CODEWORDS, MAX_LATENT, Codebooks
from tests.samples.equality import same


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([(0,), (1,), (0, 1)]), st.integers(1, MAX_LATENT))
def test_books_come_back(seed: int, numbers: tuple[int, ...], dimension: int) -> None:
    """Either or both, of any sizes, each dimension with its own range."""
    rng = np.random.default_rng(seed)
    spread = rng.integers(0, 300, dimension)
    books = {n: rng.integers(-spread, spread + 1, (int(rng.integers(1, 40)), dimension)) for n in numbers}
    assert same(unpack_codebooks(pack_codebooks(books)), books)


def test_the_largest_books_come_back() -> None:
    """4096 codewords of 64 dimensions, twice."""
    rng = np.random.default_rng(1)
    books = {n: rng.integers(-(1 << 15), 1 << 15, (MAX_CODEWORDS, MAX_LATENT)) for n in (0, 1)}
    assert same(unpack_codebooks(pack_codebooks(books)), books)


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
