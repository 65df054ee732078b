"""Ranges are everything, of about equal size, and no tile of the whole scene is in two of them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from reference_encoder.decide.lattice import split
from reference_encoder.scale.cut import END, cut
from reference_encoder.scale.scan import Cells, crowded, divided, first_cells
from scarfmt.arrays import U64
from scarfmt.limits import MAX_TILE_DEPTH


def cells_of(paths: U64, depth: int) -> Cells:
    codes, counts = np.unique(paths >> np.uint64(3 * (MAX_TILE_DEPTH - depth)), return_counts=True)
    return first_cells(codes, counts, depth)


def paths_of(count: int, seed: int) -> U64:
    """Most in a small part of space, some everywhere."""
    rng = np.random.default_rng(seed)
    near = (np.int64(1) << 40) + rng.integers(0, 1 << 30, count)
    far = rng.integers(0, END, count)
    return np.sort(np.where(rng.random(count) < 0.7, near, far)).astype(np.uint64)


@given(st.integers(1, 3000), st.integers(0, 5), st.integers(1, 500), st.integers(1, 200), st.sampled_from([2, 10, 21]))
def test_no_tile_is_in_two_ranges(count: int, seed: int, size: int, tile: int, depth: int) -> None:
    """Tiles as a split of everything makes them; what is finer than the cells is divided within its range."""
    paths = paths_of(count, seed)
    ranges = cut(cells_of(paths, depth), size, tile)
    assert [one.number for one in ranges] == list(range(len(ranges)))
    assert (ranges[0].first, ranges[-1].past) == (0, END)
    assert [one.past for one in ranges[:-1]] == [one.first for one in ranges[1:]]
    borders = np.array([one.first for one in ranges] + [END - 1], np.uint64)
    held = np.diff(np.searchsorted(paths, borders[:-1]), append=count)
    assert [one.count for one in ranges] == held.tolist()
    assert min(held) > 0
    depths, prefixes, _ = split(paths, MAX_TILE_DEPTH, tile)
    free = (3 * (MAX_TILE_DEPTH - depths)).astype(np.uint64)
    inside = [(prefixes << free < border) & (border < (prefixes + np.uint64(1)) << free) for border in borders[1:-1]]
    assert not np.any(inside)


def test_ranges_hold_about_what_they_should() -> None:
    """At most what was asked for and a tile, and no more ranges than needed."""
    ranges = cut(cells_of(paths_of(100_000, 1), 14), 10_000, 100)
    assert len(ranges) == 10
    assert max(one.count for one in ranges) <= 10_000 + 2 * 100


@pytest.mark.parametrize("size", [300, 20])
def test_one_place_that_holds_everything_is_divided(size: int) -> None:
    """An outlier can leave all others in one cell of the first count."""
    paths = np.sort(np.append(np.arange(2000, dtype=np.uint64) << np.uint64(12), np.uint64(END - 1)))
    cells = cells_of(paths, 2)
    while len(full := crowded(cells, size)):
        depth = int(cells.depth.max()) + 5
        codes = paths >> np.uint64(3 * (MAX_TILE_DEPTH - depth))
        codes = codes[np.isin(codes >> np.uint64(15), full)]
        cells = divided(cells, *np.unique(codes, return_counts=True))
    ranges = cut(cells, size, 10)
    assert max(one.count for one in ranges) <= size + 8
    assert sum(one.count for one in ranges) == 2001


def test_what_lies_in_one_point_stays_together() -> None:
    """Nothing tells such Gaussians apart: their range holds more than was asked for."""
    cells = cells_of(np.full(500, 77, np.uint64), MAX_TILE_DEPTH)
    assert not len(crowded(cells, 10))
    assert [one.count for one in cut(cells, 10, 10)] == [500]
