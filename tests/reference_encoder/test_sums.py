"""Sums in one order of additions: the order of torch, so that files written with torch's sums stay the same."""

from __future__ import annotations

import numpy as np
import pytest

from reference_encoder.sums import added_rows, row_sums, squared_lengths, subtract_rows

torch = pytest.importorskip("torch")


@pytest.mark.parametrize("width", [1, 3, 7, 8, 9, 31, 32, 33, 45, 48, 100, 512, 1000, 1024, 4096])
def test_row_sums_have_the_bits_of_torch(width: int) -> None:
    """In every width that codebooks and latents have: lanes, shares, and from 512 on levels."""
    values = np.random.default_rng(width).standard_normal((50, width)).astype(np.float32)
    np.testing.assert_array_equal(row_sums(values), torch.from_numpy(values).sum(1).numpy())
    np.testing.assert_array_equal(squared_lengths(values), torch.from_numpy(values).square().sum(1).numpy())


def test_rows_of_a_place_are_added_one_after_another() -> None:
    """The order is that of torch's index_add_ on one thread."""
    random = np.random.default_rng(2)
    rows, places = random.standard_normal((3000, 5)).astype(np.float32), random.integers(0, 7, 3000)
    wanted = torch.zeros(9, 5).index_add_(0, torch.from_numpy(places), torch.from_numpy(rows))
    np.testing.assert_array_equal(added_rows(places, rows, 9), wanted.numpy())


def test_codewords_are_subtracted_from_the_rows_named() -> None:
    """In place, and from no other row."""
    rows, book = np.arange(12, dtype=np.float32).reshape(4, 3), np.array([[1, 2, 3], [10, 20, 30]], np.float32)
    wanted = rows.copy()
    wanted[[3, 1]] -= book[[1, 0]]
    subtract_rows(rows, np.array([3, 1]), book, np.array([1, 0]))
    np.testing.assert_array_equal(rows, wanted)
