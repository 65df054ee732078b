"""Compiled loops do what NumPy does."""

from __future__ import annotations

import numpy as np
import pytest

from reference_encoder.loops import add_products, first_of_least, powers, summed, top_of


def test_powers_of_two() -> None:
    """To 1e-4 where it matters, and never above 1."""
    x = np.linspace(-31, 0, 1001, dtype=np.float32)
    out = np.empty_like(x)
    powers(x, out)
    assert np.allclose(out, 2.0**x, rtol=1e-3)
    assert np.allclose(out[x > -12], 2.0 ** x[x > -12], rtol=5e-5)
    assert out.max() <= 1.0


@pytest.mark.parametrize("width", [0, 1, 3, 4, 9])
def test_products_are_added(width: int) -> None:
    """For widths that are and are not whole groups of four."""
    draw = np.random.default_rng(width)
    output, vectors = draw.normal(size=width).astype(np.float32), draw.normal(size=(width, 21)).astype(np.float32)
    out = draw.normal(size=21).astype(np.float32)
    expected = out + output @ vectors
    add_products(output, vectors, out)
    assert np.allclose(out, expected, atol=1e-5)


@pytest.mark.parametrize("count", [1, 7, 64, 1000])
def test_extremes_and_sums(count: int) -> None:
    """The first of several smallest values, infinite ones included."""
    values = np.random.default_rng(count).integers(0, 30, count).astype(np.float32)
    values[count // 2 :: 3] = np.inf
    assert first_of_least(values) == int(values.argmin())
    finite = np.where(np.isinf(values), np.float32(0), values)
    assert top_of(finite) == finite.max()
    assert summed(finite) == finite.sum()
    assert first_of_least(np.full(5, np.inf, np.float32)) == 0
