"""Networks: extreme weights through the block, quantisation, and the value they compute."""

from __future__ import annotations

import numpy as np
import pytest

from scarfmt.blocks.mlp import Linear


@pytest.mark.parametrize("bits", [8, 16])
def test_quantised_weights_are_within_half_a_step(bits: int) -> None:
    """Each row on its own scale; rows of zeros stay zero."""
    rng = np.random.default_rng(2)
    weights = rng.normal(size=(5, 7)) * np.array([1e-3, 1, 1e3, 0, 1e-12])[:, None]
    found = Linear.quantise(weights, np.zeros(5), bits)
    assert bool((np.abs(found.matrix - weights) <= 0.5001 * found.scales[:, None]).all())
    top = np.abs(weights).max(axis=1)
    assert np.allclose(found.scales, np.maximum(top, 1e-30) / ((1 << bits - 1) - 1), rtol=1e-6)
