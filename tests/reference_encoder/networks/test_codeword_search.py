"""Clusters left unopened hold nothing that matters: the search finds what pricing every codeword finds."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from reference_encoder.networks.codeword_search import CodewordSearch
from reference_encoder.networks.head import HeadModel
from reference_encoder.networks.shape import NetworkShape

SHAPE = NetworkShape(hidden=8, middle=8, mixer=8, codeword_dims=6)
DIMS = 6


def _head(draw: np.random.Generator, sizes: tuple[int, ...], count: int) -> tuple[torch.Tensor, HeadModel]:
    """A book of like codewords side by side, and a head that has its opinions of them."""
    centres = np.repeat(draw.normal(0, 40, (len(sizes) or count, DIMS)), sizes or (1,) * count, axis=0)
    words = np.rint(centres + draw.normal(0, 8, (count, DIMS))).astype(np.int64)
    words[0] = 0
    head = HeadModel(SHAPE, words, sizes, torch.Generator().manual_seed(1))
    for number in range(len(head.levels)):
        level = head.level(number)
        level.beta.data = torch.from_numpy(draw.normal(0, 1.5, len(level.beta)).astype(np.float32))
    return torch.from_numpy(words.astype(np.float32)), head


def _all_bits(head: HeadModel, y: torch.Tensor, count: int) -> torch.Tensor:
    return torch.stack([head.bits(y, torch.full((len(y),), code), True) for code in range(count)], 1)


@pytest.mark.parametrize("sizes", [(), (1, 9, 10, 12), (1, 1, 8, 30)])
@pytest.mark.parametrize("wide", [1, 4])
def test_the_cheapest_are_found(sizes: tuple[int, ...], wide: int) -> None:
    """Nearly always: a codeword that costs its cluster next to nothing may be missed behind many others."""
    draw, count, anchors, keep = np.random.default_rng(wide), sum(sizes) or 24, 150, 5
    words, head = _head(draw, sizes, count)
    rows = anchors * wide
    left = torch.from_numpy(draw.normal(0, 40, (rows, DIMS)).astype(np.float32))
    y = torch.from_numpy(draw.integers(0, 200, (rows, SHAPE.mixer)).astype(np.float32))
    spent = torch.from_numpy(draw.uniform(0, 9, rows).astype(np.float32))
    worth = torch.from_numpy((10.0 ** draw.uniform(-4, -1, anchors)).astype(np.float32))
    slope = torch.from_numpy(draw.uniform(0.1, 1, DIMS).astype(np.float32))
    with torch.no_grad():
        number, code, bits = CodewordSearch.of(words, head).cheapest(left, y, spent, worth, slope, keep)
        prices = spent[:, None] + _all_bits(head, y, count)
        distances = ((left[:, None] - words) ** 2 * slope).sum(2) * worth.repeat_interleave(wide)[:, None]
        costs = (prices + distances).reshape(anchors, -1)
        best = costs.topk(keep, 1, largest=False).values
        found = costs.gather(1, number * count + code)
    assert torch.allclose(found[:, 0], best[:, 0], rtol=1e-3, atol=0.05)
    assert (found - best).abs().mean() < 0.02
    assert (torch.diff(found, dim=1) > -0.02).all()
    assert torch.allclose(bits, prices.reshape(anchors, -1).gather(1, number * count + code), rtol=1e-3, atol=2e-3)
    for row in (number * count + code).tolist():
        assert len(set(row)) == keep
