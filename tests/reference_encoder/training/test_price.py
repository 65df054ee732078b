"""Prices of bits: fixed, or such that prefixes get their sizes."""

import pytest

from reference_encoder.training.price import Prices


def test_a_fixed_price_stays() -> None:
    """Without sizes wanted, what is seen changes nothing."""
    prices = Prices([0.2, 0.1], 1000, None)
    prices.saw(0, 1e6)
    assert prices.a_bit(0) == pytest.approx(0.2 / 1000)


def test_what_is_too_large_gets_dear_and_what_is_too_small_cheap() -> None:
    """The price follows the size, corrected by what the writer really made of it."""
    prices = Prices([0.1, 0.1], 1000, [1000.0, 1000.0])
    for _ in range(50):
        prices.saw(0, 8 * 2000.0)
        prices.saw(1, 8 * 500.0)
    assert prices.price[0] > 0.1 > prices.price[1]
    assert prices.a_bit(0) > prices.price[0] / 1000
    prices.wrote([1000, 500])
    assert prices.real == [pytest.approx(0.5), pytest.approx(1.0)]
    assert prices.a_bit(0) == pytest.approx(prices.price[0] / 1000)
