"""Decoded context against its definition in SPEC §10.2, one anchor at a time in Python's integers."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from scarfmt.arrays import I64
from scarfmt.limits import MAX_LOCAL_BITS
from scarfmt.neural.context import FINE_LIMIT, Cells, CellSums, depth_shifts, fine, joining_depths
from scarfmt.scene.model import MAX_STEPS

seeds = st.integers(0, 2**32 - 1)


def means_of(
    cells: Cells, columns: NDArray[np.integer], earlier: NDArray[np.bool_], wanted: I64
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Means and counts round the rows `wanted`, over the rows of (n, f) `columns` that are `earlier`."""
    sums, rows = CellSums(cells, columns.shape[1]), np.flatnonzero(earlier)
    sums.add(rows, columns[rows])
    return sums.around(wanted)


def some_codes(seed: int, count: int, bits: int) -> NDArray[np.uint64]:
    """Ascending codes, some of them equal, dense and sparse regions."""
    rng = np.random.default_rng(seed)
    top = 8 ** rng.integers(0, bits + 1, count).astype(object)
    return np.sort(np.array([int(rng.integers(0, 2**62)) % int(t) for t in top], np.uint64))


def nearest(total: int, count: int) -> int:
    """The nearest integer to a mean, ties up."""
    return (2 * total + count) // (2 * count)


@given(st.integers(-(2**31) + 1, 2**31 - 1), st.integers(0, MAX_STEPS))
def test_fine_is_the_nearest_1024th_of_the_first_cell(value: int, steps: int) -> None:
    """Exact for any value and step count, ties up, clamped."""
    want = 0
    if steps:
        want = (Fraction(1024 * value, 3 ** (steps - 1)) + Fraction(1, 2)).__floor__()
    want = min(max(want, -FINE_LIMIT), FINE_LIMIT)
    assert fine(np.array([[value]]), np.array([steps])).tolist() == [[want]]


@given(seeds, st.integers(1, 60), st.integers(0, MAX_LOCAL_BITS), st.integers(1, 70))
def test_the_depth_is_the_least_with_cells_full_enough(seed: int, count: int, bits: int, target: int) -> None:
    """Counted as in the text: cells(e) * target <= anchors."""
    codes = some_codes(seed, count, bits)
    fits = (e for e in range(bits) if len({int(c) >> (3 * e) for c in codes}) * target <= count)
    assert depth_shifts(codes, bits, (target,)) == [next(fits, bits)]


def test_depths_of_nothing_and_of_the_largest_codes() -> None:
    """No anchors: depth 0. Codes of all 63 bits: the last depth joins them."""
    assert depth_shifts(np.zeros(0, np.uint64), 9, (24, 3)) == [0, 0]
    ends = np.array([0, 2**63 - 1], np.uint64)
    assert joining_depths(ends).tolist() == [MAX_LOCAL_BITS]
    assert depth_shifts(ends, MAX_LOCAL_BITS, (3, 2, 1)) == [21, 21, 0]


def test_sums_grow_as_passes_add_to_them() -> None:
    """Adding in parts is adding at once."""
    rng = np.random.default_rng(3)
    codes = some_codes(3, 200, 6)
    cells = Cells(codes, depth_shifts(codes, 6, (24, 3)))
    columns, everyone = rng.integers(-999, 999, (200, 3)), np.arange(200)
    sums = CellSums(cells, 3)
    for part in np.array_split(rng.permutation(200), 3):
        sums.add(part, columns[part])
    whole = means_of(cells, columns, np.ones(200, np.bool_), everyone)
    assert all(np.array_equal(a, b) for a, b in zip(sums.around(everyone), whole, strict=True))


def test_a_cell_of_very_many_large_values_stays_exact() -> None:
    """The largest sums a file can ask for: 2^20 anchors at the clamp."""
    count = 1 << 20
    codes = np.zeros(count, np.uint64)
    columns = np.full((count, 1), FINE_LIMIT)
    columns[0] -= 1
    means, counts = means_of(Cells(codes, [0]), columns, np.ones(count, np.bool_), np.array([5]))
    assert (means.item(), counts.item()) == (nearest(count * FINE_LIMIT - 1, count), count)
