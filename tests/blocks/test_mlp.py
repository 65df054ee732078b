"""Networks: extreme weights through the block, quantisation, and the value they compute."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from scarfmt.blocks.mlp import Linear, QuantisedMlp, pack_networks, unpack_networks
from tests.samples.equality import same


def network(seed: int, widths: list[int], bits: int = 8) -> QuantisedMlp:
    rng = np.random.default_rng(seed)
    return QuantisedMlp(
        tuple(
            Linear.quantise(rng.normal(size=(rows, columns)), rng.normal(size=rows), bits)
            for columns, rows in itertools.pairwise(widths)
        )
    )


@pytest.mark.parametrize("extreme", [127, -127, 128, -128, 32767, -32767, -32768])
def test_extreme_weights_come_back(extreme: int) -> None:
    """Weights to both ends of 16 bits; biases and scales bit for bit, negative zero and the least float too."""
    weights = np.array([[1, extreme], [0, 0]], np.int16)
    layer = Linear(weights, np.array([0.5, 1e-45], np.float32), np.array([-0.0, -3], np.float32))
    (found,) = unpack_networks(pack_networks((QuantisedMlp((layer,)),)))
    assert same(found, QuantisedMlp((layer,)))
    assert np.signbit(found.layers[0].biases).tolist() == [True, True]


@pytest.mark.parametrize("bits", [8, 16])
def test_quantised_weights_are_within_half_a_step(bits: int) -> None:
    """Each row on its own scale; rows of zeros stay zero."""
    rng = np.random.default_rng(2)
    weights = rng.normal(size=(5, 7)) * np.array([1e-3, 1, 1e3, 0, 1e-12])[:, None]
    found = Linear.quantise(weights, np.zeros(5), bits)
    assert bool((np.abs(found.matrix - weights) <= 0.5001 * found.scales[:, None]).all())
    top = np.abs(weights).max(axis=1)
    assert np.allclose(found.scales, np.maximum(top, 1e-30) / ((1 << bits - 1) - 1), rtol=1e-6)


def test_networks_compute_relu_between_layers_and_none_after() -> None:
    """In binary32 near the binary64 reference (SPEC §9.5)."""
    net = network(3, [6, 20, 10, 4])
    x = np.random.default_rng(4).normal(size=(50, 6))
    y = x
    for index, part in enumerate(net.layers):
        y = (np.maximum(y, 0) if index else y) @ part.matrix.T + part.biases
    assert np.allclose(net.apply(x, np.float64), y, rtol=1e-12)
    assert net.apply(x).dtype == np.float32
    assert np.allclose(net.apply(x), y, rtol=1e-4, atol=1e-4)
    assert float(y.min()) < 0
