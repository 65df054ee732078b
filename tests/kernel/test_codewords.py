"""The compiled search for codewords: the codes of the encoder's own loop."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from reference_encoder.latent.rvq import _fill_nearest
from reference_encoder.sums import squared_lengths
from scarfmt.arrays import F32, I64
from scarfmt.kernel.codewords import TOGETHER, KernelCodewords
from scarfmt.kernel.memory import at_lines
from tests.kernel.samples import SEEDS, library, needs_kernel

pytestmark = needs_kernel


def _both(x: F32, weight: F32, classes: I64, book: F32, prices: F32) -> tuple[I64, I64]:
    """Codes by the library, and by the loop that defines them."""
    words, half = np.ascontiguousarray(-book.T), np.asarray(squared_lengths(book) / 2, np.float32)
    compiled, defined = np.full(len(x), -1), np.full(len(x), -1)
    KernelCodewords(library(), words, half, prices).fill(x, weight, classes, compiled)
    _fill_nearest(x, weight, classes, words, half, prices, defined)
    return compiled, defined


@settings(deadline=None, max_examples=60)
@given(SEEDS, st.integers(0, 40), st.integers(1, 3 * TOGETHER), st.integers(1, 26), st.integers(1, 5))
def test_codes(seed: int, count: int, size: int, dimension: int, classes: int) -> None:
    """Every sum is rounded as in the definition, whatever the sizes: neither prices nor near ties are decided anew."""
    rng = np.random.default_rng(seed)
    book = rng.normal(0, 30, (size, dimension)).astype(np.float32)
    # Between two codewords, where the last bit of a sum decides.
    ends = book[rng.integers(0, size, (2, count))]
    x = np.ascontiguousarray((ends[0] + ends[1]) / 2)
    weight = rng.choice(np.array([0, 0.25, 1.7], np.float32), count)
    prices = rng.choice(np.array([0, 0.5, 9.3], np.float32), (classes, size))
    compiled, defined = _both(x, weight, rng.integers(0, classes, count), book, prices)
    assert np.array_equal(compiled, defined)


@settings(deadline=None, max_examples=40)
@given(SEEDS, st.integers(1, 3 * TOGETHER), st.integers(1, 9))
def test_the_first_of_equals(seed: int, size: int, dimension: int) -> None:
    """Of codewords that are alike the first is chosen, in whatever lane it is scored."""
    rng = np.random.default_rng(seed)
    book = rng.integers(0, 2, (size, dimension)).astype(np.float32)
    x = rng.integers(0, 2, (30, dimension)).astype(np.float32)
    none = np.zeros((1, size), np.float32)
    compiled, defined = _both(x, np.full(30, 0.5, np.float32), np.zeros(30, np.int64), book, none)
    assert np.array_equal(compiled, defined)
    distances = ((x[:, None] - book) ** 2).sum(axis=2)
    assert np.array_equal(compiled, distances.argmin(axis=1))


def test_what_fills_up_is_never_chosen() -> None:
    """A codebook of less than a block: far vectors and those of no weight find a codeword that it has."""
    book = np.array([[3.0], [1.0]], np.float32)
    x, weight = np.array([[0.0], [1e30], [-1e30], [7.0]], np.float32), np.array([1, 1, 1, 0], np.float32)
    compiled, _ = _both(x, weight, np.zeros(4, np.int64), book, np.array([[5.0, 4.0]], np.float32))
    assert compiled.tolist() == [1, 0, 1, 1]


def test_arrays_that_do_not_fit_are_refused() -> None:
    """Memory is never read as what it is not, or past its end."""
    search = KernelCodewords(library(), *(np.zeros(shape, np.float32) for shape in ((3, 8), (8,), (2, 8))))
    x, weight, classes, out = (np.zeros((4, 3), np.float32), np.zeros(4, np.float32), *np.zeros((2, 4), np.int64))
    others: list[tuple[Any, Any, Any, Any]] = [
        (x[:, :2], weight, classes, out),
        (x[1:], weight, classes, out),
        (x, weight[1:], classes, out),
        (x, weight, classes[1:], out),
        (x.astype(np.float64), weight, classes, out),
        (x, weight, classes, out.astype(np.int32)),
    ]
    for arrays in others:
        with pytest.raises(TypeError):
            search.fill(*arrays)
    for number in (-1, 2):
        with pytest.raises(IndexError):
            search.fill(x, weight, np.full(4, number), out)


def test_at_lines() -> None:
    """A copy of the same numbers that begins at a multiple of 64 bytes."""
    for size in (1, 5, 64):
        array = np.arange(3 * size, dtype=np.float32).reshape(3, size)
        copy = at_lines(array)
        assert copy.ctypes.data % 64 == 0
        assert copy.shape == (3, size)
        assert np.array_equal(copy, array)
