"""Draws and sums of the encoder are those of torch, which they replace: files written with torch's stay the same."""

from __future__ import annotations

import numpy as np
import pytest

from reference_encoder.draws import Draws

torch = pytest.importorskip("torch")


@pytest.mark.parametrize("seed", [0, 7, 2**33 + 5])
def test_permutations_follow_each_other_as_those_of_torch(seed: int) -> None:
    """Each takes as many words from the stream as torch's does."""
    draws, generator = Draws(seed), torch.Generator().manual_seed(seed)
    for count in (1, 2, 1000):
        np.testing.assert_array_equal(draws.permutation(count), torch.randperm(count, generator=generator).numpy())


def test_weighted_draws_are_those_of_torch_multinomial() -> None:
    """Without replacement, in the order torch gives them, weights over many orders of magnitude."""
    weights = (np.random.default_rng(1).random(5000) ** 9 + 1e-20).astype(np.float32)
    draws, generator = Draws(3), torch.Generator().manual_seed(3)
    for count in (1500, 40):
        wanted = torch.multinomial(torch.from_numpy(weights), count, generator=generator).numpy()
        np.testing.assert_array_equal(draws.weighted(weights, count), wanted)
