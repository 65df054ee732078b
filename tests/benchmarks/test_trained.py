"""Trained files: a bounding curve over the post-hoc files."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.judge import bytes_at
from benchmarks.trained import find_frontier

POINTS = st.lists(st.tuples(st.integers(10, 40).map(float), st.integers(1, 1000).map(float)), min_size=1, max_size=12)


@given(POINTS)
def test_no_point_lies_below_the_frontier_and_it_bends_upwards(points: list[tuple[float, float]]) -> None:
    hull = find_frontier(points)
    assert set(hull) <= set(points)
    decibels, sizes = np.array(hull).T
    slopes = np.diff(np.log(sizes)) / np.diff(decibels)
    assert (np.diff(decibels) > 0).all()
    assert (slopes > 0).all()
    assert (np.diff(slopes) > -1e-9).all()
    for psnr, size in points:
        least = bytes_at(hull, max(psnr, decibels[0]))
        assert least is not None
        assert size >= least * (1 - 1e-9)


def test_between_two_points_lies_their_line_and_beyond_them_nothing() -> None:
    hull = find_frontier([(20.0, 100.0), (22.0, 400.0), (21.0, 250.0), (19.0, 120.0)])
    assert hull == [(20.0, 100.0), (22.0, 400.0)]
    assert bytes_at(hull, 21.0) == pytest.approx(200.0)
    assert bytes_at(hull, 19.9) is None
    assert bytes_at(hull, 22.1) is None
    assert bytes_at([], 22.1) is None
