"""Prices of bits: fixed, or such that prefixes get their sizes."""

import pytest
import torch

from reference_encoder.training.masks import Worth, first_layers
from reference_encoder.training.price import Prices


def found(count: int = 500) -> Worth:
    """Slots of very different worth."""
    generator = torch.Generator().manual_seed(0)
    benefit = torch.exp(4 * torch.randn(count, 10, generator=generator))
    return Worth(benefit, torch.full((count, 10), 15.0), (torch.full((count,), 60.0), torch.full((count,), 80.0)))


def test_a_fixed_price_stays() -> None:
    """Without sizes wanted, what is seen changes nothing, and rate comes in by its weight."""
    prices, worth = Prices([0.2, 0.1], 1000, None), found()
    prices.saw(0, 1e6)
    assert prices.a_bit(0) == pytest.approx(0.2 / 1000)
    assert prices.follow(worth, worth.benefit > 0, 0.5) == pytest.approx([1e-4, 5e-5])


def test_prefixes_get_their_sizes() -> None:
    """The price of each layer is the one at which it takes the bytes that are wanted, as the writer counts them."""
    worth = found()
    allowed = worth.benefit > 0
    whole = worth.bits(1, allowed) / 8
    prices = Prices([1.0, 1.0], 1, [0.2 * whole, 0.95 * whole])
    prices.estimate = [100.0, 100.0]
    prices.wrote([200, 100])
    chosen = prices.follow(worth, allowed, 1.0)
    first = first_layers(worth, chosen, allowed)
    assert worth.bits(0, first == 0) / 8 == pytest.approx(0.1 * whole, rel=0.03)
    assert worth.bits(1, first <= 1) / 8 == pytest.approx(0.95 * whole, rel=0.03)


def test_the_last_layer_shrinks_slowly() -> None:
    """What closes in the last layer never opens again, so that no decision takes more than a part."""
    worth = found()
    allowed = worth.benefit > 0
    whole = worth.bits(1, allowed) / 8
    prices = Prices([1.0, 1.0], 1, [0.01 * whole, 0.1 * whole])
    first = first_layers(worth, prices.follow(worth, allowed, 1.0), allowed)
    assert worth.bits(1, first <= 1) / 8 >= 0.84 * whole
